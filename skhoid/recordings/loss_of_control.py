"""Where control was lost: one rule for the stretches of a run left out of fits and scores.

A person who has lost control no longer responds as before, and a few such seconds outweigh minutes
of tracking. The rule requires several signs at once that valid data never show together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import DT, ROLES, checked
from ..preprocessing.gate import check_numbers, checked_column
from ..runs import RunLayout, read_layout, run_column, run_name
from ..runs.roles import check_named, columns_by_role, is_external, with_error, with_target
from ..text import Note

LEAVE_OUT, KEEP = "leave_out", "keep"
CHOICES = (LEAVE_OUT, KEEP)
WINDOW = 4.0  # s, in most of which the error is large: a spike or a step makes no such window
BLOCK = 0.5  # s; the parts of a window, of which half may be anything
APART = 2  # blocks, at most, from one large one to the next of a stretch
BESIDE = 2  # blocks on either side: it began before it showed, and the person is still recovering
LEAST_SAMPLES = 16  # of a window; slower clocks are not those of somebody who steers
LOST = 3.0  # times the usual error
CALM = 0.25  # of the windows of a run have a smaller error than its calm level
OF_CALM = 2.0  # times that level: what a run usually reaches, at least
ALONE = 4.0  # the same of a run alone, which no other shows to be unusual
LOST_ROWS = "rows without control"  # attribute of an output that is missing there
KEEP_ROWS = 'lost_control="keep" keeps them'  # a hint


@dataclass(frozen=True)
class LostControl:
    """A stretch of a run in which control was lost.

    Parameters
    ----------
    run : int
        Number of the run, from 0.
    label : str
        Its name.
    first, last : int
        Rows of the data, the last one not included.
    begin, end : float
        Time in the run, in s, of the first row and the last.
    times : float
        Largest level of the error, as a multiple of the usual level.
    """

    run: int
    label: str
    first: int
    last: int
    begin: float
    end: float
    times: float

    @property
    def reason(self) -> str:
        """What was found, as part of a sentence."""
        return (
            f"control was lost: for {WINDOW:g} s or more the error is {self.times:.1f} times its "
            "usual size in these runs"
        )


@checked(roles=ROLES, dt=DT)
def lost_control(
    X: Any, *, roles: Mapping[Any, str] | None = None, dt: float | None = None, run: Any = None
) -> pd.DataFrame:
    """Find the stretches of runs in which control was lost.

    :class:`skhoid.EffectSearchCV` and ``skhoid identify`` leave them out of fits and scores, and
    :func:`skhoid.compare` reports them. For other models, set ``y`` to NaN there.

    Parameters
    ----------
    X : DataFrame or array of shape (n_rows, n_columns)
        Channels, one row per sample, with the error ``e``, or ``f_t`` and ``x``.
    roles : dict or None, default=None
        ``{column: role}`` for columns that are not named by their role.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of ``X`` for data without a run index.

    Returns
    -------
    found : DataFrame
        One row per stretch: run, from and to (s in the run), times (largest level of the
        error, as a multiple of the usual one), reason.

    Notes
    -----
    The level of the error at any time is the median of eight rms values, each over half a second:
    it is large only if the error is large for most of 4 s. Control is lost where the level exceeds
    all of

    - 3 times the usual level, which is the median (of the logarithms) of the largest levels of the
      other runs. Where the target or a recorded disturbance is larger in this run, the limit rises
      in proportion. For a single run it is 4 times the run's calm level, which a quarter of its
      windows stay below;
    - 6 times the run's own calm level: a run that is harder as a whole is not lost. Where the
      target is known, its rms may replace the calm level, for a run that was never under control;
    - the rms of the target about its mean, where it is known: doing nothing would be better. For a
      single run the target must be known, and its range counts: no response to a step, however
      slow, has a larger error.

    The stretch lasts as long as the error exceeds the usual level, with 1 s on either side (the
    loss began before it showed, and the person is still recovering from its error), or to the end
    of the run if less than 4 s of control remain. What follows is kept: the person responds as
    before, and a free run is driven by the measured error. A stretch at the start of a run that
    ends in its first half is an initial transient: control that was not there yet cannot be lost.

    The rule does not apply to sampling times above 0.25 s, at which nobody steers.

    Examples
    --------
    >>> from skhoid import lost_control, make_tracking_runs
    >>> X, y = make_tracking_runs(n_runs=3, sampling_rate=50, random_state=0)
    >>> len(lost_control(X))
    0
    >>> X.loc[(2, slice(30.0, 40.0)), "e"] *= 20
    >>> lost_control(X)["run"].tolist()
    ['2']
    """
    return control_in(X, roles=roles, dt=dt, run=run).table


def control_in(
    X: Any, *, roles: Mapping[Any, str] | None = None, dt: float | None = None, run: Any = None
) -> ControlCheck:
    """Ask the rule about the columns of a table; see :func:`lost_control`."""
    layout = read_layout(X, dt=dt, run=run)
    shape = np.shape(X)
    if len(shape) != 2:
        raise ValueError(f"X must be a table of shape (n_rows, n_columns); got the shape {shape}.")
    names = list(X.columns) if hasattr(X, "columns") else list(range(shape[1]))
    check_named(names, roles)
    others = names.copy()
    if run is not None:
        del others[run_column(names, run)]
    channels = {}
    for role, position in columns_by_role(others, roles).items():
        name = others[position]
        given = np.asarray(X[name] if hasattr(X, "columns") else np.asarray(X)[:, name])
        check_numbers(pd.DataFrame({name: given}, copy=False), "X")
        channels[role] = checked_column(given, name)
    judged = None if layout.trimmed is None else ~layout.trimmed
    return control_check(layout, channels, judged)


def notes_of_lost(found: pd.DataFrame) -> list[Note]:
    """What was left out, of a table of stretches, and how to keep it."""
    return [
        Note(
            "lost control",
            f"run {row['run']} from {row['from']:.4g} to {row['to']:.4g} s is left out of fits and "
            f"scores, because {row['reason']}",
            hint=KEEP_ROWS,
            options=["lost_control"],
        )
        for _, row in found.iterrows()
    ]


@dataclass(frozen=True)
class ControlCheck:
    """What the rule saw: stretches in which control was lost, and the largest error anywhere.

    ``run`` is the number of the run with the largest error for what is usual, ``begin`` the time
    (s), and ``times`` how many times; no run has one (-1) where the rule cannot be asked.
    """

    stretches: tuple[LostControl, ...] = ()
    run: int = -1
    begin: float = np.nan
    times: float = np.nan

    def rows(self, n_rows: int) -> np.ndarray:
        """Mark the rows of the stretches."""
        rows = np.zeros(n_rows, dtype=bool)
        for stretch in self.stretches:
            rows[stretch.first : stretch.last] = True
        return rows

    @property
    def table(self) -> pd.DataFrame:
        """The stretches, one row each."""
        rows = [(s.label, s.begin, s.end, s.times, s.reason) for s in self.stretches]
        frame = pd.DataFrame(rows, columns=["run", "from", "to", "times", "reason"])
        return frame.astype({"from": float, "to": float, "times": float})


def control_check(
    layout: RunLayout,
    channels: Mapping[str, np.ndarray],
    judged: np.ndarray | None = None,
) -> ControlCheck:
    """Ask the rule about channels by role; nothing is lost where no error is known.

    ``judged`` are the rows to look at, by default all.
    """
    known = with_error(with_target(dict(channels)))
    if "e" not in known or layout.dt * LEAST_SAMPLES > WINDOW:
        return ControlCheck()
    error = known["e"] if judged is None else np.where(judged, known["e"], np.nan)
    forcing = {role: values for role, values in known.items() if is_external(role)}
    runs = [_RunLevels.of(layout, number, error, forcing) for number in range(len(layout.labels))]
    runs = [of_run for of_run in runs if of_run.level.size and of_run.largest > 0]
    stretches: list[LostControl] = []
    worst = ControlCheck()
    for of_run, usual in zip(runs, _usual_levels(runs), strict=True):
        if not usual > 0:
            continue
        times = of_run.largest / usual
        if not times <= worst.times:
            at = of_run.first[of_run.window[int(of_run.level.argmax())]]
            worst = ControlCheck((), of_run.number, float(layout.time[at]), times)
        stretches += of_run.lost(usual, layout)
    return replace(worst, stretches=tuple(stretches))


@dataclass(frozen=True)
class _RunLevels:
    """Levels of the error of one run, window by window.

    ``first``, ``last`` and ``rms`` are rows and rms error of blocks, ``window`` and ``level`` the
    first block and the level of windows; ``forcing`` has the rms about the mean of the target and
    of each recorded disturbance, by role. ``span`` is the range of the target, infinite where it is
    not known.
    """

    number: int
    first: np.ndarray
    last: np.ndarray
    rms: np.ndarray
    window: np.ndarray
    level: np.ndarray
    forcing: dict[str, float]
    span: float

    @classmethod
    def of(
        cls, layout: RunLayout, number: int, error: np.ndarray, forcing: dict[str, np.ndarray]
    ) -> _RunLevels:
        begin, end = layout.run_starts[number : number + 2]
        size = max(round(BLOCK / layout.dt), 1)
        width = max(round(WINDOW / (size * layout.dt)), 1)
        edges = layout.starts[slice(*np.searchsorted(layout.starts, [begin, end + 1]))]
        first: list[int] = []
        last: list[int] = []
        rms: list[float] = []
        window: list[int] = []
        level: list[float] = []
        for a, b in pairwise(edges):
            n = (b - a) // size
            blocks = error[a : a + n * size].reshape(n, size)
            there = np.isfinite(blocks)
            with np.errstate(invalid="ignore"):
                of_block = np.sqrt(
                    np.sum(np.where(there, blocks, 0.0) ** 2, axis=1) / there.sum(axis=1)
                )
            of_block[2 * there.sum(axis=1) < size] = np.nan
            if n >= width:
                beside = np.lib.stride_tricks.sliding_window_view(of_block, width)
                whole = 2 * np.isfinite(beside).sum(axis=1) > width
                window += (len(rms) + np.flatnonzero(whole)).tolist()
                level += np.nanmedian(beside[whole], axis=1).tolist()
            first += (a + size * np.arange(n)).tolist()
            last += (a + size * np.arange(1, n + 1)).tolist()
            rms += of_block.tolist()
        target = forcing.get("f_t", np.empty(0))[begin:end]
        moved = {
            role: float(np.nanstd(values[begin:end]))
            for role, values in forcing.items()
            if np.isfinite(values[begin:end]).any()
        }
        return cls(
            number,
            np.asarray(first),
            np.asarray(last),
            np.asarray(rms),
            np.asarray(window),
            np.asarray(level),
            moved,
            float(np.ptp(target[np.isfinite(target)])) if np.isfinite(target).any() else np.inf,
        )

    @property
    def target(self) -> float:
        """Rms of the target about its mean; NaN where it is not known, or does not move."""
        return self.forcing.get("f_t", 0.0) or np.nan

    @cached_property
    def largest(self) -> float:
        return float(self.level.max()) if self.level.size else np.nan

    @property
    def calm(self) -> float:
        return float(np.quantile(self.level, CALM))

    def lost(self, usual: float, layout: RunLayout) -> list[LostControl]:
        """Stretches in which control was lost."""
        width = max(round(WINDOW / BLOCK), 1)
        limit = float(np.fmax(LOST * usual, self.target))
        above = self.level > usual
        found: list[LostControl] = []
        edges = np.flatnonzero(np.diff(np.r_[0, above, 0]))
        for begin, end in edges.reshape(-1, 2):
            if not self.level[begin:end].max() > limit:
                continue
            blocks = np.arange(self.window[begin], self.window[end - 1] + width)
            first, last = _around(
                blocks[self.rms[blocks] > limit], blocks[self.rms[blocks] > usual]
            )
            first, last = max(first - BESIDE, 0), min(last + BESIDE, len(self.rms))
            if len(self.rms) - last < width:
                last = len(self.rms)
            if first == 0 and 2 * last <= len(self.rms):
                continue  # a first transient
            found.append(self._stretch(first, last, self.level[begin:end].max() / usual, layout))
        return found

    def _stretch(self, first: int, last: int, times: float, layout: RunLayout) -> LostControl:
        begin = int(self.first[first])
        whole = last == len(self.rms)  # with the rest of the run that fills no block
        end = int(layout.run_starts[self.number + 1] if whole else self.last[last - 1])
        return LostControl(
            run=self.number,
            label=run_name(layout.labels[self.number]),
            first=begin,
            last=end,
            begin=float(layout.time[begin]),
            end=float(layout.time[end - 1]),
            times=float(times),
        )


def _usual_levels(runs: Sequence[_RunLevels]) -> list[float]:
    """The level that the error of each run may usually reach."""
    if len(runs) == 1:
        return [max(ALONE * runs[0].calm, runs[0].span / LOST)]
    roles = {role for of_run in runs for role in of_run.forcing}
    driven = [np.array([of_run.forcing.get(role, 0.0) for of_run in runs]) for role in roles]
    largest = np.array([of_run.largest for of_run in runs])
    found = []
    for number, of_run in enumerate(runs):
        # By how much more this run is driven than each other one, 1 at least.
        harder = np.ones(len(runs))
        for of_role in driven:
            ratio = np.divide(of_role[number], of_role, out=np.ones(len(runs)), where=of_role > 0)
            harder = np.maximum(harder, ratio)
        reached = np.log(np.delete(largest * harder, number))
        own = OF_CALM * np.fmin(of_run.calm, of_run.target)
        found.append(float(max(np.exp(np.median(reached)), own)))
    return found


def _around(core: np.ndarray, large: np.ndarray) -> tuple[int, int]:
    """First and last block, the last not included, of large ones around the core of a stretch."""
    groups = np.split(large, np.flatnonzero(np.diff(large) > APART) + 1)
    inside = [group for group in groups if group[0] <= core[-1] and group[-1] >= core[0]]
    return int(inside[0][0]), int(inside[-1][-1]) + 1
