"""The figures of results as type checkers see them: what `__init__.py` loads when it is first asked for."""

from inspector.figures.results.alone import to_svg as to_svg
from inspector.figures.results.of_results import convergence as convergence
from inspector.figures.results.of_results import error_bars as error_bars
from inspector.figures.results.of_results import error_history as error_history
from inspector.figures.results.of_results import learned_curves as learned_curves
from inspector.figures.results.of_results import learning_curve as learning_curve
from inspector.figures.results.of_results import moved_by_change as moved_by_change
from inspector.figures.results.of_results import plan_curve as plan_curve
from inspector.figures.results.of_results import redundancy_heatmap as redundancy_heatmap
from inspector.figures.results.of_results import residuals_over as residuals_over

__all__ = [
    "convergence",
    "error_bars",
    "error_history",
    "learned_curves",
    "learning_curve",
    "moved_by_change",
    "plan_curve",
    "redundancy_heatmap",
    "residuals_over",
    "to_svg",
]
