"""What plots of estimates share: bands, true values, references and limits.

Open it to change how parameters over time are drawn, whether ARX parameters or the operator's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ._axes import limits_of, note_outside
from ._checks import check_some_column
from ._display import Display
from ._roles import GREEN, GREY, ORANGE, PALETTE, ROLES, scaled, veil

SHOWN = (2.0, 98.0)  # percentiles of the estimates that limits always hold
FEW = 20  # estimates, below which limits hold all
MUCH = 2.0  # times the range of these percentiles, up to which limits hold all
MARGIN = 0.12  # of the range, above and below
DEVIATION = "± 1 standard deviation"


@dataclass(kw_only=True, eq=False, repr=False)
class EstimatesDisplay(Display):
    """Estimates in a panel for each parameter, with what is known of them from elsewhere.

    ``frames`` holds, by label, a column and an ``sd_`` column for each parameter, over the index
    ``time`` or in one row (``attrs["deviation"]`` may say of what the latter are); ``truth`` is a
    frame like them, ``references`` a result of reference_fits.
    """

    frames: Mapping[str, pd.DataFrame]
    truth: pd.DataFrame | None = None
    references: pd.DataFrame | None = None
    transition_time: float | None = None

    def _begin(self, columns: list[list[str]], ax: Any) -> None:
        """Panels for the parameters, and nothing in them yet."""
        self.names_ = [name for column in columns for name in column]
        shape = max(map(len, columns)), len(columns)
        self.axes_ = self._take_axes(
            ax,
            f"one for each of {', '.join(self.names_)}",
            shape,
            used=[
                i + shape[1] * row for i, names in enumerate(columns) for row in range(len(names))
            ],
            figsize=(6.4, 0.9 + 1.4 * shape[0]),
            sharex=True,
        )
        self._bottom = self.axes_
        if self._own:
            self.figure_.align_ylabels(self.axes_)
            self._bottom = self.axes_[np.cumsum([len(names) for names in columns]) - 1]
            for panel in self._bottom:
                panel.tick_params(labelbottom=True)
        self.lines_: dict[tuple[str, str], Any] = {}
        self.bands_: dict[tuple[str, str], Any] = {}
        self.truth_: dict[str, Any] = {}
        self.references_: dict[tuple[str, str], Any] = {}
        self.notes_: dict[str, Any] = {}
        if times := times_of(self.frames.values()):
            # All of it and no more, also where a path is NaN at an end.
            first, last = min(t.min() for t in times), max(t.max() for t in times)
            for panel in self.axes_ if first < last else []:
                panel.set_xlim(first, last)

    def _colour(self, position: int) -> str:
        """Colour of an estimate: not those of the truth and, where there are any, of references."""
        taken = {GREEN} if self.references is None else {GREEN, ORANGE}
        available = [c for c in PALETTE if c not in taken]
        return available[position % len(available)]

    def _draw_over_time(self, panel: Any, name: str, position: int, label: str) -> None:
        """A line and its band; a batch model is level over all of the time that others span."""
        table, colour = self.frames[label], self._colour(position)
        time, value, deviation = table.index, table[name].to_numpy(), deviation_of(table, name)
        style = {"ls": "-", "lw": scaled(1.0)}
        if not is_over_time(table):
            times = times_of(self.frames.values())
            time = pd.Index([min(t.min() for t in times), max(t.max() for t in times)])
            value, deviation = np.repeat(value, 2), np.repeat(deviation, 2)
            style["ls"] = "--"
        (self.lines_[label, name],) = panel.plot(time, value, color=colour, label=label, **style)
        if np.isfinite(deviation).any():
            meaning = table.attrs.get("deviation", DEVIATION)
            self.bands_[label, name] = _draw_band(panel, time, value, deviation, colour, meaning)

    def _draw_known(self, panel: Any, name: str) -> None:
        """Truth, references, and the transition in grey."""
        if self.references is not None and name in self.references:
            self._draw_references(panel, name, self.references)
        if self.truth is not None and name in self.truth:
            values = self.truth[name].to_numpy(dtype=float)
            style = {**ROLES["truth"].style(1.4), "label": "truth", "zorder": 2.4}
            if is_over_time(self.truth):
                (self.truth_[name],) = panel.plot(self.truth.index, values, **style)
            else:
                self.truth_[name] = panel.axhline(values[0], **style)
        if self.transition_time is not None:
            style = {
                "color": GREY,
                "lw": scaled(1.2),
                "ls": ":",
                "label": "transition",
                "zorder": 1.5,
            }
            panel.axvline(self.transition_time, **style)

    def _draw_references(self, panel: Any, name: str, references: pd.DataFrame) -> None:
        deviations = deviation_of(references, name)
        label = f"batch {DEVIATION}" if np.isfinite(deviations).any() else "batch"
        for (window, row), deviation in zip(references.iterrows(), deviations, strict=True):
            span, level = [row["start"], row["stop"]], np.repeat(float(row[name]), 2)
            if np.isnan(level[0]):
                continue
            if np.isfinite(deviation):
                _draw_band(panel, span, level, deviation, ORANGE, None).set_zorder(2.2)
            (self.references_[str(window), name],) = panel.plot(
                span,
                level,
                color=ORANGE,
                lw=scaled(2.0),
                solid_capstyle="butt",
                label=label,
                zorder=2.3,
            )

    def _limit(self, panel: Any, name: str, runs: np.ndarray | None = None) -> None:
        """Limits that hold what is known and all but extreme estimates, also of single runs."""
        inner: list[float] = []
        if name in self.truth_ and self.truth is not None:
            inner += self.truth[name].tolist()
        for (_, of), line in self.references_.items():
            inner += [line.get_ydata()[0]] if of == name else []
        inner = [value for value in inner if np.isfinite(value)]
        outer = list(inner)
        tables = [table for table in self.frames.values() if name in table]
        estimates = [table[name].to_numpy(dtype=float) for table in tables]
        deviations = [deviation_of(table, name) for table in tables]
        if runs is not None:
            estimates, deviations = [*estimates, runs], [*deviations, np.zeros(1)]
        for value, deviation in zip(estimates, deviations, strict=True):
            finite, deviation = value[np.isfinite(value)], deviation[np.isfinite(deviation)]
            if finite.size == 0:
                continue
            typical = float(np.median(deviation)) if deviation.size else 0.0
            low, high = typical_range(finite)
            inner += [low - typical, high + typical]
            outer += [finite.min() - typical, finite.max() + typical]
        if not inner:
            return
        low, high = limits_of(inner, outer, MUCH, MARGIN, least=0.0)
        if low < high:
            panel.set_ylim(low, high)
            varying = [is_over_time(table) for table in tables]
            counted = zip(estimates, varying, strict=False)  # of single runs nothing
            shown = np.concatenate([e for e, over_time in counted if over_time or not any(varying)])
            if note := note_outside(panel, shown, ("top", "right")):
                self.notes_[name] = note


def is_over_time(table: pd.DataFrame) -> bool:
    return bool(table.index.name == "time")


def times_of(tables: Iterable[pd.DataFrame]) -> list[np.ndarray]:
    """The instants of those that vary in time."""
    return [table.index.to_numpy(dtype=float) for table in tables if is_over_time(table)]


def deviation_of(table: pd.DataFrame, name: str) -> np.ndarray:
    if f"sd_{name}" not in table:
        return np.full(len(table), np.nan)
    return table[f"sd_{name}"].to_numpy(dtype=float)


def in_one_row(truth: pd.DataFrame) -> pd.DataFrame:
    """True values in one row without a time where they do not vary."""
    if (truth == truth.iloc[0]).all(axis=None):
        return truth[:1].reset_index(drop=True)
    return truth


def typical_range(values: np.ndarray) -> tuple[float, float]:
    """Percentiles that are values themselves: between two, an outlier would pull them."""
    if values.size < FEW:
        return float(values.min()), float(values.max())
    low = np.percentile(values, SHOWN[0], method="higher")
    return float(low), float(np.percentile(values, SHOWN[1], method="lower"))


def check_references(references: Any, names: Sequence[str], *, varying: bool) -> None:
    """Refuse anything but a result of reference_fits, and where no estimate varies in time."""
    if references is None:
        return
    if not isinstance(references, pd.DataFrame):
        raise TypeError(
            f"references is the result of reference_fits; got {type(references).__name__}."
        )
    missing = [name for name in ("start", "stop") if name not in references]
    if missing:
        raise ValueError(
            f"references has no column {missing[0]!r}: each of its rows is an estimate from the "
            "window from start to stop, in s."
        )
    check_some_column(references, names, "references")
    if not varying:
        raise ValueError(
            "references stand at times, and no estimate varies in time: draw batch models among "
            "the estimates."
        )


def _draw_band(
    panel: Any, time: Any, value: np.ndarray, deviation: Any, colour: str, label: str | None
) -> Any:
    edges = (value - deviation, value + deviation)
    return panel.fill_between(time, *edges, color=colour, alpha=veil(0.25), lw=0, label=label)
