"""RowChannels: channels of very many runs, read from the rows of a table run by run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np


class RowChannels(Mapping[str, np.ndarray]):
    """Channels of runs side by side that are put together when they are asked for.

    ``rows`` gives some rows of each channel, ``begin`` and ``end`` are the first and the last + 1
    of the runs, and ``length`` is the number of samples of the record. ``sums`` are channels that
    are the sum of two others. What was asked for is kept; a part of the runs has its own.
    """

    def __init__(
        self,
        rows: Mapping[str, Callable[[slice], np.ndarray]],
        begin: np.ndarray,
        end: np.ndarray,
        length: int,
        sums: Mapping[str, tuple[str, str]],
    ) -> None:
        self._rows, self._sums = rows, sums
        self._begin, self._end, self._length = begin, end, length
        self._found: dict[str, np.ndarray] = {}

    def __iter__(self) -> Iterator[str]:
        yield from dict.fromkeys([*self._rows, *self._sums])

    def __contains__(self, name: object) -> bool:
        return name in self._rows or name in self._sums

    def __len__(self) -> int:
        return len({*self._rows, *self._sums})

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._found:
            self._found[name] = self.read(name)
        return self._found[name]

    def read(self, name: str) -> np.ndarray:
        """The same, and nothing is kept of it."""
        if name in self._sums:
            one, other = self._sums[name]
            return self.read(one) + self.read(other)
        rows = self._rows[name]
        out = np.zeros((self._length, self._begin.size), order="F")
        for j, (a, b) in enumerate(zip(self._begin.tolist(), self._end.tolist(), strict=True)):
            out[: b - a, j] = rows(slice(a, b))
        return out

    def of_runs(self, runs: slice | np.ndarray) -> RowChannels:
        """The channels of some of the runs."""
        begin, end = self._begin[runs], self._end[runs]
        return RowChannels(self._rows, begin, end, self._length, self._sums)
