"""Excited lines, and windows of runs in which they are bins of the Fourier transform."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..metrics import scored_rows
from ..preprocessing.gate import as_table, check_numbers
from ..runs import RunLayout, read_layout

BIN_TOLERANCE = 0.01  # of a bin; so far off, one percent of a line leaks into its neighbours


@dataclass(frozen=True)
class Lines:
    """Excited frequencies (rad/s) of one forcing function, and its base period (s) if known."""

    omega: np.ndarray
    period: float | None

    @classmethod
    def of(cls, forcing: Any, period: float | None) -> Lines:
        if period is None:
            period = getattr(forcing, "period", None)
        try:
            omega = np.atleast_1d(np.asarray(getattr(forcing, "omega", forcing), dtype=float))
        except (TypeError, ValueError):  # no numbers
            omega = np.array([])
        if omega.ndim != 1 or omega.size == 0 or not np.all(np.isfinite(omega) & (omega > 0)):
            raise ValueError(
                "forcing must be a Multisine, its frequencies in rad/s (positive numbers), or a "
                f"dict of these; got {forcing!r}."
            )
        if period is not None and not period > 0:
            raise ValueError(f"period must be the base period in seconds; got {period!r}.")
        return cls(np.sort(omega), period)

    def off(self, n_samples: Any, dt: float) -> np.ndarray:
        """Distance in bins of the worst line from a whole number of periods, by window length."""
        base = [] if self.period is None else [2 * np.pi / self.period]
        cycles = np.outer(np.asarray(n_samples) * dt, [*self.omega, *base]) / (2 * np.pi)
        return np.where(cycles < 0.5, 1.0, np.abs(cycles - np.round(cycles))).max(axis=1)

    def bins(self, n_samples: int, dt: float, run: Any, n_in_run: int) -> np.ndarray:
        """Bin of each line in a window, in which it must complete whole periods."""
        cycles = self.omega * n_samples * dt / (2 * np.pi)
        off = np.abs(cycles - np.round(cycles))
        if self.off([n_samples], dt)[0] > BIN_TOLERANCE:
            worst = int(np.argmax(np.where(cycles < 0.5, 1.0, off)))
            what = (
                f"the line at {self.omega[worst]:.6g} rad/s completes {cycles[worst]:.4g} periods "
                f"({off[worst]:.2g} bins off a whole number; at most {BIN_TOLERANCE:g} is allowed)"
            )
            if off[worst] <= BIN_TOLERANCE and cycles[worst] > 0.5:
                what = f"the base period of {self.period:g} s does not fit a whole number of times"
            raise ValueError(
                f"Every line needs a whole number of periods in the window, but in {n_samples} "
                f"samples ({n_samples * dt:.6g} s) of run {run!r} {what}. "
                + self._advice(n_in_run, dt)
            )
        if self.omega[-1] * dt >= np.pi:
            raise ValueError(
                f"The line at {self.omega[-1]:.6g} rad/s is not below the Nyquist frequency of "
                f"{np.pi / dt:.6g} rad/s (dt = {dt:g} s). Are the frequencies in rad/s?"
            )
        return np.round(cycles).astype(int)

    def _advice(self, n_in_run: int, dt: float) -> str:
        lengths = np.arange(n_in_run, 0, -1)
        off = self.off(lengths, dt)
        fitting = np.flatnonzero(off <= BIN_TOLERANCE)
        if fitting.size == 0:
            return (
                f"No window fits in the run's {n_in_run * dt:.6g} s: are the frequencies in rad/s, "
                "and is the run at least one base period long?"
            )
        # Lengths a sample or two off the right one are within the tolerance too.
        beside = fitting[fitting - np.arange(fitting.size) == fitting[0]]
        best = lengths[beside[np.argmin(off[beside])]]
        return (
            f"The longest window in the run that fits lasts {best * dt:.6g} s ({best} "
            f"samples): pass window=(start, start + {best * dt:.6g})."
        )


def read_lines(forcing: Any, period: float | None = None) -> dict[str | None, Lines]:
    """Lines of every forcing function; the only one has no name."""
    if not isinstance(forcing, dict):
        return {None: Lines.of(forcing, period)}
    if not forcing:
        raise ValueError("forcing is an empty dict; give at least one forcing function.")
    return {name: Lines.of(part, period) for name, part in forcing.items()}


def all_bins(lines: dict[Any, Lines], windows: Windows, number: int) -> dict[Any, np.ndarray]:
    """Bins of every forcing function in the window of a run; none is shared."""
    layout, rows = windows.layout, windows.rows[number]
    n_in_run = int(layout.run_starts[number + 1] - layout.run_starts[number])
    window = (rows.stop - rows.start, layout.dt, layout.labels[number], n_in_run)
    owner: dict[int, Any] = {}
    found = {}
    for name, part in lines.items():
        found[name] = part.bins(*window)
        for position, bin_number in enumerate(found[name].tolist()):
            if bin_number in owner:
                other = owner[bin_number]
                which = "is given twice" if other == name else f"is also in {other!r}"
                raise ValueError(
                    f"The line at {part.omega[position]:.6g} rad/s of the forcing function "
                    f"{'' if name is None else repr(name) + ' '}{which}. Lines must differ: "
                    "responses to two functions at the same line cannot be separated."
                )
            owner[bin_number] = name
    return found


def signal_table(X: Any) -> pd.DataFrame:
    X = X if isinstance(X, pd.Series) else as_table(X)
    if isinstance(X, pd.DataFrame):
        return X
    if isinstance(X, pd.Series):
        return X.to_frame("signal" if X.name is None else X.name)
    values = np.asarray(X)
    if not values.size or values.ndim > 2:
        raise ValueError(
            "X must be a table of shape (n_rows, n_channels), with at least one of each; got the "
            f"shape {values.shape}."
        )
    return pd.DataFrame(values[:, None] if values.ndim == 1 else values)


@dataclass(frozen=True)
class Windows:
    """Gapless windows of runs: rows of a table, one window per run."""

    layout: RunLayout
    rows: list[slice]

    @classmethod
    def of(cls, X: pd.DataFrame, window: Any, dt: float | None, run: Any) -> Windows:
        layout = read_layout(X, dt=dt, run=run)
        if layout.mark is not None:
            raise ValueError(
                "X comes from a Decimator, which filtered X but not y. Pass the recording itself: "
                "Fourier coefficients need no decimation."
            )
        inside = scored_rows(layout, None, window)
        rows = []
        for label, a, b in zip(
            layout.labels, layout.run_starts[:-1], layout.run_starts[1:], strict=True
        ):
            kept = a + np.flatnonzero(inside[a:b])
            if kept.size == 0:
                raise ValueError(
                    f"Run {label!r}, from {layout.time[a]:.6g} to {layout.time[b - 1]:.6g} s, has "
                    f"no row in the window {window} s."
                )
            first, last = int(kept[0]), int(kept[-1])
            gaps = layout.starts[(layout.starts > first) & (layout.starts <= last)]
            if gaps.size or kept.size < last - first + 1:
                row = int(gaps[0] if gaps.size else kept[np.argmax(np.diff(kept) > 1) + 1])
                raise ValueError(
                    f"A gap ends at {layout.where(row)}; a Fourier transform needs a window "
                    "without gaps. Choose one before or after it with window=(start, end)."
                )
            rows.append(slice(first, last + 1))
        return cls(layout, rows)

    def numbers(self, table: pd.DataFrame) -> np.ndarray:
        """Values of a table, finite inside the windows."""
        check_numbers(table, "X")
        values = table.to_numpy(dtype=float)
        for rows in self.rows:
            bad = np.argwhere(~np.isfinite(values[rows]))
            if bad.size:
                row, column = bad[0]
                raise ValueError(
                    f"{table.columns[column]!r} is {values[rows][row, column]} in "
                    f"{self.layout.where(rows.start + int(row))}; a Fourier transform needs every "
                    "sample in its window. Leave the run out, or choose another window."
                )
        return values
