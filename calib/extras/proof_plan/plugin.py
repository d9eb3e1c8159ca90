"""What the planning of proofs brings: a purpose of `plan`, its advice after a diagnosis, and what is told of both."""

from calib.planning.purpose import PlanPurpose
from calib.plugins import Presentations

PROVE = "prove"

CONTRIBUTIONS = (
    Presentations(("calib.extras.proof_plan.present.proof_plans",)),
    PlanPurpose(
        PROVE,
        "prove it by changing one condition",
        "prove (the same by changing one condition)",
        of_diagnosis="calib.extras.proof_plan.proof_plan:task_of_diagnosis",
        why_no_candidates="repeats poses that were measured",
        advice="calib.extras.proof_plan.proof_plan:advised_change",
    ),
)
