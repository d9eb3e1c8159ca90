"""Tab Learn: which effect is missing, added and taken out again, and how the error follows."""

from __future__ import annotations

import math

import viser

from calib.calibration import Calibration
from calib.diagnosis import Diagnosis
from calib.effects.descriptions import DESCRIPTIONS
from calib.explanation import MEASURE_NEXT, explain
from calib.screening import Candidate, Screening, Untestable, Value
from calib.sigma_check import noise_floor_mm
from inspector import tables
from inspector.panels import words
from inspector.panels.base import Actions, View, by_page, hidden_plot, put
from inspector.plots import error_history
from inspector.residual_plots import added_variable
from inspector.session import Session

NOTE = (
    "What physical effect does the model lack? Let the program find it, or choose one from the ranking, add it and "
    "see whether the error falls towards the noise, above all that of the test poses, which no fit sees."
)
FIND, STOP = "Find what is missing", "Stop looking"
REMOVE, UNDO, REDO = "Remove", "Undo", "Redo"
NONE = "–"
GOOD, BAD, NEUTRAL = "#009E73", "#D55E00", "#8A8F98"
SMALL = 0.01  # a change of the error below this share is none worth a word
VERDICTS = {
    "adequate": GOOD,
    "named": GOOD,
    "ambiguous": "#E69F00",
    "unexplained": BAD,
    "outliers": "#E69F00",
}


class LearnPanel:
    """The ranking, the buttons, and the history of the error."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._actions = actions
        gui.add_html(tables.note(NOTE))
        self.find = gui.add_button(
            FIND,
            icon=viser.Icon.SEARCH,
            hint="starts from the link errors alone; Undo brings your model back",
        )
        self.choice = gui.add_dropdown("Effect", (NONE,), hint="the best first; the tables are about it")
        self.add = gui.add_button("Add to the model", icon=viser.Icon.PLUS)
        self.change = gui.add_button_group("Model", (REMOVE, UNDO, REDO))
        self._state = gui.add_html("")
        self._doing = gui.add_html("")
        self._history = hidden_plot(gui, 0.6)
        self._verdict = gui.add_html("")
        self._ranking = gui.add_html("")
        self._chosen = gui.add_html("")
        self._variable = hidden_plot(gui, 0.7)
        self._untestable = gui.add_html("")
        self.find.on_click(lambda _: actions.find(self.find.label == FIND))
        self.choice.on_update(lambda e: actions.candidate() if by_page(e) else None)
        self.add.on_click(lambda _: actions.add_effect(str(self.choice.value)))
        self.change.on_click(lambda e: self._pressed(str(e.target.value)))

    def _pressed(self, button: str) -> None:
        if button == REMOVE:
            self._actions.remove_effect(str(self.choice.value))
        else:
            self._actions.move(-1 if button == UNDO else 1)

    def finding(self, running: bool) -> None:
        """While the program looks, the button stops it."""
        self.find.label = STOP if running else FIND

    def say(self, words_now: str) -> None:
        """What is being done, or why it cannot be."""
        self._doing.content = tables.alert(words_now, colour="#56B4E9") if words_now else ""

    def update(self, view: View, *, undo: int, redo: int) -> None:
        """The session's model and what could be missing from it."""
        session = view.session
        self.say("")
        self._offer(session)
        self._state.content = state_html(session, undo, redo)
        self.update_figure(view)
        self._verdict.content = verdict_html(session.diagnosis)
        self.update_choice(view)
        screening = session.screening
        self._untestable.content = untestable_html(screening.untestable) if screening else ""

    def update_figure(self, view: View) -> None:
        """The history of the error."""
        session = view.session
        self._history.visible = session.calibration is not None and bool(session.history)
        if session.calibration is None or not session.history:
            return
        self._history.figure = error_history(
            [step.label for step in session.history],
            [step.train_rmse_mm for step in session.history],
            [step.test_rmse_mm for step in session.history],
            noise_floor_mm(session.calibration),
            dark=view.dark,
        )

    def update_choice(self, view: View) -> None:
        """The ranking with the chosen effect marked, and what is known of that."""
        screening, name = view.session.screening, str(self.choice.value)
        candidate = None if screening is None else _named(screening, name)
        self._variable.visible = candidate is not None and bool(candidate.members)
        if screening is None:
            self._ranking.content = self._chosen.content = ""
            return
        inside = [added.name for added in view.session.effects]
        self._ranking.content = ranking_html(screening, name)
        self._chosen.content = "" if name == NONE else chosen_html(name, candidate)
        if name in inside and view.session.calibration is not None:
            self._chosen.content += fitted_html(view.session.calibration, name)

        if candidate is not None and candidate.members:
            self._variable.figure = added_variable(
                candidate.explained, screening.leftover.residual, name, dark=view.dark
            )

    def _offer(self, session: Session) -> None:
        """All that can be added or removed; what was chosen stays chosen, so that a second press adds nothing more."""
        inside = [added.name for added in session.effects]
        ranked = [c.name for c in session.screening.candidates] if session.screening else []
        if session.screening is None and session.calibration is not None:
            ranked = [o for o in self.choice.options if o != NONE]  # while the ranking is made
        options = tuple(dict.fromkeys([*ranked, *inside])) or (NONE,)
        before = str(self.choice.value)
        if options != tuple(self.choice.options):
            self.choice.options = options
        put(self.choice, before if before in options and before != NONE else options[0])


def _named(screening: Screening, name: str) -> Candidate | None:
    return next((c for c in screening.candidates if c.name == name), None)


def state_html(session: Session, undo: int, redo: int) -> str:
    """What is in the model, its figures, and whether the last change helped."""
    if session.calibration is None or not session.history:
        return tables.note("Not calibrated yet.")
    last = session.history[-1]
    floor = noise_floor_mm(session.calibration)
    rows: list[tuple[str, object]] = [
        ("model", " + ".join(["link errors", *(added.name for added in session.effects)])),
        ("training 3D RMSE", f"{words.millimetres(last.train_rmse_mm)} mm"),
        ("test 3D RMSE", f"{words.millimetres(last.test_rmse_mm)} mm"),
        ("noise alone, 3D", "not declared" if floor is None else f"{words.millimetres(floor)} mm"),
        ("changes to undo · redo", f"{undo} · {redo}"),
    ]
    sentence, colour = last_change(session)
    return tables.facts(rows) + (tables.alert(sentence, colour=colour) if sentence else "")


def last_change(session: Session) -> tuple[str, str]:
    """Whether the last change of the model helped, in words, with a colour."""
    if len(session.history) < 2:
        return "", NEUTRAL
    old, new = session.history[-2:]
    tested = math.isfinite(old.test_rmse_mm) and math.isfinite(new.test_rmse_mm)
    before, after = (old.test_rmse_mm, new.test_rmse_mm) if tested else (old.train_rmse_mm, new.train_rmse_mm)
    of = "test error" if tested else "training error (there are no test poses)"
    figures = f"{words.millimetres(before)} → {words.millimetres(after)} mm"
    if not (before > 0 and math.isfinite(after)):
        return "", NEUTRAL
    share = after / before - 1
    adds = not new.label.startswith("\u2212")
    if abs(share) < SMALL:
        more = "It does not help; Undo takes it out again." if adds else "It was not needed."
        return f"{new.label}: the {of} hardly changed, {figures}. {more}", NEUTRAL
    if share < 0:
        return f"{new.label}: the {of} fell by {-100 * share:.0f} %, {figures}.", GOOD
    more = "It does not help; Undo takes it out again." if adds else "It was needed; Undo brings it back."
    return f"{new.label}: the {of} rose by {100 * share:.0f} %, {figures}. {more}", BAD


def verdict_html(diagnosis: Diagnosis | None) -> str:
    """The verdict, and all that led to it in words."""
    if diagnosis is None:
        return ""
    *paragraphs, verdict = explain(diagnosis).split("\n\n")
    return (
        tables.heading("Verdict")
        + tables.alert(verdict, colour=VERDICTS[diagnosis.verdict])
        + "".join(tables.note(paragraph) for paragraph in paragraphs)
    )


def ranking_html(screening: Screening, chosen: str) -> str:
    """All candidates, the best first."""
    names = [c.name for c in screening.candidates]
    rows = [
        (
            c.name,
            f"{c.log_evidence:.1f}",
            probability(c.p_holm),
            f"{100 * c.explained_share:.0f}",
            words.millimetres(c.cv_rmse_mm),
        )
        for c in screening.candidates
    ]
    return (
        tables.heading("What could be missing from this model")
        + tables.table(
            ("effect", "evidence", "p (Holm)", "share, %", "CV, mm"),
            rows,
            mark=names.index(chosen) if chosen in names else None,
        )
        + tables.note(
            "Log evidence above 3 and p below 0.01 (Holm-corrected) speak for an effect; a lead of less than 3 over "
            "the next leaves it open. Share: how much of what is left it explains. CV: error a coordinate when each "
            "pose is predicted from the others, "
            f"{words.millimetres(screening.cv_rmse_mm)} mm without any of them."
        )
    )


def chosen_html(name: str, candidate: Candidate | None) -> str:
    """What the chosen effect is, its estimated parameters, what it may be confused with, how to be sure."""
    described = next((d for d in DESCRIPTIONS if d.name == name), None)
    out = tables.heading(f"Effect {name}")
    facts: list[tuple[str, object]] = []
    if described is not None:
        facts += [("equation", described.equation), ("needs", described.needs)]
    if candidate is not None:
        likeness = ", ".join(f"{n} {100 * s:.0f} %" for n, s in list(candidate.overlaps.items())[:5])
        facts.append(("could also be made by", likeness or "nothing else here"))
        if candidate.family.note:
            facts.append(("assumed", candidate.family.note))
    if name in MEASURE_NEXT:
        facts.append(("to be sure, measure", MEASURE_NEXT[name]))
    out += tables.facts(facts)
    if candidate is None:
        return out
    if not candidate.values:
        return out + tables.note("Nothing of it shows in what is left over.")
    rows = [value_row(value) for value in candidate.values]
    return (
        out
        + tables.table(("estimated parameter", "value", "sigma", "unit"), rows, height="260px")
        + tables.note(
            "Linear estimates from what is left over; a fit with the effect in the model settles them. Below: each "
            "coordinate that is left over against what the effect would make of it. Points along the line speak for it."
        )
    )


def fitted_html(calibration: Calibration, name: str) -> str:
    """The parameters of an effect that is in the model, as they were fitted."""
    rows = [
        (row["name"].partition(".")[2], f"{row['value']:.3g}", f"{row['sigma']:.1g}", row["unit"])
        for row in calibration.to_frame().to_dict("records")
        if str(row["name"]).startswith(f"{name}.")
    ]
    return tables.note("It is in the model. Fitted together with everything else:") + tables.table(
        ("fitted parameter", "value", "sigma", "unit"), rows, height="260px"
    )


def value_row(value: Value) -> tuple[str, str, str, str]:
    """A coefficient with its unit; the family's name is in the heading."""
    return value.name.partition(".")[2] or value.name, f"{value.value:.3g}", f"{value.sigma:.1g}", value.unit


def untestable_html(untestable: tuple[Untestable, ...]) -> str:
    """What these data cannot speak about, why, and what would help."""
    if not untestable:
        return ""
    return tables.heading("Cannot be tested with these data") + tables.bullets(
        f"{u.name}: {u.why}. To test it: {u.would_help}." for u in untestable
    )


def probability(p: float) -> str:
    """ "1.0" for no case at all, powers of ten where it is small."""
    return f"{p:.0e}" if p < 0.001 else f"{p:.2g}"
