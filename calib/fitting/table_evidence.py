"""Whether an arm's links are as robot.toml has them, by the evidence of the points for the size of their errors.

A prior with the manufacturing tolerances lets every knowable parameter follow the noise. Of an arm whose controller has
its true links that makes the fit worse than the table. The fit's own linearisation tells how likely the points are
where all link errors have a common share t of their tolerances: with whitened rows y = A T z + e, z and e / w standard
normal and T = t for the link errors, 1 for all else, the log evidence is, but for a constant,

    -1/2 log det(1 + T A'A T / w^2) + 1/2 y'A T (1 + T A'A T / w^2)^-1 T A'y / w^4

(MacKay 1992). Errors of a hundredth of the tolerances are told from none, so the answer is clear for most arms.
"""

from __future__ import annotations

import numpy as np

from calib.effects.effect import full_name
from calib.effects.link_errors import LinkErrors
from calib.fitting.fit import Fit
from calib.fitting.model import Model
from calib.fitting.residual import Residuals

_SHARES = np.geomspace(1.0, 0.003, 11)  # of the tolerances
_HELD = 1e-4  # of the tolerances, of links that are held: 1 micrometre at an arm's length
_SURE = 5.0  # nats by which the least share has to be likelier than the whole tolerance
TIP = "TCP"  # whose frame is that of the target or of the tool, not of the arm


def sigmas_near_table(model: Model, links: LinkErrors, residuals: Residuals, fit: Fit) -> dict[str, float]:
    """Prior sigmas, by name, of link errors that are as good as none; empty where the links differ from the table.

    The tool's frame is not among them: where a target or the scanner is mounted no table knows.
    """
    least = {full_name(links, p): _HELD * p.scale for p in links.parameters if not p.name.endswith(TIP)}
    of_links = np.array([p.name in least for p in model.parameters], dtype=bool)
    if not of_links.any() or not np.isfinite(fit.reduced_chi):
        return {}
    at, scales = residuals.linearise(fit.x), model.scales
    rows = at.jacobian * scales
    noise = max(fit.reduced_chi, residuals.noise_floor, 1e-12)
    # By singular values, as exact data have no noise to speak of, and squares of such rows lose all digits.
    basis, root = np.linalg.qr(rows / noise)
    seen = basis.T @ ((rows @ (fit.x / scales) - at.residual) / noise)
    evidence = []
    for share in _SHARES:
        turn, size, _ = np.linalg.svd(root * np.where(of_links, share, 1.0))
        explained = turn.T @ seen * (size / np.hypot(1.0, size))
        evidence.append(0.5 * float(explained @ explained) - float(np.log(np.hypot(1.0, size)).sum()))
    return least if int(np.argmax(evidence)) == len(_SHARES) - 1 and evidence[-1] > evidence[0] + _SURE else {}
