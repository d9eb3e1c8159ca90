"""Figures of results: each function takes a result of `calib` and returns a plotly figure.

    import calib
    from inspector import figures

    found = calib.diagnose(calib.load_dataset("my_cell"))
    figures.error_history(found).show()

Plotly comes with the extra `page`; viser is not needed. The modules below take arrays; page and report use them.
"""

from importlib import import_module

from inspector.plugins import Figures, contributions

_RESULTS = (
    "convergence",
    "error_bars",
    "error_history",
    "learned_curves",
    "learning_curve",
    "moved_by_change",
    "plan_curve",
    "redundancy_heatmap",
    "residuals_over",
)
_HOME = {**dict.fromkeys(_RESULTS, "inspector.figures.results.of_results"), "to_svg": "inspector.figures.results.alone"}
_CONTRIBUTED = {name: brought.module for brought in contributions(Figures) for name in brought.names}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    """Figure function by its name, loaded on first use (PEP 562). Raises CalibError where plotly is not installed."""
    home = _HOME.get(name) or _CONTRIBUTED.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = import_module(home)
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
    return sorted({*globals(), *__all__, *_CONTRIBUTED})
