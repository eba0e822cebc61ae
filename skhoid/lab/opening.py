"""From files, and what is said of them, to X, y and the model: of command line and workbench.

What is said are the options of a command, or the choices of a workbench: ``said`` is an object with
their names as attributes.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from .. import (
    ARXRegressor,
    ControlledElement,
    DelaySearchCV,
    LinearElement,
    OperatorRegressor,
    PooledRunsWarning,
    RunInTrimmer,
    resample_runs,
)
from .guessing import ColumnGuess, read_guessed
from .guessing.names import UnclearNamesError, names_guess

LEVELS = ("subject", "condition")
MOST_NAMED = 3  # people in a sentence


def read_chosen(guess: ColumnGuess, said: Any) -> tuple[Any, Any]:
    """X and y of the files of a guess: of one subject or condition, resampled, if that is said."""
    X, y = read_guessed(guess, irregular=said.resample)
    for level in LEVELS:
        label = getattr(said, level)
        if label is not None:
            X, y = _of_label(X, y, level, label)
    warn_of_people_in_names(X)
    return resample_runs(X, y, dt=said.dt) if said.resample else (X, y)


def warn_of_people_in_names(X: Any) -> None:
    """Warn where the names of runs, which are those of files, tell people or conditions apart."""
    labels = X.index.unique("run")
    if "subject" in X.index.names or labels.dtype.kind in "iuf":
        return
    names = [Path(str(label)) for label in labels]
    try:
        found, _ = names_guess(names, Path(), ("subject", "condition", "run"))
    except UnclearNamesError:
        return
    people = list(dict.fromkeys(filter(None, (one.get("subject") for one in found))))
    several_runs = len({one.get("run") for one in found}) > 1
    if len(people) > 1 and several_runs:
        listed = ", ".join(people[:MOST_NAMED]) + (", ..." if len(people) > MOST_NAMED else "")
        warnings.warn(
            PooledRunsWarning(
                f"The names of the files tell {len(people)} people or conditions apart ({listed}), "
                "and their runs are taken for those of one person in one condition. Give the "
                "files of one, or a column that says whose they are, or use skhoid experiment."
            ),
            stacklevel=2,
        )


def _of_label(X: Any, y: Any, level: str, label: str) -> tuple[Any, Any]:
    """The runs of one label of a level, by its text, without that level."""
    if level not in X.index.names:
        raise ValueError(
            f"The runs of {level} {label!r} were asked for, and no column of the files tells "
            f"{level}s apart: say which column is the {level}, or ask for none."
        )
    labels = X.index.get_level_values(level).astype(str)
    if label not in labels:
        known = ", ".join(map(repr, labels.unique()))
        raise ValueError(f"There is no {level} {label!r} in the files, only {known}.")
    chosen = labels == label
    kept = []
    for data in (X, y):
        part = data[chosen].droplevel(level)
        part.index = part.index.remove_unused_levels()
        part.attrs = dict(data.attrs)
        kept.append(part)
    return kept[0], kept[1]


def trimmed(X: Any, y: Any, said: Any) -> tuple[Any, Any]:
    """X and y without their run-in, and about their means, if that is said."""
    if said.run_in:
        X = RunInTrimmer(run_in=said.run_in).fit_transform(X)
    if said.remove_means:
        X, y = about_means(X), about_means(y)
    return X, y


def about_means(data: Any) -> Any:
    """Subtract the mean of all runs, which keeps differences between runs."""
    about = data - data.mean()
    about.attrs = dict(data.attrs)
    return about


def make_estimator(said: Any, X: Any, y: Any, **shared: Any) -> Any:
    """The model, unfitted; the delay of an ARX model is found where nothing is said of it."""
    if said.core == "operator":
        return OperatorRegressor(delay=said.delay, **shared)
    orders = {name: getattr(said, name) for name in ("na", "nb", "nk")}
    arx = ARXRegressor(**shared, **{k: v for k, v in orders.items() if v is not None})
    is_said = said.nk is not None or bool(getattr(said, "shift", None))
    if is_said or getattr(said, "dry_run", False):
        return arx
    return arx.set_params(nk=DelaySearchCV(arx).fit(X, y).best_nk_)


def read_element(text: str | None) -> Any:
    """A controlled element as people type it: a transfer function, or K_c and omega_b."""
    if text is None:
        return None
    words = text.split()
    try:
        K_c, omega_b = map(float, words)
    except ValueError:
        return LinearElement.of(text)
    return ControlledElement(K_c, omega_b)
