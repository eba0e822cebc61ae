"""RowChannels: channels of runs side by side, read from the rows of a table run by run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np


@dataclass(frozen=True, eq=False)
class RowChannels(Mapping[str, np.ndarray]):
    """Channels of runs side by side that are put together when they are asked for.

    ``rows`` gives some rows of each channel, ``begin`` and ``end`` are the first and the last + 1
    of the runs, and ``length`` is the number of samples of the record. ``sums`` are channels that
    are the sum of two others. Of the samples every ``step``-th is taken; 0 takes all, with those
    of a run one after the other. ``given`` are channels with other values. What was ``found`` is
    kept; a part of the runs has its own, and other processes get a plain dict. ``order`` is how
    samples lie in memory: those of very many runs one run after the other, "F".
    """

    rows: Mapping[str, Callable[[slice], np.ndarray]]
    begin: np.ndarray
    end: np.ndarray
    length: int
    sums: Mapping[str, tuple[str, str]]
    step: int = 0
    given: Mapping[str, np.ndarray] = field(default_factory=dict)
    found: dict[str, np.ndarray] = field(default_factory=dict)
    order: Literal["C", "F"] = "F"

    def __iter__(self) -> Iterator[str]:
        yield from dict.fromkeys([*self.rows, *self.sums])

    def __contains__(self, name: object) -> bool:
        return name in self.rows or name in self.sums

    def __len__(self) -> int:
        return len({*self.rows, *self.sums})

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.given and name not in self.found:
            self.found[name] = self.read(name)
        return self.read(name)

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)  # kept, so that joblib writes each once for all workers

    def read(self, name: str) -> np.ndarray:
        """The same, and nothing more is kept."""
        if name in self.given:
            return self.given[name]
        if name in self.found:
            return self.found[name]
        one, *other = self.sums.get(name, (name,))
        out = self._beside(one)
        for more in other:
            out += self._beside(more)
        return np.ascontiguousarray(out[:: self.step]) if self.step else out

    def _beside(self, name: str) -> np.ndarray:
        rows = self.rows[name]
        out = np.zeros((self.length, self.begin.size), order=self.order)
        for j, (a, b) in enumerate(zip(self.begin.tolist(), self.end.tolist(), strict=True)):
            out[: b - a, j] = rows(slice(a, b))
        return out

    def of_runs(self, runs: slice | np.ndarray) -> RowChannels:
        """The channels of some of the runs."""
        given = {name: values[:, runs] for name, values in self.given.items()}
        return replace(self, begin=self.begin[runs], end=self.end[runs], given=given, found={})

    def thinned(self, step: int) -> RowChannels:
        """The channels at every ``step``-th sample."""
        given = {n: np.ascontiguousarray(values[::step]) for n, values in self.given.items()}
        return replace(self, step=max(self.step, 1) * step, given=given, found={})

    def beginning(self, n: int) -> RowChannels:
        """The channels at the first ``n`` samples."""
        length = min(self.length, max((n - 1) * max(self.step, 1) + 1, 0))
        return replace(
            self,
            end=np.minimum(self.end, self.begin + length),
            length=length,
            given={name: values[:n] for name, values in self.given.items()},
            found={},
        )

    def changed(self, channels: Mapping[str, np.ndarray]) -> RowChannels:
        """The same with other values of some channels; it shares what is found of the others."""
        return replace(self, given={**self.given, **channels})
