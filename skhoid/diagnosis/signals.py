"""Measured and predicted signals of runs, and what in them is caused from outside the loop."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from scipy import fft
from scipy.signal.windows import tukey
from sklearn.utils.validation import check_consistent_length

from .._sklearn import safe_indexing
from ..exceptions import MissingDataWarning, ShortRunError
from ..metrics import scored_rows, scored_signals, warn_of_unscored
from ..pipelines import (
    by_likelihood,
    prediction_from,
    raw_layout,
    reach_model,
    taken_apart,
    trimmed_rows,
)
from ..preprocessing.base import as_fitted
from ..preprocessing.gate import (
    as_output,
    as_table,
    check_not_too_small,
    check_numbers,
    checked_column,
)
from ..recordings.loss_of_control import LOST_ROWS, ControlCheck, control_check
from ..regression import units_of
from ..runs import RunLayout, check_alignment, output_name, run_column, run_name
from ..runs.roles import check_named, columns_by_role, is_external, with_target
from ..text import Note, counted
from .repeats import BY_TARGET, Group, grouped

SETTLED = 0.01  # of the rms prediction; what two starts differ by when the first is forgotten
LONGEST_SETTLING = 10.0  # s
MOST_MASKED = 0.05  # of the rows that are bridged; more are cut off, and whole periods with them
RAMPS = 0.04  # of a run, both ends together
FARTHEST = 1e50  # of a free run that goes astray: its fourth power is still a number
LEAST_ROWS = 64  # of a run, for spectra and tests
OUTPUTS = ("y", "predicted", "residual")
LIKELIEST = Note(
    "two estimates",
    "the model is judged by its parameters_, the likeliest: predict and score simulate with those "
    "of least simulation error, which follow remnant that went round the loop, too",
)


@dataclass(frozen=True)
class Signals:
    """What a model predicts and what was measured, row by row.

    ``predicted`` is the free run where it has settled, and the measurement before; ``scored`` are
    rows measured, outside a run-in (``judged``) and settled. ``growth`` is that of a free run by
    itself, over the longest run.
    """

    model: Any
    layout: RunLayout
    index: pd.Index
    y: np.ndarray
    free_run: np.ndarray
    predicted: np.ndarray
    one_step: np.ndarray
    scored: np.ndarray
    channels: dict[str, np.ndarray]
    groups: list[Group]
    output: str
    units: dict[str, str]
    notes: list[Note]
    lost_alone: bool = False  # the output is missing where control was lost, and nowhere else
    decided: Note = BY_TARGET
    judged: np.ndarray | None = None
    growth: float = -np.inf

    @cached_property
    def residual(self) -> np.ndarray:
        return self.y - self.predicted

    def tapered(self, rows: np.ndarray, *signals: np.ndarray) -> np.ndarray:
        """Signals as columns that begin and end at zero, and are zero where not scored."""
        known = np.flatnonzero(self.scored[rows])
        weight = np.zeros(rows.size)
        if known.size:
            first, last = known[0], known[-1] + 1
            weight[first:last] = tukey(last - first, RAMPS) * self.scored[rows[first:last]]
        return np.column_stack(signals) * weight[:, None]

    @property
    def dt(self) -> float:
        return self.layout.dt

    @property
    def external(self) -> list[str]:
        """Signals that come from outside the loop."""
        return [role for role in self.channels if is_external(role)]

    @cached_property
    def control(self) -> ControlCheck:
        """Where control was lost, in rows outside a run-in."""
        return control_check(self.layout, self.channels, self.judged)

    @property
    def driving(self) -> str | None:
        """The signal that the operator answers: the error, or the target where there is none."""
        return next((name for name in ("e", "f_t") if name in self.channels), None)

    def named(self, name: str) -> np.ndarray:
        """Output ``y``, ``predicted`` or ``residual``, or the channel of a role."""
        return getattr(self, name) if name in OUTPUTS else self.channels[name]

    @cached_property
    def target_responses(self) -> dict[int, TargetResponse]:
        """Responses to the target of runs that repeat no other, by number."""
        names = [*OUTPUTS, *(["e"] if self.driving == "e" else [])]
        return {
            int(group.runs[0]): TargetResponse.of(
                self.channels["f_t"][group.rows[0]],
                {name: self.named(name)[group.rows[0]] for name in names},
                self.dt,
            )
            for group in self.groups
            if group.n_runs == 1 and group.lines is None
        }

    def run_label(self, number: int) -> str:
        return run_name(self.layout.labels[number])


@dataclass(frozen=True)
class RunsRead:
    """Runs and a model's free run of them as they come, row by row."""

    model: Any
    layout: RunLayout
    index: pd.Index
    measured: np.ndarray
    free_run: np.ndarray
    trimmed: np.ndarray
    columns: Mapping[Any, Any]
    roles: Mapping[Any, str] | None
    output: str
    units: dict[str, str]
    lost: int = 0


def read_signals(
    model: Any,
    X: Any,
    y: Any,
    *,
    repeats: Any = None,
    roles: Mapping[Any, str] | None = None,
    run_in: float | None = None,
    dt: float | None = None,
    run: Any = None,
    one_step: bool = True,
) -> Signals:
    """Predict, and find the rows to score, the channels by role, and the repeats."""
    X = as_table(X)
    measured = as_output(y)
    check_not_too_small(measured, "y")
    check_consistent_length(X, y)
    check_alignment(X, y)
    given, model = model, by_likelihood(model)
    layout = raw_layout(model, X, dt=dt, run=run)
    predicted, fed = prediction_from(model, X, y)
    predicted = np.clip(predicted, -FARTHEST, FARTHEST)
    if predicted.size != measured.size:
        raise ValueError(
            f"model.predict(X) returns {predicted.size} values for the {measured.size} rows of X; "
            "compare needs one for each row."
        )
    trimmed = trimmed_rows(model, X) | ~fed
    warn_of_unscored(layout, measured, ~trimmed)
    if roles is None:
        roles = getattr(as_fitted(reach_model(model, X)[0]), "roles", None)
    read = RunsRead(
        model=model,
        layout=layout,
        index=X.index if isinstance(X, pd.DataFrame) else pd.RangeIndex(layout.n_rows),
        measured=measured,
        free_run=predicted,
        trimmed=trimmed,
        columns=_columns(X),
        roles=roles,
        output=output_name(y),
        units={**units_of(X), **units_of(y)},
        lost=int(getattr(y, "attrs", {}).get(LOST_ROWS, 0)),
    )
    signals = prepare_signals(
        read,
        run_in=run_in,
        settling=lambda: _settling_rows(model, X, layout, trimmed, predicted),
        repeats=repeats,
        run=run,
    )
    if taken_apart(given)[1] is not taken_apart(model)[1]:
        signals.notes.append(LIKELIEST)
    signals = replace(signals, growth=find_growth(model, X))
    return replace(signals, one_step=_one_step(model, X, y)) if one_step else signals


def _tell_missing(n_missing: int, lost: int) -> str:
    """Which rows have no output; of ``lost`` ones it was left out, as control was lost."""
    parts = [(lost, "control was lost"), (n_missing - lost, "the output is missing")]
    told = [f"{counted(n, 'row')} in which {why}" for n, why in parts if n > 0]
    return f"{' and '.join(told)} {'is' if n_missing == 1 else 'are'} left out"


def prepare_signals(
    read: RunsRead,
    *,
    run_in: float | None,
    settling: Callable[[], tuple[np.ndarray, bool]] | None = None,
    repeats: Any = None,
    run: Any = None,
) -> Signals:
    """Find the rows to score, the channels by role, and the repeats."""
    layout, measured, predicted = read.layout, read.measured, read.free_run
    used = scored_rows(layout, run_in, None) & ~read.trimmed
    scored_signals(measured, predicted, used, layout, False)  # for its checks
    missing = np.isnan(measured)
    channels = _channels(read.columns, read.roles, run)
    notes: list[Note] = []
    judged, scored = used, used & ~missing
    if missing[used].mean() <= MOST_MASKED:
        # A few missing values do not cut a run: there is no residual in them.
        measured = np.where(missing, predicted, measured) if missing.any() else measured
    else:
        used = scored
    if run_in is None and settling is not None:
        unsettled, settles = settling()
        if unsettled.any() and (scored & ~unsettled).any():
            scored = scored & ~unsettled
            if unsettled.mean() > MOST_MASKED:
                used = scored
            longest = max(np.diff(np.flatnonzero(np.diff(np.r_[0, unsettled, 0])))[::2])
            notes.append(
                Note(
                    "settling",
                    f"the first {longest * layout.dt:.3g} s of each run, in which the free run "
                    "settles from its start at rest, are left out",
                    hint="run_in=0 keeps them",
                    options=["run_in"],
                )
            )
            if not settles:
                notes.append(
                    Note(
                        "unsettled",
                        "the free run still shows its start at rest after that, which affects all "
                        "figures",
                        hint="give a longer run_in",
                        options=["run_in"],
                    )
                )
            # Spectra and tests go over whole periods of the target; nothing is missing there.
            predicted = np.where(used & unsettled, measured, predicted)
    if missing.any():
        notes.append(Note("missing output", _tell_missing(int(missing.sum()), read.lost)))
    stretches = _longest_stretches(layout, used, channels)
    if not stretches:
        raise ShortRunError(
            f"No run has {LEAST_ROWS} successive rows ({LEAST_ROWS * layout.dt:.3g} s) in which "
            "the output and all channels with a role were measured, and compare needs as many for "
            "spectra and tests. Join pieces of a recording, interpolate single missing values, "
            "leave out the channel that is missing, or give a shorter run_in."
        )
    covered = sum(stop - start for start, stop in stretches.values())
    beside = int(used.sum()) - covered
    if beside:
        notes.append(
            Note(
                "gaps",
                f"outside the longest gapless stretch of each run, {counted(beside, 'row')} "
                "counted in the VAF are left out of spectra and tests",
            )
        )
    mean, sd = (float(f(measured[scored])) for f in (np.mean, np.std))
    if abs(mean) > sd:
        notes.append(
            Note(
                "mean",
                f"the mean of the output ({mean:.4g}) is larger than its spread ({sd:.4g}), and "
                "VAF counts it as explained: subtract the means of X and y for a VAF about the "
                "mean",
            )
        )
    groups, decided, more = grouped(layout, stretches, measured, channels, repeats)
    return Signals(
        model=read.model,
        layout=layout,
        index=read.index,
        y=measured,
        free_run=read.free_run,
        predicted=predicted,
        one_step=np.full(layout.n_rows, np.nan),
        scored=scored,
        channels=channels,
        groups=groups,
        output=read.output,
        units=_units_by_role(read),
        notes=notes + more,
        decided=decided,
        lost_alone=0 < read.lost == int(missing.sum()),
        judged=judged,
    )


def _units_by_role(read: RunsRead) -> dict[str, str]:
    """Units by the names of columns, and by those of the roles that they are given."""
    given = read.roles or {}
    return {
        **read.units,
        **{role: read.units[str(c)] for c, role in given.items() if str(c) in read.units},
    }


def _settling_rows(
    model: Any, X: Any, layout: RunLayout, trimmed: np.ndarray, predicted: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Rows in which the prediction still depends on where it started, and whether it settles.

    The same rows are predicted again from a later start, until both predictions agree.
    """
    settling = np.zeros(layout.n_rows, dtype=bool)
    starts = np.union1d(
        layout.stretches[:-1], np.flatnonzero(trimmed[:-1] & ~trimmed[1:]) + 1
    ).astype(int)
    lengths = np.diff(np.append(starts, layout.n_rows))
    longest = int(np.argmax(lengths))
    first, n = int(starts[longest]), int(lengths[longest])
    cut = min(n // 4, round(LONGEST_SETTLING / layout.dt))
    if cut < 4:
        return settling, True
    rows = np.arange(first + cut, first + min(3 * cut, n))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # predict has said so
        again = np.asarray(model.predict(safe_indexing(X, rows)), dtype=float).ravel()
    apart = np.abs(again - predicted[rows])
    rms = float(np.sqrt(np.mean(predicted[rows] ** 2)))
    late = np.flatnonzero(apart > SETTLED * rms)
    n_settling = min(int(late[-1]) + 1 if late.size else 0, cut)
    for start, length in zip(starts, lengths, strict=True):
        settling[start : start + min(n_settling, length)] = True
    return settling, not late.size or late[-1] < cut


def find_growth(model: Any, X: Any) -> float:
    """Logarithm of how much a free run grows by itself; minus infinity of a model without poles."""
    last, passed = reach_model(model, X)
    return last.growth_over(passed) if hasattr(last, "growth_over") else -np.inf


def _one_step(model: Any, X: Any, y: Any) -> np.ndarray:
    """One-step predictions at every row; NaN from a model that makes none."""
    last, transformed = reach_model(model, X)
    if not hasattr(last, "predict_ahead"):
        return np.full(len(np.asarray(y)), np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingDataWarning)  # predict has said so
        return np.asarray(last.predict_ahead(transformed, y), dtype=float).ravel()


def _columns(X: Any) -> dict[Any, Any]:
    if isinstance(X, pd.DataFrame):
        return {name: X[name] for name in X.columns}
    values = np.asarray(X)
    return {i: values[:, i] for i in range(values.shape[1])}


def _channels(
    columns: Mapping[Any, Any], roles: Mapping[Any, str] | None, run: Any
) -> dict[str, np.ndarray]:
    """Channels by role that were measured, and the target where it is their sum."""
    names = list(columns)
    check_named(names, roles)
    if run is not None:
        del names[run_column(names, run)]
    found: dict[str, np.ndarray] = {}
    for role, position in columns_by_role(names, roles).items():
        name = names[position]
        column = pd.DataFrame({name: columns[name]}, copy=False)
        check_numbers(column, "X")
        values = checked_column(column[name], name)
        if not np.isnan(values).all():
            found[role] = values
    return with_target(found)


def _longest_stretches(
    layout: RunLayout, used: np.ndarray, channels: dict[str, np.ndarray]
) -> dict[int, tuple[int, int]]:
    """First row, and last row + 1, of the longest stretch without a gap, by run number."""
    whole = used.copy()
    for values in channels.values():
        whole &= np.isfinite(values)
    cut = np.zeros(layout.n_rows + 1, dtype=bool)
    cut[layout.starts] = True
    edges = np.flatnonzero((np.diff(np.concatenate([[0], whole, [0]])) != 0) | cut)
    best: dict[int, tuple[int, int]] = {}
    for start, stop in itertools.pairwise(edges):
        if whole[start]:
            run = int(layout.run_of(np.asarray(start)))
            if stop - start < LEAST_ROWS:
                continue
            if run not in best or stop - start > best[run][1] - best[run][0]:
                best[run] = (int(start), int(stop))
    return best


N_TAPS = 40  # of the response to a target, at most
RANK = 1e-8  # of the strongest direction of the target's past; weaker ones are left alone


@dataclass(frozen=True)
class TargetResponse:
    """Finite impulse responses of signals to the target of one run; a constant comes last."""

    taps: np.ndarray
    coefficients: dict[str, np.ndarray]

    @classmethod
    def of(cls, target: np.ndarray, signals: dict[str, np.ndarray], dt: float) -> TargetResponse:
        """Least squares of all signals at once, which share the past of the target."""
        target = target - target.mean()
        step = tap_spacing(target[None], dt)
        taps = step * np.arange(min(N_TAPS, target.size // (8 * step)))
        past = np.column_stack([lagged_from_rest(target, taps), np.ones(target.size)])
        values = np.column_stack(list(signals.values()))
        found = np.linalg.lstsq(past, values, rcond=RANK)[0]
        return cls(taps, dict(zip(signals, found.T, strict=True)))

    def to(self, target: np.ndarray, name: str) -> np.ndarray:
        """Response of a signal to the target that the responses were estimated with."""
        target = target - target.mean()
        *coefficients, level = self.coefficients[name]
        response = np.full(target.size, level)
        for lag, coefficient in zip(self.taps, coefficients, strict=True):
            response[lag:] += coefficient * target[: target.size - lag]
        return response


def coherent_part(signals: Signals, group: Group, name: str) -> np.ndarray | None:
    """Part of a signal, run by run, that is caused from outside the loop; None if there is no way.

    Of repeats the mean of the other runs; of one run the excited lines, or the response to the
    target.
    """
    if group.n_runs > 1:
        values = signals.named(name)[group.rows]
        return (values.sum(axis=0) - values) / (group.n_runs - 1)
    if group.lines is not None:
        return on_lines(signals.named(name)[group.rows], group)
    if "f_t" not in signals.channels:
        return None
    return response_to_target(signals, group, name)


def response_to_target(signals: Signals, group: Group, name: str) -> np.ndarray:
    """Response of a signal of the only run of a group to the target."""
    target = signals.channels["f_t"][group.rows[0]]
    return signals.target_responses[int(group.runs[0])].to(target, name)[None]


def on_lines(values: np.ndarray, group: Group) -> np.ndarray:
    """Part of signals at the excited lines."""
    spectrum = fft.rfft(values, axis=-1)
    kept = np.zeros_like(spectrum)
    kept[..., group.lines] = spectrum[..., group.lines]
    return fft.irfft(kept, group.n_samples, axis=-1)


def lagged_from_rest(signal: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Columns signal(t - lag), zero before the signal begins."""
    out = np.zeros((taps.size, signal.size))
    for row, lag in zip(out, taps, strict=True):
        row[lag:] = signal[: signal.size - lag]
    return out.T


def bandwidth(signal: np.ndarray, dt: float, share_of_power: float = 0.99) -> float:
    """Frequency (rad/s) below which signals (rows) have most of their power."""
    power = (np.abs(fft.rfft(signal - signal.mean(axis=1, keepdims=True))) ** 2).sum(axis=0)
    share = np.cumsum(power) / power.sum() if power.any() else np.ones(power.size)
    return 2 * np.pi * max(int(np.searchsorted(share, share_of_power)), 1) / (signal.shape[1] * dt)


def tap_spacing(signal: np.ndarray, dt: float) -> int:
    """Samples between taps that resolve a signal within its bandwidth."""
    return max(int(0.7 / (bandwidth(signal, dt) * dt)), 1)
