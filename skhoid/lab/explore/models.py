"""Models of an exploration, fitted once for each set of effects and runs, and what they predict."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from sklearn.base import clone

from ...effects.composition import Effects
from .runs_kept import Runs

KEPT = 96  # models
FEW = 8  # with parameters moved by hand: of each there are many, one after the other
KEPT_ROWS = 20_000_000  # of predictions


class Kept:
    """Results by key, the oldest of more than so many dropped; each is made once, in any thread."""

    def __init__(self, most: int):
        self.most = most
        self._found: OrderedDict[Any, Any] = OrderedDict()
        self._lock = threading.Lock()
        self._busy: dict[Any, threading.Lock] = {}

    def of(self, key: Any, make: Callable[[], Any]) -> Any:
        with self._lock:
            own = self._busy.setdefault(key, threading.Lock())
        with own:
            with self._lock:
                if key in self._found:
                    self._found.move_to_end(key)
                    return self._found[key]
            made = make()
            with self._lock:
                self._found[key] = made
                self._busy.pop(key, None)
                while len(self._found) > self.most:
                    self._found.popitem(last=False)
            return made


class Models:
    """Fits an estimator with effects to runs, and predicts."""

    def __init__(self, estimator: Any, runs: Runs, given: Iterable[Any] = ()):
        self.estimator, self.runs = estimator, runs
        everything = tuple(range(runs.n))
        self.given = {key_of(Effects.of(one.effects), everything): one for one in given}
        self._models = Kept(KEPT)
        self._predictions = Kept(max(4, KEPT_ROWS // max(runs.layout.n_rows, 1)))
        self._moved, self._predicted, self._read = Kept(FEW), Kept(FEW), Kept(FEW)

    def fitted(self, effects: Effects, train: tuple[int, ...]) -> Any:
        """The estimator with these effects, fitted to these runs."""
        key = key_of(effects, train)
        if key in self.given:
            return self.given[key]
        return self._models.of(key, lambda: self._fit(effects, train))

    def moved(self, effects: Effects, train: tuple[int, ...], moved: Mapping[str, float]) -> Any:
        """The same with parameters moved by hand, those that it has."""
        own = own_values(moved, effects)
        if not own:
            return self.fitted(effects, train)
        key = key_of(effects, train), tuple(own.items())
        return self._moved.of(key, lambda: self.fitted(effects, train).with_parameters(own))

    def prediction(
        self, effects: Effects, train: tuple[int, ...], moved: Mapping[str, float]
    ) -> np.ndarray:
        """Free run on all runs."""
        own = own_values(moved, effects)
        key = key_of(effects, train), tuple(own.items())
        kept = self._predicted if own else self._predictions
        model = self.moved(effects, train, own)
        read = self._read.of(key[0], lambda: model._read_to_compare(self.runs.X, self.runs.y))
        return kept.of(key, lambda: model._prediction_of(*read))

    def _fit(self, effects: Effects, train: tuple[int, ...]) -> Any:
        if not train:
            raise ValueError("No run is left to fit: tick one for training.")
        model = clone(self.estimator).set_params(effects=effects if len(effects) else None)
        X, y = self.runs.part(train)
        return model.fit(X, y)


def key_of(effects: Effects, train: tuple[int, ...]) -> tuple:
    """By which a model is known again."""
    chosen = tuple((name, type(e), repr(e.get_params())) for name, e in effects)
    return chosen, train


def own_values(moved: Mapping[str, float], effects: Effects) -> dict[str, float]:
    """Those of the effects that there are."""
    return {name: v for name, v in moved.items() if name.split("__")[0] in effects.names}
