"""An exploration as a script: what gives the same numbers in a process of its own."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from sklearn.base import clone

import skhoid

from ...effects import Effects
from .models import Position, Runs, own_values

GIVEN = ["# X and y: the runs of this exploration, as they were given to it."]


def write_script(
    estimator: Any,
    runs: Runs,
    position: Position,
    source: Sequence[str] | None,
    figures: Mapping[str, float | None],
) -> str:
    """The script of a position; ``figures`` are what it will print, by the runs they are of."""
    body = [*(source or GIVEN), *_lost(runs)]
    fitted, lines = _part("fitted", runs, position.train)
    body += lines
    held, lines = _part("held_out", runs, position.hold) if position.hold else ("", [])
    body += lines
    model = _construction(estimator, position.effects)
    body += [f"model = {model}", f"model.fit({fitted})"]
    moved = own_values(position.moved, position.effects)
    if moved:
        body += [f"model = model.with_parameters({moved!r})  # moved by hand"]
    settling = float(getattr(estimator, "settling", 0.0))
    body += ["", f"vaf = VAFScorer({f'run_in={settling!r}' if settling else ''})"]
    rows = {"fitted": fitted, "held out": held}
    for words, figure in figures.items():
        if rows.get(words):
            body += [f'print("VAF, runs {words}:", vaf(model, {rows[words]}))  # {figure!r}']
    body += ["print(model.parameters_.to_string())"]
    return "\n".join([*_imports(position.effects, "\n".join(body)), "", *body, ""])


def _imports(effects: Effects, body: str) -> list[str]:
    names = set(re.findall(r"\b\w+(?=\()", body)) & {*dir(skhoid)}
    lines = ["import numpy as np", ""] if "np." in body else []
    if "make_pipeline(" in body:
        lines += ["from sklearn.pipeline import make_pipeline", ""]
    lines += [f"from skhoid import {', '.join(sorted(names))}"]
    classes = {type(e) for _, e in effects}
    own = sorted(c.__name__ for c in classes if not c.__module__.startswith("skhoid."))
    known = sorted(c.__name__ for c in classes if c.__module__.startswith("skhoid."))
    if known:
        lines += [f"from skhoid.effects import {', '.join(known)}"]
    if own:
        lines += [f"# {', '.join(own)}: your own, to be imported here."]
    return lines


def _lost(runs: Runs) -> list[str]:
    """Lines that leave out where control was lost."""
    if not runs.lost:
        return []
    lines = ["y = y.copy()  # without the rows in which control was lost"]
    for begin, end in _stretches(np.isnan(runs.measured)):
        lines += [f"y.iloc[{begin}:{end}] = np.nan"]
    return lines


def _stretches(rows: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.r_[False, rows, False].astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _part(name: str, runs: Runs, chosen: tuple[int, ...]) -> tuple[str, list[str]]:
    """The name of X and y of some runs in the script, and the lines that make them."""
    if len(chosen) == runs.n:
        return "X, y", []
    labels = [plain(runs.layout.labels[run]) for run in chosen]
    index = getattr(runs.X, "index", None)
    if index is not None and list(index.names) == ["run", "time"]:
        return f"*{name}", [f"{name} = select_runs(X, y, runs={labels!r})"]
    rows = ", ".join(f"{a}:{b}" for a, b in _stretches(runs.mask(chosen)))
    taken = "X.iloc[rows], y.iloc[rows]" if index is not None else "X[rows], y[rows]"
    return f"*{name}", [f"rows = np.r_[{rows}]", f"{name} = {taken}"]


def plain(label: Any) -> Any:
    """A run label that Python can read back."""
    return label.item() if isinstance(label, np.generic) else label


def _construction(estimator: Any, effects: Effects) -> str:
    """The estimator with its effects as Python."""
    defaults = type(estimator)().get_params(deep=False)
    given = clone(estimator).get_params(deep=False)
    given["effects"] = effects if len(effects) else None
    changed = {
        name: value
        for name, value in given.items()
        if name != "effects" and not _same(value, defaults[name])
    }
    parts = [f"{name}={value!r}" for name, value in changed.items()]
    if len(effects):
        parts += [f"effects={' + '.join(_effect(e) for _, e in effects)}"]
    return f"{type(estimator).__name__}({', '.join(parts)})"


def _effect(effect: Any) -> str:
    defaults = type(effect)().get_params()
    changed = {k: v for k, v in effect.get_params().items() if not _same(v, defaults[k])}
    return f"{type(effect).__name__}({', '.join(f'{k}={v!r}' for k, v in changed.items())})"


def _same(one: Any, other: Any) -> bool:
    return type(one) is type(other) and bool(one == other)
