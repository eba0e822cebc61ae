"""Preparation: from what was read to what a model is fitted to, as steps of a stock pipeline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ... import Decimator, DelayShift, RunInTrimmer, sampling_time, vaf_score
from ...exceptions import ShortRunError
from ...runs import read_layout, run_name
from ..opening import about_means
from .columns import Choices, Recorded, UnfitChoiceError

WITHOUT_FILTER = {"aggregate": ", means of them", "downsample": ", without a filter"}
WORSE_BY = 1.0  # points of VAF, as identify counts a model worse


@dataclass(frozen=True)
class Prepared:
    """X and y to fit, the lines of Python that make them of files, and what was done in words.

    ``note`` is what the decimation costs, where it costs much; ``shift`` is the fitted step.
    """

    X: Any
    y: Any
    source: list[str]
    words: list[str]
    note: str
    shift: DelayShift | None


def prepare(recorded: Recorded, choices: Choices) -> Prepared:
    """Cut, centre, trim, thin and shift recorded runs."""
    X, y = recorded.X, recorded.y
    dt = sampling_time(X)
    source, words, note = list(recorded.source), [], ""
    if choices.until is not None:
        X, y = cut(X, y, choices.until)
        source += [
            f'kept = X.index.get_level_values("time") < {choices.until!r}',
            "X, y = X[kept], y[kept]",
        ]
        words += [f"up to {choices.until:g} s"]
    if choices.remove_means:
        X, y = about_means(X), about_means(y)
        source += [
            "units = X.attrs, y.attrs",
            "X, y = X - X.mean(), y - y.mean()",
            "X.attrs, y.attrs = units",
        ]
        words += ["about the means"]
    steps = make_steps(recorded, choices)
    for field, (step, said) in steps.items():
        before = X
        try:
            X = step.fit_transform(before)
            if field == "decimate":
                note = tell_what_is_lost(before, y, choices, dt)
        except ShortRunError as error:
            raise UnfitChoiceError(f"{tell_shortest(X)}: give less.", field) from error
        except ValueError as error:
            raise UnfitChoiceError(str(error), field) from error
        words += [said.format(rate=f"{1 / (dt * choices.decimate):.4g} Hz")]
    listed = ", ".join(repr(step) for step, _ in steps.values())
    if len(steps) > 1:
        listed = f"make_pipeline({listed})"
    source += [f"X = {listed}.fit_transform(X)"] if steps else []
    shift, _ = steps.get("shift", (None, ""))
    return Prepared(X, y, source, words, note, shift)


def make_steps(recorded: Recorded, choices: Choices) -> dict[str, tuple[Any, str]]:
    """The steps that are chosen, each by the name of its choice and in words."""
    steps: dict[str, tuple[Any, str]] = {}
    if choices.run_in:
        trimmer = RunInTrimmer(run_in=choices.run_in)
        steps["run_in"] = trimmer, f"run-in {choices.run_in:g} s"
    if choices.measurement_time is not None:
        trimmer = RunInTrimmer(measurement_time=choices.measurement_time)
        steps["measurement_time"] = trimmer, f"last {choices.measurement_time:g} s"
    if choices.decimate > 1:
        thinner = Decimator(choices.decimate, method=choices.method, padding=choices.padding)
        said = f"one row in {choices.decimate} ({{rate}}{WITHOUT_FILTER.get(choices.method, '')})"
        steps["decimate"] = thinner, said
    if choices.core == "arx" and choices.shift:
        check_target(recorded.roles)
        shift = DelayShift(choices.shift, inputs=recorded.inputs)
        steps["shift"] = shift, f"delay {choices.shift:g} s"
    return steps


def check_target(roles: dict[str, str]) -> None:
    """Refuse to shift an error of which, with x, the target would be made."""
    if {"e", "x"} <= {*roles.values()} and "f_t" not in roles.values():
        raise UnfitChoiceError(
            "Without a column of the target it is e + x, which a shift of e alone would change. "
            "Say above which column the target is, or that x is not used, or give nk.",
            "shift",
        )


def cut(X: Any, y: Any, until: float) -> tuple[Any, Any]:
    """The rows of runs before a time."""
    layout = read_layout(X)
    kept = layout.time < until
    left = np.add.reduceat(kept, layout.run_starts[:-1])
    if not left.all():
        run = int(np.argmin(left))
        raise UnfitChoiceError(
            f"Nothing is left of run {run_name(layout.labels[run])}, whose time begins at "
            f"{layout.time[layout.run_starts[run]]:g} s. Give a later end.",
            "until",
        )
    return X[kept], y[kept]


def tell_shortest(X: Any) -> str:
    """The shortest run, and how long it lasts."""
    layout = read_layout(X)
    rows = np.diff(layout.run_starts)
    run = int(np.argmin(rows))
    return f"Run {run_name(layout.labels[run])} lasts {rows[run] * layout.dt:.4g} s"


def tell_what_is_lost(X: Any, y: Any, choices: Choices, dt: float) -> str:
    """What to say where thinned rows cannot hold the output."""
    output = pd.DataFrame({"y": y.to_numpy(dtype=float)}, index=X.index)
    held = Decimator(choices.decimate, padding=choices.padding).fit_transform(output)["y"]
    most = vaf_score(output["y"], held.to_numpy())
    if most > 100 - WORSE_BY:
        return ""
    return (
        f"{100 - most:.3g} % of the output is above {0.5 / (dt * choices.decimate):.3g} Hz, which "
        f"such rows cannot hold: no model of them reaches a VAF above {most:.3g} %. Keep more rows."
    )


def tell_model(choices: Choices) -> str:
    """The model in words, before what it finds is known."""
    if choices.core == "operator":
        return "operator" if choices.delay is None else f"operator, delay {choices.delay:g} s"
    na, nb = choices.na or 2, choices.nb or 2
    known = choices.nk if choices.nk is not None else 0 if choices.shift else None
    return f"ARX {na}, {nb}, {'nk is found' if known is None else known}"


def tell_steps(prepared: Prepared, choices: Choices) -> str:
    """The whole pipeline in one line."""
    return " → ".join([*prepared.words, tell_model(choices)])
