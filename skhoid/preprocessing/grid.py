"""ModelGrid: the rows a model is fitted on, filters to and from it, inputs for simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import fft, signal

from ..runs import DecimationMark, RunLayout

METHODS = ("ideal", "downsample", "aggregate")
PADDINGS = ("odd", "periodic")
_ODD_ROWS = 50  # rows of the thinned grid reflected at each end


def lowpass(values: np.ndarray, stretches: np.ndarray, mark: DecimationMark) -> np.ndarray:
    """Filter columns at full rate before thinning by ``mark.factor``; NaN stay where they are."""
    if mark.method == "downsample":
        return values
    result = np.array(values, dtype=float)
    columns = result if result.ndim == 2 else result[:, None]
    smooth = _brick_wall if mark.method == "ideal" else _block_mean
    for a, b in pairwise(stretches):
        part = columns[a:b]
        missing = np.isnan(part)
        if missing.any():
            part = np.stack([bridged(column) for column in part.T], axis=1)
        part = smooth(part, mark)
        part[missing] = np.nan
        columns[a:b] = part
    return result


def bridged(values: np.ndarray, longest: float = np.inf) -> np.ndarray:
    """Values with straight lines across stretches of NaN of at most so many rows."""
    known = np.flatnonzero(~np.isnan(values))
    if known.size in (0, values.size):
        return values.copy()
    after = np.clip(np.searchsorted(known, np.arange(values.size)), 1, known.size - 1)
    near = known[after] - known[after - 1] <= longest + 1
    lines = np.interp(np.arange(values.size), known, values[known])
    return np.where(near | ~np.isnan(values), lines, np.nan)


def _brick_wall(part: np.ndarray, mark: DecimationMark) -> np.ndarray:
    """Ideal noncausal filter: keep the DFT bins below the new Nyquist frequency."""
    n_rows = len(part)
    margin = 0
    if mark.padding == "odd":
        margin = min(n_rows - 1, _ODD_ROWS * mark.factor)
        part = np.pad(part, ((margin, margin), (0, 0)), mode="reflect", reflect_type="odd")
    spectrum = fft.rfft(part, axis=0)
    bins = np.arange(len(spectrum))
    spectrum[2 * mark.factor * bins >= len(part)] = 0.0
    smooth = fft.irfft(spectrum, n=len(part), axis=0)
    return smooth[margin : margin + n_rows]


def _block_mean(part: np.ndarray, mark: DecimationMark) -> np.ndarray:
    """Piecewise aggregate: the mean of a row and the rows up to the next kept one."""
    n_rows = len(part)
    level = part.mean(axis=0)
    total = np.vstack([np.zeros((1, part.shape[1])), np.cumsum(part - level, axis=0)])
    stop = np.minimum(np.arange(n_rows) + mark.factor, n_rows)
    count = (stop - np.arange(n_rows))[:, None]
    return level + (total[stop] - total[:n_rows]) / count


@lru_cache(maxsize=16)
def _resampling_filter(up: int) -> np.ndarray:
    """The filter that resample_poly would design anew at every call."""
    return signal.firwin(20 * up + 1, 1 / up, window=("kaiser", 5.0))


def to_full_rate(
    values: np.ndarray,
    kept: np.ndarray,
    stretches: np.ndarray,
    mark: DecimationMark,
    wanted_rows: np.ndarray | None = None,
) -> np.ndarray:
    """Interpolate kept-row values back to every row, band-limited (windowed sinc).

    Rows before the first and after the last kept row of a stretch are extrapolated by odd
    reflection. A block mean belongs to the middle of its block. Stretches without any of
    ``wanted_rows`` (a mask) are left at zero.
    """
    n_rows = int(stretches[-1])
    result = np.zeros(n_rows)
    offset = (mark.factor - 1) / 2 if mark.method == "aggregate" else 0.0
    finer = 1 if offset == int(offset) else 2
    up = mark.factor * finer
    bounds = np.searchsorted(kept, stretches)
    for a, b, i, j in zip(stretches[:-1], stretches[1:], bounds[:-1], bounds[1:], strict=True):
        if i == j or (wanted_rows is not None and not wanted_rows[a:b].any()):
            continue
        part = values[i:j]
        wanted = (np.arange(a, b) - kept[i] - offset) * finer
        if len(part) == 1:
            result[a:b] = part[0]
            continue
        margin = _ODD_ROWS // 2
        padded = np.pad(part, margin, mode="reflect", reflect_type="odd")
        fine = signal.resample_poly(padded, up, 1, window=_resampling_filter(up))
        result[a:b] = fine[(wanted + margin * up).astype(np.int64)]
    return result


BLOCK = 100_000  # values, or rows of a channel


class HeldInputs:
    """Columns on a grid, in which NaN hold the last value, and are zero before the first.

    Rows are read when they are asked for, by a slice or by their numbers: a table of single
    precision, or one that lies in a file, is never copied whole. ``stretches`` are first rows and
    last rows + 1 of what belongs together.
    """

    def __init__(
        self,
        values: np.ndarray,
        columns: Sequence[int],
        stretches: Sequence[tuple[int, int]],
    ) -> None:
        self.values, self.columns = values, list(columns)
        self.shape = (len(values), len(self.columns))
        begin, end = np.array(stretches).reshape(-1, 2).T
        found: dict[int, list[np.ndarray]] = {}
        block = max(1, BLOCK // max(values.shape[1], 1))
        for a in range(0, len(values), block):
            missing = np.isnan(values[a : a + block])[:, self.columns]
            for i in np.flatnonzero(missing.any(axis=0)).tolist():
                found.setdefault(i, []).append(a + np.flatnonzero(missing[:, i]))
        self.gaps = {i: _Gaps.of(np.concatenate(rows), begin, end) for i, rows in found.items()}

    def __getitem__(self, rows: Any) -> np.ndarray:
        columns = [self.column(i, rows) for i in range(self.shape[1])]
        return np.stack(columns, axis=-1, dtype=np.float64)

    def column(self, position: int, rows: Any) -> np.ndarray:
        """Values of one of the columns, in its precision; maybe a view."""
        column = self.columns[position]
        found = self.values[rows, column]
        if position in self.gaps:
            found = found.copy()
            missing, last, _ = self.gaps[position]
            holes = np.flatnonzero(np.isnan(found))
            if isinstance(rows, slice):
                rows = np.arange(*rows.indices(len(self.values)))
            before = last[np.searchsorted(missing, rows[holes])]
            found[holes] = np.where(before >= 0, self.values[before, column], 0.0)
        return found


class _Gaps(NamedTuple):
    """Rows of a column that are NaN, the last row before each that is not (or -1), and what counts.

    Rows before the first value only lack a past (DelayShift), unless none ever comes.
    """

    rows: np.ndarray
    last: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(cls, rows: np.ndarray, begin: np.ndarray, end: np.ndarray) -> _Gaps:
        stretch = np.searchsorted(begin, rows, side="right") - 1
        first = rows == begin[stretch]
        opens = np.flatnonzero(first | (np.diff(rows, prepend=-2) > 1))
        last = np.where(first, -1, rows - 1)[opens]
        last = np.repeat(last, np.diff(opens, append=rows.size))
        never = np.bincount(stretch, minlength=begin.size) == end - begin
        return cls(rows, last, (last >= 0) | never[stretch])


@dataclass(frozen=True)
class ModelGrid:
    """Stretches of the model's own sampling grid.

    ``begin`` and ``end`` are offsets into the grid rows; ``past`` is the first grid row of the
    same segment, from which inputs are known; ``measured`` is False in the run-in.
    """

    layout: RunLayout
    dt: float
    rows: np.ndarray | None
    begin: np.ndarray
    end: np.ndarray
    past: np.ndarray
    measured: np.ndarray

    @classmethod
    def of(cls, layout: RunLayout) -> ModelGrid:
        stretches = layout.stretches
        segment = layout.starts[np.searchsorted(layout.starts, stretches[:-1], side="right") - 1]
        trimmed = layout.trimmed
        measured = (
            np.ones(stretches.size - 1, dtype=bool)
            if trimmed is None
            else ~trimmed[np.minimum(stretches[:-1], max(layout.n_rows - 1, 0))]
        )
        if layout.mark is None or layout.kept is None:
            return cls(layout, layout.dt, None, stretches[:-1], stretches[1:], segment, measured)
        rows = np.flatnonzero(layout.kept)
        bounds = np.searchsorted(rows, stretches)
        some = bounds[1:] > bounds[:-1]
        return cls(
            layout,
            layout.dt * layout.mark.factor,
            rows,
            bounds[:-1][some],
            bounds[1:][some],
            np.searchsorted(rows, segment)[some],
            measured[some],
        )

    @property
    def n_rows(self) -> int:
        return self.layout.n_rows if self.rows is None else self.rows.size

    def thin_inputs(self, X: np.ndarray) -> np.ndarray:
        """Kept rows of inputs, which the Decimator has filtered already."""
        return X if self.rows is None else X[self.rows]

    def thin_output(self, y: np.ndarray) -> np.ndarray:
        """Filter and thin an output as the Decimator did the inputs."""
        if self.rows is None or self.layout.mark is None:
            return y
        return lowpass(y, self.layout.stretches, self.layout.mark)[self.rows]

    def to_full_rate(self, values: np.ndarray, wanted: np.ndarray | None = None) -> np.ndarray:
        """Bring values on the grid back to every row, or to the stretches of ``wanted`` rows."""
        if self.rows is None or self.layout.mark is None:
            return values
        return to_full_rate(values, self.rows, self.layout.stretches, self.layout.mark, wanted)

    def full_row(self, grid_row: int) -> int:
        return grid_row if self.rows is None else int(self.rows[grid_row])
