"""Runs, positions and models of an exploration: what is fitted, to what, and what it predicts.

``Runs`` are the data, a ``Position`` says what a model is made of, ``History`` how one came there,
and ``Models`` fits each once.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ... import OperatorRegressor, SimulatedARX
from ...effects import Effects
from ...effects import effect as effect_of
from ...metrics import scored_rows, vaf_of_rows
from ...pipelines import prediction_from, raw_layout
from ...preprocessing import as_output
from ...regression import units_of
from ...runs import RunLayout, as_frame, output_name, roles_of, run_name
from ...search import control_of, without_output

TRAIN, HOLD, OUT = "train", "hold", "out"
USES = (TRAIN, HOLD, OUT)
WHO = ("subject", "condition")  # levels of the index, each of which is fitted alone
KEPT = 96  # models
FEW = 8  # with parameters moved by hand: of each there are many, one after the other
KEPT_ROWS = 20_000_000  # of predictions
STRUCTURES = {"operator": OperatorRegressor, "arx": SimulatedARX}
OWN = ("effects", "start")  # parameters that no other structure takes over


@dataclass(frozen=True)
class Runs:
    """Data as they were given, and as rows of runs.

    ``y`` is missing where control was lost, in the stretches ``lost`` (run, from and to in s).
    """

    X: Any
    y: Any
    layout: RunLayout
    frame: pd.DataFrame
    measured: np.ndarray
    scored: np.ndarray
    lost: list[tuple[Any, float, float]]
    roles: dict[str, str]

    @classmethod
    def of(cls, estimator: Any, X: Any, y: Any, domain: str | None, lost_control: str) -> Runs:
        layout = raw_layout(estimator, X)
        control = control_of(estimator, X, lost_control, domain)
        kept = without_output(y, control)
        measured = as_output(kept)
        scored = scored_rows(layout, None, None) & ~np.isnan(measured)
        settling = round(float(getattr(estimator, "settling", 0.0)) / layout.dt)
        for a, b in pairwise(layout.run_starts):  # of a short run a quarter, as in its fit
            scored[a : a + min(settling, (b - a) // 4)] = False
        table = control.table
        lost = list(zip(table["run"], table["from"], table["to"], strict=True))
        frame = as_frame(X)
        run = getattr(estimator, "run", None)
        frame = frame.drop(columns=[run]) if run in list(frame.columns) else frame
        roles = roles_of(list(frame.columns), getattr(estimator, "roles", None))
        named = {str(name): role for name, role in roles.items()}
        return cls(X, kept, layout, frame, measured, scored, lost, named)

    @property
    def n(self) -> int:
        return len(self.layout.labels)

    @property
    def labels(self) -> list[str]:
        return [run_name(label) for label in self.layout.labels]

    @property
    def output(self) -> str:
        return output_name(self.y)

    @property
    def units(self) -> dict[str, str]:
        found = {**units_of(self.X), **units_of(self.y)}
        return {str(name): unit for name, unit in found.items()}

    def rows(self, run: int) -> slice:
        """Rows of a run."""
        a, b = self.layout.run_starts[run : run + 2].tolist()
        return slice(a, b)

    def mask(self, runs: tuple[int, ...]) -> np.ndarray:
        """Rows of some runs."""
        chosen = np.zeros(self.n, dtype=bool)
        chosen[list(runs)] = True
        return np.repeat(chosen, np.diff(self.layout.run_starts))

    def part(self, runs: tuple[int, ...]) -> tuple[Any, Any]:
        """X and y of some runs, as they were given."""
        if len(runs) == self.n:
            return self.X, self.y
        rows = self.mask(runs)
        taken = [one[rows] if hasattr(one, "shape") else np.asarray(one)[rows] for one in self.both]
        for new, old in zip(taken, self.both, strict=True):
            if hasattr(old, "attrs"):
                new.attrs = dict(old.attrs)
        return taken[0], taken[1]

    @property
    def both(self) -> tuple[Any, Any]:
        return self.X, self.y

    def people(self) -> list[tuple[str, list[int]]]:
        """People, each in each condition, and the numbers of their runs, if the index says so."""
        index = getattr(self.X, "index", None)
        known = [level for level in WHO if level in getattr(index, "names", ())]
        if index is None or not known:
            return []
        rows = self.layout.run_starts[:-1]
        names = zip(*(index.get_level_values(level)[rows] for level in known), strict=True)
        found: dict[str, list[int]] = {}
        for run, name in enumerate(names):
            found.setdefault(", ".join(map(str, name)), []).append(run)
        return list(found.items())

    def vaf(self, prediction: np.ndarray, runs: tuple[int, ...]) -> float | None:
        """VAF of some runs, as :func:`skhoid.vaf_score` has it, unclipped; None without rows."""
        keep = self.scored & self.mask(runs)
        if not keep.any() or not self.measured[keep].any():
            return None
        value = vaf_of_rows(self.measured, prediction, keep, self.layout, "pooled", False)
        return float(value)

    def vaf_by_run(self, prediction: np.ndarray) -> list[float | None]:
        """VAF of each run; None where nothing counts."""
        if not self.measured[self.scored].any():
            return [None] * self.n
        moves = np.add.reduceat(np.where(self.scored, self.measured**2, 0.0), self.begins) > 0
        keep = self.scored & np.repeat(moves, np.diff(self.layout.run_starts))
        found = vaf_of_rows(self.measured, prediction, keep, self.layout, None, False)
        return [float(v) if known else None for v, known in zip(found, moves, strict=True)]

    @property
    def begins(self) -> np.ndarray:
        """First rows of the runs."""
        return self.layout.run_starts[:-1]

    def rmse(self, prediction: np.ndarray, runs: tuple[int, ...]) -> float | None:
        keep = self.scored & self.mask(runs)
        if not keep.any():
            return None
        error = self.measured[keep] - np.clip(prediction[keep], -1e100, 1e100)
        return float(np.sqrt(np.mean(error**2)))


@dataclass(frozen=True)
class Position:
    """What a model is made of.

    ``uses`` says of each run whether it is fitted, held out or left out; ``effects`` hold numbers
    where a parameter is given; ``moved`` are values of parameters that were moved by hand since the
    fit. ``words`` say how this state came about. ``structure`` has the "core" (operator or arx) and
    its parameters; empty, the model is the estimator that the exploration began with.
    """

    uses: tuple[str, ...]
    effects: Effects
    moved: Mapping[str, float] = field(default_factory=dict)
    words: str = ""
    structure: Mapping[str, Any] = field(default_factory=dict)

    @property
    def train(self) -> tuple[int, ...]:
        return self.of_use(TRAIN)

    @property
    def hold(self) -> tuple[int, ...]:
        return self.of_use(HOLD)

    def of_use(self, use: str) -> tuple[int, ...]:
        """Numbers of the runs of a use."""
        return tuple(i for i, one in enumerate(self.uses) if one == use)

    def with_changes(self, words: str, **changes: Any) -> Position:
        return replace(self, words=words, **changes)

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        return {
            "uses": list(self.uses),
            "effects": pack_effects(self.effects),
            "moved": dict(self.moved),
            "words": self.words,
            "structure": dict(self.structure),
        }

    @classmethod
    def of_dict(cls, given: Mapping[str, Any]) -> Position:
        effects = unpack_effects(given["effects"])
        moved, structure = dict(given["moved"]), dict(given["structure"])
        return cls(tuple(given["uses"]), effects, moved, str(given["words"]), structure)


def pack_effects(effects: Effects) -> list[list[Any]]:
    """Name, id and choices of each effect, for JSON."""
    return [[name, one.name, one.get_params()] for name, one in effects]


def unpack_effects(packed: Iterable[Any]) -> Effects:
    return Effects([(name, effect_of(kind).set_params(**own)) for name, kind, own in packed])


class History:
    """Positions one after the other, and where among them one is."""

    def __init__(self, first: Position):
        self.positions = [first]
        self.at = 0

    @property
    def here(self) -> Position:
        return self.positions[self.at]

    def go(self, position: Position) -> None:
        """A new step; what was undone before it is gone."""
        self.positions = [*self.positions[: self.at + 1], position]
        self.at += 1

    @property
    def undo(self) -> str | None:
        """What would be undone."""
        return self.here.words if self.at else None

    @property
    def redo(self) -> str | None:
        """What would be done again."""
        after = self.positions[self.at + 1 : self.at + 2]
        return after[0].words if after else None

    def step(self, by: int) -> None:
        if not 0 <= self.at + by < len(self.positions):
            raise ValueError(f"There is nothing to {'undo' if by < 0 else 'redo'}.")
        self.at += by

    def as_dict(self) -> dict[str, Any]:
        return {"positions": [one.as_dict() for one in self.positions], "at": self.at}

    @classmethod
    def of_dict(cls, given: Mapping[str, Any]) -> History:
        positions = [Position.of_dict(one) for one in given["positions"]]
        history = cls(positions[0])
        history.positions, history.at = positions, int(given["at"])
        return history


class Kept:
    """Results by key, the oldest of more than so many dropped; each is made once, in any thread."""

    def __init__(self, most: int):
        self.most = most
        self._found: OrderedDict[Any, Any] = OrderedDict()
        self._lock = threading.RLock()

    def of(self, key: Any, make: Callable[[], Any]) -> Any:
        with self._lock:
            if key not in self._found:
                self._found[key] = make()
            self._found.move_to_end(key)
            while len(self._found) > self.most:
                self._found.popitem(last=False)
            return self._found[key]


class Models:
    """Fits an estimator with effects to runs, and predicts.

    ``controller`` is the form of the controller that operators have where they are given none.
    """

    def __init__(
        self, estimator: Any, runs: Runs, given: Iterable[Any] = (), controller: str | None = None
    ):
        self.estimator, self.runs, self.controller = estimator, runs, controller
        uses = (TRAIN,) * runs.n
        self.given = {make_key(Position(uses, Effects.of(one.effects))): one for one in given}
        self._models = Kept(KEPT)
        self._predictions = Kept(max(4, KEPT_ROWS // max(runs.layout.n_rows, 1)))
        self._moved, self._predicted = Kept(FEW), Kept(FEW)

    def estimator_of(self, here: Position) -> Any:
        """The estimator of a position, unfitted.

        All have the settling time of the first, so that all are fitted and scored on the same rows.
        """
        estimator = clone(self.estimator)
        if here.structure:
            own = dict(here.structure)
            made = STRUCTURES[own.pop("core")]()
            known = made.get_params(deep=False).keys() - OWN
            shared = {k: v for k, v in estimator.get_params(deep=False).items() if k in known}
            estimator = made.set_params(**{**shared, **own})
        if isinstance(estimator, OperatorRegressor) and estimator.controller is None:
            estimator.set_params(controller=self.controller)
        return estimator.set_params(effects=here.effects if len(here.effects) else None)

    def fitted(self, here: Position) -> Any:
        """The model of a position, before any parameter was moved."""
        key = make_key(here)
        if key in self.given:
            return self.given[key]
        return self._models.of(key, lambda: self._fit(here))

    def moved(self, here: Position) -> Any:
        """The same with parameters moved by hand, those that it has."""
        own = own_values(here.moved, here.effects)
        if not own:
            return self.fitted(here)
        key = make_key(here), tuple(own.items())
        return self._moved.of(key, lambda: self.fitted(here).with_parameters(own))

    def prediction(self, here: Position) -> np.ndarray:
        """Free run on all runs."""
        own = own_values(here.moved, here.effects)
        key = make_key(here), tuple(own.items())
        kept = self._predicted if own else self._predictions
        model = self.moved(here)
        return kept.of(key, lambda: prediction_from(model, self.runs.X, self.runs.y)[0])

    def _fit(self, here: Position) -> Any:
        if not here.train:
            raise ValueError("No run is left to fit: tick one for training.")
        X, y = self.runs.part(here.train)
        return self.estimator_of(here).fit(X, y)


def make_key(here: Position) -> tuple:
    """By which a model is known again."""
    chosen = tuple((name, type(e), repr(e.get_params())) for name, e in here.effects)
    return chosen, here.train, tuple(here.structure.items())


def name_structure(estimator: Any) -> str:
    """What a model is without its effects: "ARX 2, 2, 9"."""
    if hasattr(estimator, "nk"):
        return f"ARX {estimator.na}, {estimator.nb}, {estimator.nk}"
    if not isinstance(estimator, OperatorRegressor):
        return type(estimator).__name__
    return "operator" if estimator.delay is None else f"operator, delay {estimator.delay:g} s"


def own_values(moved: Mapping[str, float], effects: Effects) -> dict[str, float]:
    """Those of the effects that there are, and of the operator itself."""
    known = effects.names
    return {k: v for k, v in moved.items() if "__" not in k or k.split("__")[0] in known}
