"""The bar above the 3D view: errors by stage, the four steps of the work, and viewing directions.

Its classes are styled in `server/client/page.css`; the page's script shows it over the 3D view.
"""

from __future__ import annotations

from dataclasses import replace

import viser

from calib.calibration.model_versions import LINKS, NOMINAL
from calib.diagnosis.budget import ErrorBudget
from calib.diagnosis.headline import ErrorStage, Headline
from calib.html_text import escape
from calib.present.diagnosis.budget import budget_parts, budget_sentence
from calib.present.effects import title
from calib.present.fit import errors as headlines
from calib.rendering import numbers
from inspector.markup.parts.elements import asking, legend, opening
from inspector.markup.parts.palette import MODEL_COLOURS
from inspector.session.loop import FIND, FIT, IDLE, MEASURE, STEPS, TAKE, Progress, TaskStatus
from inspector.session.session import Session
from inspector.session.view import SIDES, View

OFF_BY = "How far the arm is off"
OF_SQUARE = "Squared error as delivered:"
TABS = {  # where each step is done
    MEASURE: "Measure/Scans",
    FIT: "Model/Fit",
    FIND: "Learn/What is missing",
    TAKE: "Take away",
}
FITTING = "Fitting the arm's links to the measured points …"
RANKING = "Weighing what could be missing from the model …"
FOUND = "Take away the calibrated robot, the model or a report."
TO_FIND = "Let the program find what this arm does that its model lacks."
NO_DATASET = "No dataset is open."
NO_CORNER = "No scan shows what is searched for: Review says why."


class HeadlinePanel:
    """The headline as one piece of HTML, sent only after a change."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html("")
        gui.add_html(f'<div data-over-view="looks">{looks_html()}</div>')
        self._sent = ""
        self._doing: TaskStatus = IDLE
        self._view: View | None = None

    def update(self, view: View) -> None:
        """Show the session and the version of its model on show."""
        before, self._view = self._view, view
        # Another pose changes nothing.
        if before is None or before.session is not view.session or before.shown_step != view.shown_step:
            self._show()

    def opening(self, name: str) -> None:
        """Clear the figures of the dataset before while another is opened."""
        self._view, self._doing = None, TaskStatus(words=f"Opening {name} …")
        self._show()

    def still(self, view: View | None) -> None:
        """Show the session that stays on show where another cannot be opened; None where there is none."""
        self._view, self._doing = view, IDLE
        self._show()

    def doing(self, **what: bool | str) -> None:
        """Set the task that the program is working on (fields of `TaskStatus`)."""
        doing = replace(self._doing, **what)  # type: ignore[arg-type]
        if doing != self._doing:
            self._doing = doing
            self._show()

    def _show(self) -> None:
        content = f'<div data-over-view="headline">{headline_html(self._view, self._doing)}</div>'
        if content != self._sent:
            self._sent = content
            self._html.content = content


def headline_html(view: View | None, doing: TaskStatus) -> str:
    """HTML of the whole bar; before there is a model, with the current and the next task instead of errors."""
    if view is None:
        return f'<div class="headline"><div class="headline-now">{escape(doing.words or NO_DATASET)}</div></div>'
    session = view.session
    progress = Progress.of(session, doing)
    told = session.headline
    way = _TO_COME if told is None else _way(told, view)
    now = f'<div class="headline-now">{escape(_now(session, progress, doing))}</div>'
    leads = " data-leads" if doing.leads and session.diagnosis is None else ""
    return f'<div class="headline"{leads}>{way}{_steps(progress, doing)}{now}</div>'


def looks_html() -> str:
    """HTML of the buttons for the viewing directions of the 3D view."""
    return "".join(f'<span class="look"{asking("look", side)} title="key {side[0]}">{side}</span>' for side in SIDES)


def _way(told: Headline, view: View) -> str:
    """HTML of the errors at each stage from the nominal robot on, as buttons, with the noise."""
    arrow = '<span class="headline-arrow" aria-hidden="true">→</span>'
    stages = arrow.join(_stage(told, stage, view) for stage in told.stages)
    noise = f'<span class="headline-noise">({escape(headlines.noise(told))})</span>'
    diagnosis = view.session.diagnosis
    note = escape(headlines.note(told, unexplained=diagnosis is not None and diagnosis.is_unexplained))
    of = f'<span class="headline-of" title="{note}">{OFF_BY}</span>'
    return (
        f'<div class="headline-title">{of}{noise}</div><div class="headline-way">{stages}</div>'
        f"{_budget(view.session.budget)}"
        f'<div class="headline-note" title="{note}">{note}</div>'
    )


def _budget(budget: ErrorBudget | None) -> str:
    """HTML of the thin bar of the error budget: causes of the squared error as delivered, with their legend."""
    if budget is None:
        return ""
    parts = "".join(
        f'<i style="flex-grow:{part.share:.4f};background:{part.colour}" '
        f'title="{escape(f"{part.name} {part.words}: {part.note}")}"></i>'
        for part in budget_parts(budget)
    )
    words = escape(budget_sentence(budget))
    meant = legend(((part.colour, f"{part.name} {part.words}") for part in budget_parts(budget)), before=OF_SQUARE)
    bar = f'<div class="headline-budget" role="img" aria-label="{words}" title="{words}">{parts}</div>'
    return f'{bar}<div class="headline-parts" title="{words}">{meant}</div>'


_TO_COME = (
    f'<div class="headline-title"><span>{OFF_BY}</span></div><div class="headline-way">'
    + "".join(
        f'<span class="headline-stage" style="--of-version:{MODEL_COLOURS[name]}"><strong>–</strong>'
        f"<span>{name}</span></span>"
        for name in (NOMINAL, LINKS)
    )
    + "</div>"
)
"""What stands in the place of the errors before a fit, so that the bar keeps about its height."""


def _stage(told: Headline, stage: ErrorStage, view: View) -> str:
    step = 0 if stage.step is None else stage.step + 1
    shown = step == view.shown_step
    colour = MODEL_COLOURS[view.version_of_step(step)]
    return (
        f'<span class="headline-stage" aria-pressed="{str(shown).lower()}" style="--of-version:{colour}"'
        f'{asking("step", step)} title="Show this model in 3D, tables and plots">'
        f"<strong>{escape(headlines.length(told, stage.error_mm))}</strong>"
        f"<span>{escape(_in_words(stage))}</span></span>"
    )


def _in_words(stage: ErrorStage) -> str:
    """Name of a stage with its effects in words, which break between them: "with joint compliance"."""
    name = stage.name
    for key in stage.effects:
        name = name.replace(key, title(key))
    return name


def _steps(progress: Progress, doing: TaskStatus) -> str:
    """HTML of the four steps of the work, marked as done, next or later; a click opens a step's tab."""
    return f'<div class="headline-steps">{"".join(_step(name, progress, doing) for name in STEPS)}</div>'


def _step(name: str, progress: Progress, doing: TaskStatus) -> str:
    state = "next" if name == progress.next else "done" if name in progress.done else "later"
    sign = "✓" if name in progress.done else str(STEPS.index(name) + 1)
    return (
        f'<span class="headline-step" data-state="{state}" aria-label="{name}, {state}"{_does(name, progress, doing)}>'
        f'<i aria-hidden="true">{sign}</i>{escape(name)}</span>'
    )


def _does(name: str, progress: Progress, doing: TaskStatus) -> str:
    """HTML attributes for a click on a step: it opens the step's tab, and starts the search where that comes next."""
    if name == FIND and progress.next == FIND and not doing.finding:
        return asking("find", "start", tab=TABS[FIND])
    return opening(TABS[name])


def _now(session: Session, progress: Progress, doing: TaskStatus) -> str:
    """Sentence on the current task, or on the next one."""
    searched, scans = session.scans - len(session.waiting), session.scans
    if progress.next == MEASURE:
        if doing.searching:
            return f"Looking for the jig's corner in each scan: {searched} of {scans}. Then the arm is fitted to them."
        if searched == scans:
            return NO_CORNER
        stopped = f"The search is stopped: {searched} of {numbers.count(scans, 'scan')} searched."
        return f"{stopped} Go on searching in the panel Review."
    if progress.next == FIT:
        return doing.problem or FITTING
    if progress.next == FIND:
        waits = session.advice is None
        return doing.words or (RANKING if waits else f"Next: {TO_FIND}")
    return doing.words or f"Next: {FOUND}"
