"""From files and choices to X, y, a model, what is wrong with the data, and the script of it."""

from __future__ import annotations

import pprint
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...arx.batch import ARXRegressor
from ...arx.searches import DelaySearchCV
from ...human.controlled_element import element_of
from ...io._column_guess import ColumnGuess
from ...io.readers import read_guessed
from ...model import OperatorRegressor
from ...preprocessing import RunInTrimmer, resample_runs
from ...preprocessing.means import about_means
from ...recordings.channels import check_channels
from ...runs import read_layout
from ...runs.selection import runs_of_label
from ...text import counted
from .choices import Choices
from .columns import Columns

__all__ = ["Recorded", "estimator_of", "read", "search_settings"]

WIDTH = 96  # columns of the script


@dataclass(frozen=True)
class Recorded:
    """X and y, what they are in words, what is wrong with them, and the script that reads them."""

    X: Any
    y: Any
    inputs: list[str]
    roles: dict[str, str]
    words: str
    findings: list[dict[str, str]]
    source: list[str]


def read(paths: list[Path], columns: Columns, choices: Choices) -> Recorded:
    """Read all files, and check units, clocks and channels."""
    guess = columns.guess
    X, y = read_guessed(guess, irregular=choices.resample)
    for level in ("subject", "condition"):
        label = getattr(choices, level)
        if label is not None:
            X, y = _of_label(X, y, level, label)
    findings = [] if choices.resample else check_channels(X, y)
    if choices.resample:
        X, y = resample_runs(X, y, dt=choices.dt)
    if choices.run_in:
        X = RunInTrimmer(run_in=choices.run_in).fit_transform(X)
    if choices.remove_means:
        X, y = about_means(X), about_means(y)
    said = [
        {
            "title": one.title,
            "evidence": one.evidence,
            "meaning": one.meaning,
            "next_step": one.next_step,
        }
        for one in findings
    ]
    return Recorded(
        X, y, guess.inputs, guess.roles, _words(X), said, _source(paths, columns, choices)
    )


def estimator_of(recorded: Recorded, choices: Choices) -> Any:
    """The model, unfitted."""
    shared: dict[str, Any] = {"inputs": recorded.inputs, "roles": recorded.roles or None}
    if choices.core == "operator":
        return OperatorRegressor(delay=choices.delay, **shared)
    orders = {name: getattr(choices, name) for name in ("na", "nb", "nk")}
    shared |= {name: value for name, value in orders.items() if value is not None}
    arx = ARXRegressor(**shared)
    if choices.nk is not None:
        return arx
    return arx.set_params(nk=DelaySearchCV(arx).fit(recorded.X, recorded.y).best_nk_)


def search_settings(choices: Choices) -> dict[str, Any]:
    """Parameters of the search that the user has set."""
    names = ("display", "controlled_element", "effects", "max_effects", "lost_control")
    settings = {name: getattr(choices, name) for name in names}
    settings["controlled_element"] = element_of(choices.controlled_element)
    return {name: value for name, value in settings.items() if value is not None}


def _of_label(X: Any, y: Any, level: str, label: str) -> tuple[Any, Any]:
    """The runs of one subject, or of one condition."""
    if level not in X.index.names:
        raise ValueError(
            f"The runs of {level} {label!r} were asked for, and no column is the {level}: choose "
            "it among the columns."
        )
    return runs_of_label(X, y, level, label)


def _words(X: Any) -> str:
    """How much there is: runs, rows, duration, rate."""
    levels = [name for name in X.index.names if name != "time"]
    time = X.index.get_level_values("time").to_numpy()
    n_runs = len(read_layout(X).labels)
    step = np.diff(time[: min(len(time), 1000)])
    dt = float(np.median(step)) if step.size else float("nan")
    people = X.index.unique("subject") if "subject" in levels else []
    who = f" of {len(people)} people" if len(people) > 1 else ""
    seconds = len(X) * dt
    return (
        f"{counted(n_runs, 'run')}{who}, {counted(len(X), 'row')}: {seconds:.4g} s in all, one "
        f"row every {dt:.4g} s."
    )


def _source(paths: list[Path], columns: Columns, choices: Choices) -> list[str]:
    """Lines of Python that make X and y as they were made here; the script imports readers."""
    names = [str(path) for path in paths]
    listed = pprint.pformat(names[0] if len(names) == 1 else names, width=WIDTH - 4)
    if columns.as_guessed and not choices.resample:
        lines = [f"X, y = read_runs({listed})"]
    else:
        lines = [
            "from skhoid.io.guess import ColumnGuess",
            "from skhoid.io.readers import read_guessed",
            "",
            f"columns = ColumnGuess({listed})",
            *_set(columns.guess),
            f"X, y = read_guessed(columns{', irregular=True' if choices.resample else ''})",
        ]
    return lines + _worked_on(choices)


def _set(guess: ColumnGuess) -> list[str]:
    names = ("channels", "roles", "output", "time", "dt", "run", "levels", "units", "error_from")
    values = {name: getattr(guess, name) for name in names}
    return [
        f"columns.{name} = {pprint.pformat(value, width=WIDTH - 20, sort_dicts=False)}"
        for name, value in values.items()
        if value
    ]


def _worked_on(choices: Choices) -> list[str]:
    lines = []
    for level in ("subject", "condition"):
        label = getattr(choices, level)
        if label is not None:
            lines += [
                f"chosen = X.index.get_level_values({level!r}).astype(str) == {label!r}",
                f"X, y = X[chosen].droplevel({level!r}), y[chosen].droplevel({level!r})",
                "X.index, y.index = (part.index.remove_unused_levels() for part in (X, y))",
            ]
    if choices.resample:
        lines += [f"X, y = resample_runs(X, y, dt={choices.dt})"]
    if choices.run_in:
        lines += [
            "from skhoid import RunInTrimmer",
            f"X = RunInTrimmer(run_in={choices.run_in!r}).fit_transform(X)",
        ]
    if choices.remove_means:
        lines += [
            "units = X.attrs, y.attrs",
            "X, y = X - X.mean(), y - y.mean()",
            "X.attrs, y.attrs = units",
        ]
    return lines
