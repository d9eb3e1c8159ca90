"""Figures of results: each function takes a result of `calib` and returns a plotly figure.

    import calib
    from inspector import figures

    found = calib.diagnose(calib.load_dataset("my_cell"))
    figures.error_history(found).show()

Plotly comes with the extra `page`; viser is not needed. The modules below take arrays; page and report use them.
"""

from importlib import import_module

_HOME = {
    "added_variable": "inspector.figures.results.of_results",
    "control_chart": "inspector.figures.results.of_results",
    "convergence": "inspector.figures.results.of_results",
    "error_bars": "inspector.figures.results.of_results",
    "error_history": "inspector.figures.results.of_results",
    "fleet_errors": "inspector.figures.results.of_results",
    "learned_curves": "inspector.figures.results.of_results",
    "learning_curve": "inspector.figures.results.of_results",
    "moved_by_change": "inspector.figures.results.of_results",
    "plan_curve": "inspector.figures.results.of_results",
    "ranking": "inspector.figures.results.of_results",
    "redundancy_heatmap": "inspector.figures.results.of_results",
    "reprojection": "inspector.figures.results.of_results",
    "residuals_over": "inspector.figures.results.of_results",
    "series_chart": "inspector.figures.results.of_results",
    "to_svg": "inspector.figures.results.still",
    "where_measured": "inspector.figures.results.of_results",
    "work_space": "inspector.figures.results.of_results",
}

__all__ = [
    "added_variable",
    "control_chart",
    "convergence",
    "error_bars",
    "error_history",
    "fleet_errors",
    "learned_curves",
    "learning_curve",
    "moved_by_change",
    "plan_curve",
    "ranking",
    "redundancy_heatmap",
    "reprojection",
    "residuals_over",
    "series_chart",
    "to_svg",
    "where_measured",
    "work_space",
]


def __getattr__(name: str) -> object:
    """Figure function by its name, loaded on first use (PEP 562). Raises CalibError where plotly is not installed."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = import_module(_HOME[name])
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "plotly":
            raise
        from calib.errors import CalibError

        raise CalibError(
            f"inspector.figures.{name} needs plotly, which is not installed: "
            "pip install 'robot-calibration-inspector[page]'"
        ) from None
    value: object = getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
