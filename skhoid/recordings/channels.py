"""``check_channels``: faults of units, clock and channels of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .._sklearn import DT, checked
from ..exceptions import RunIndexError
from ..preprocessing.gate import SingleColumn, as_table
from ..runs import GAP, JITTER_TOLERANCE, snap
from ..runs.roles import of_person
from ..text import Step, counted
from .rates import check_rates
from .recording import Finding, RawRecording, join_names, read_recording

NOTED_JITTER = 0.01  # of a sampling time
SAME_STEP = 0.01  # relative difference of sampling times
SLOWEST = 1.0  # s, between samples of a person
IDENTITY = 1e-3  # rms of e - (f_t - x), of that of e
LONGEST_SHIFT = 3  # samples, between a channel and its copy
COPY = 1e-3  # rms misfit of a copy, of the rms of the steps from row to row
ROUNDING = 1e-6  # rms misfit of a copy, of its largest value
START = 1.0  # s, in which a run may begin with invalid samples
JUMP = 1.5  # times the largest later step
ISOLATED = 3.0  # times the steps beside it
BACK = 0.8  # of a jump, by which a pulse such as that of a button returns
STALLED = 6  # samples before a jump, in which the channel stands still
QUIET = 0.1  # of the median later step, up to which it does
MOVING = 0.5  # share of later steps in which the channel changes, at least
STILL = 10  # samples, at least, that a channel stands still before it is noted
LONGER = 3.0  # times the longest later stillness
COARSEST = 25  # samples between values of a channel that was recorded more slowly
REGULAR = 0.95  # share of the steps that follow the pattern of a slower clock
FILLED = 0.4  # share of the slower clock's steps in which the channel changes
LEAST_STEPS = 20
BLOCK = 100_000  # values of all channels together that are taken at a time


@checked(dt=DT)
def check_channels(
    X: Any, y: Any = None, *, dt: float | None = None, run: Any = None
) -> list[Finding]:
    """Check units, clock and channels of a recording.

    Looks for a rate that is not the derivative of its angle (pairs are found by name: stem and stem
    + rate, dot or velocity, in any spelling); e that is not f_t - x; a channel that is a copy of
    another, or of the output; invalid first samples; a clock that counts rows or milliseconds,
    jitters, has gaps, or differs between runs; channels that are held or interpolated from a slower
    recording, constant, or partly missing.

    Parameters
    ----------
    X : DataFrame or array of shape (n_rows, n_channels)
        Channels as recorded; the time index may be too irregular for a model. The channels e, x
        and f_t are known by their names.
    y : Series, array of shape (n_rows,) or None, default=None
        The operator's output, checked like the channels.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Returns
    -------
    findings : list of Finding
        Empty if nothing was found; unit errors come first. Each has a ``name``, ``title``,
        ``evidence``, ``meaning`` and ``next_step``, and can be printed.

    Raises
    ------
    RunIndexError
        If runs or time make no sense: shuffled rows, or time that repeats or is not a number.

    Notes
    -----
    Changes of an angle over 1 sample to 1 s are compared with the integral of the rate. The two
    regression lines enclose the true factor, whichever channel is noisy; 10 % is allowed for
    calibration.

    Examples
    --------
    >>> from skhoid import load_bicycle_rider
    >>> from skhoid.recordings.channels import check_channels
    >>> X, y = load_bicycle_rider(inputs=["RollAngle", "RollRate", "YawRate"], correct_units=False)
    >>> (finding,) = check_channels(X, y)
    >>> finding.title
    'RollRate is not the derivative of RollAngle: factor 55.4'
    >>> finding.next_step
    'Multiply RollRate by 57.2958, unless RollAngle is the one that is wrong. YawRate has no ...'
    """
    X = as_table(X)
    if len(X) == 0:
        raise RunIndexError("X has no rows, so there is nothing to check.")
    recording = read_recording(X, y, dt, run)
    findings = check_rates(recording)
    for check in (
        _error_signal,
        _copies,
        _first_samples,
        _clock,
        _slower,
        _missing,
        _constant,
        _wrapping,
    ):
        findings += check(recording)
    return findings


TURNS = (360.0, 2 * np.pi)  # in degrees and radians


def _error_signal(recording: RawRecording) -> Iterator[Finding]:
    """The identity e = f_t - x."""
    e, x, f_t = (recording.signals.of_role(role)[0] for role in ("e", "x", "f_t"))
    if e is None or x is None or f_t is None:
        return
    known = np.isfinite(e) & np.isfinite(x) & np.isfinite(f_t)
    size = _rms(e[known])
    if known.sum() < LEAST_STEPS or size == 0:
        return
    apart = _rms((e - f_t + x)[known]) / size
    if apart <= IDENTITY:
        return
    columns = np.column_stack([f_t, x, np.ones_like(x)])[known]
    (a, b, c), *_ = np.linalg.lstsq(columns, e[known], rcond=None)
    left = _rms(e[known] - columns @ [a, b, c]) / size
    evidence = f"The rms of e - (f_t - x) is {100 * apart:.3g} % of that of e."
    meaning = "One of the three is not the signal that its name says, or was delayed or filtered."
    if left <= IDENTITY:
        evidence += f" e = {a:.4g} f_t {b:+.4g} x {c:+.3g} holds to {100 * left:.2g} %."
        if abs(a + 1) < IDENTITY and abs(b - 1) < IDENTITY:
            meaning = "e has the opposite sign: it is x - f_t."
        elif abs(a - 1) < IDENTITY and abs(b - 1) < IDENTITY:
            meaning = "x has the opposite sign."
        elif abs(a + b) < IDENTITY * abs(a):
            meaning = f"e is not in the unit of f_t and x: it is {a:.6g} times as large."
        elif abs(a - 1) < IDENTITY or abs(b + 1) < IDENTITY:
            which, factor = ("x", -b) if abs(a - 1) < IDENTITY else ("f_t", a)
            meaning = f"{which} is not in the unit of e: multiply it by {factor:.6g}."
        if abs(c) > IDENTITY * size and abs(a - 1) < IDENTITY and abs(b + 1) < IDENTITY:
            meaning = f"e has an offset of {c:.4g}."
    yield Finding(
        "error signal",
        "e is not f_t - x",
        evidence,
        meaning,
        "Correct the channel, or compute e = f_t - x, before fitting a model.",
    )


def _copies(recording: RawRecording) -> Iterator[Finding]:
    """Channels that are copies of another one: scaled, negated, or some samples late."""
    names = [
        name
        for name, values in recording.values.items()
        if np.isfinite(values).any() and np.nanstd(values) > 0
    ]
    if len(names) < 2:
        return
    found = set()
    for shift, correlation in enumerate(_shifted_correlations(recording, names)):
        for i, j in np.argwhere(np.abs(correlation) > 0.9):
            if i == j or (shift == 0 and i > j) or frozenset((i, j)) in found:
                continue
            gain = _copy_gain(recording, names[i], names[j], shift)
            if gain is not None:
                found.add(frozenset((i, j)))
                yield _copy(recording, names[i], names[j], shift, gain)


def _shifted_correlations(recording: RawRecording, names: list[Any]) -> np.ndarray:
    """Correlations of channels (second axis) with channels some samples later, by shift."""
    channels = [recording.values[name] for name in names]
    mean, sd = (np.array([[f(v)] for v in channels]) for f in (np.nanmean, np.nanstd))
    n_rows = channels[0].size
    longest = min(LONGEST_SHIFT, n_rows - 2)
    products = np.zeros((longest + 1, len(names), len(names)))
    block = max(BLOCK // len(channels), 1)
    for start in range(0, n_rows, block):
        part = np.stack([values[start : start + block + longest] for values in channels])
        part -= mean
        part /= sd
        np.nan_to_num(part, copy=False)
        for shift in range(longest + 1):
            later = part[:, shift : shift + block]
            products[shift] += part[:, : later.shape[1]] @ later.T
    return products / n_rows


def _copy_gain(recording: RawRecording, source: Any, copy: Any, shift: int) -> float | None:
    """Slope of a copy on its source some samples before, if it is one."""
    a, b = recording.values[source], recording.values[copy]

    def known_pairs() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for rows in recording.segments:
            before, after = a[rows][: rows.stop - rows.start - shift], b[rows][shift:]
            known = np.isfinite(before) & np.isfinite(after)
            yield before[known], after[known]

    n = sum(before.size for before, _ in known_pairs())
    if n < LEAST_STEPS:
        return None
    mean_a, mean_b = (sum(float(pair[i].sum()) for pair in known_pairs()) / n for i in (0, 1))
    power = sum(float(np.sum((before - mean_a) ** 2)) for before, _ in known_pairs())
    if power == 0:
        return None
    gain = sum(float((x - mean_a) @ (y - mean_b)) for x, y in known_pairs()) / power
    left = sum(float(np.sum((y - mean_b - gain * (x - mean_a)) ** 2)) for x, y in known_pairs())
    steps = [np.diff(b[rows]) for rows in recording.segments]
    n_steps = sum(int(np.isfinite(step).sum()) for step in steps)
    step = np.sqrt(sum(float(np.nansum(step**2)) for step in steps) / max(n_steps, 1))
    allowed = max(COPY * float(step), ROUNDING * np.nanmax(np.abs(b)))
    return gain if gain != 0 and np.sqrt(left / n) <= allowed else None


def _copy(recording: RawRecording, source: Any, copy: Any, shift: int, gain: float) -> Finding:
    late = f", {counted(shift, 'sample')} late" if shift else ""
    of_output = recording.output in (source, copy)
    if abs(gain - 1) < COPY:
        what = f"{copy} is a copy of {source}{late}"
    elif abs(gain + 1) < COPY:
        what = f"{copy} is {source} with the opposite sign{late}"
    else:
        what = f"{copy} is {source} times {gain:.6g}{late}"
    channel = copy if source == recording.output else source
    return Finding(
        "copy",
        what,
        f"Apart from an offset, it differs by less than {COPY:g} of the rms step from row to row, "
        "in all rows.",
        f"{channel} is the output itself: a model that uses it explains everything and means "
        "nothing."
        if of_output
        else "Together they carry no more information than one of them, and a model cannot "
        "separate their effects.",
        f"Leave {channel} out of the inputs."
        if of_output
        else f"Leave {copy} or {source} out, unless one is only for display in another unit.",
        about=f"{copy}, {source}",
    )


def _first_samples(recording: RawRecording) -> Iterator[Finding]:
    """Samples at the beginning of runs that are not yet those of the channel."""
    for name, values in recording.values.items():
        jumps: dict[str, tuple[int, float, float]] = {}
        still: dict[str, int] = {}
        for label, rows in zip(recording.labels, recording.runs, strict=True):
            step = np.diff(values[rows])
            begin = min(max(round(START / recording.dt), 2 * STILL), step.size // 4)
            early, late = step[:begin], step[begin:]
            late = np.abs(late[np.isfinite(late)])
            # In a stepped channel, or one at rest, a jump cannot be recognised.
            if begin < 2 or np.isnan(early).any() or np.mean(late > 0) < MOVING:
                continue
            if (at := _jump(early, late)) is not None:
                jumps[label] = at + 1, float(np.abs(early[at])), float(late.max())
            elif (count := _stillness(np.abs(early), late)) is not None:
                still[label] = count
        if jumps:
            label = max(jumps, key=lambda run: jumps[run][1] / jumps[run][2])
            number, jump, later = jumps[label]
            yield Finding(
                "first samples",
                f"{name} is not valid from the beginning of {_runs(jumps)}",
                f"In run {label} it is constant and jumps by {jump:.4g} after "
                f"{counted(number, 'sample')} ({number * recording.dt:.3g} s); later "
                f"steps are {later:.4g} at most.",
                "The channel held an old value until then: a cursor at (0, 0), or a display that "
                "stalled.",
                _leave_out(max(number for number, _, _ in jumps.values()), recording.dt),
                about=str(name),
            )
        if still:
            label = max(still, key=lambda run: still[run])
            number = still[label]
            yield Finding(
                "first samples",
                f"{name} is constant at the beginning of {_runs(still)}",
                f"The first {number} samples of run {label} ({number * recording.dt:.3g} s) are "
                f"equal, more than {LONGER:g} times as many as anywhere later.",
                "Recording began before the signal, or the operator, was ready.",
                _leave_out(number, recording.dt),
                about=str(name),
            )


def _leave_out(number: int, dt: float) -> Step:
    start = f"{number * dt:.3g}"
    step = f"Leave out the first {start} s there: cut the rows, or"
    return Step(f"{step} RunInTrimmer(run_in={start}).", f"{step} --run-in {start}.")


def _jump(early: np.ndarray, late: np.ndarray) -> int | None:
    """Step up to which a run begins with an old value, if it does."""
    size = np.abs(early)
    at = int(np.argmax(size))
    beside = [size[i] for i in (at - 1, at + 1) if 0 <= i < size.size]
    before = size[max(at - STALLED, 0) : at]
    stalled = at <= 2 or np.median(before) < QUIET * np.median(late)
    jumps = size[at] > JUMP * late.max() and size[at] > ISOLATED * max(beside)
    pulse = np.max(-early * np.sign(early[at])) > BACK * size[at]
    return at if jumps and stalled and not pulse else None


def _stillness(early: np.ndarray, late: np.ndarray) -> int | None:
    """Equal samples at the start of a run, if there are many more than ever later."""
    count = int(np.argmax(early > 0)) + 1 if early.any() else early.size
    longest = int(np.diff([-1, *np.flatnonzero(late), late.size]).max())
    return count if count >= max(STILL, LONGER * longest) else None


def _clock(recording: RawRecording) -> Iterator[Finding]:
    """Steps of the time index."""
    if not recording.clocked:
        return
    typical, deviation, gaps = [], [], []
    for rows in recording.runs:
        step = np.diff(recording.time[rows])
        if not step.size:
            continue
        median = float(np.median(step))
        typical.append(median)
        gapless = step <= GAP * median
        deviation.append(np.where(gapless, np.abs(step / median - 1), 0.0))
        gaps += [(float(step[i]), rows.start + int(i)) for i in np.flatnonzero(~gapless)]
    if not typical:
        return
    if max(typical) > (1 + SAME_STEP) * min(typical):
        yield Finding(
            "sampling time",
            "Runs differ in sampling time",
            f"The median step is {min(typical):.6g} s in one run and {max(typical):.6g} s in "
            "another.",
            "A lag in samples then differs in time between runs.",
            Step(
                f"Put the runs on one grid: X, y = resample_runs(X, y, dt={snap(max(typical)):g}).",
                f"Put the runs on one grid: --resample --dt {snap(max(typical)):g}.",
            ),
        )
    found = [role for role in ("e", "x", "f_t") if recording.signals.of_role(role)[0] is not None]
    if min(typical) >= SLOWEST and of_person(found):
        yield Finding(
            "clock unit",
            f"The clock advances by {recording.dt:g} per row",
            f"All {counted(recording.time.size, 'value')} of time were taken as seconds.",
            "Nobody steers that slowly: these are row numbers, or milliseconds.",
            Step(
                "Read milliseconds with units={'t': 'ms'}; for row numbers give the sampling time "
                "in s, dt=, in place of the time column.",
                "Read milliseconds with --unit time=ms; for row numbers give the sampling time, "
                "--dt SECONDS, in place of the time column.",
            ),
        )
    off = np.concatenate(deviation)
    if off.max() > NOTED_JITTER:
        run = int(np.argmax([part.max() for part in deviation]))
        row = recording.runs[run].start + int(np.argmax(deviation[run])) + 1
        tolerated = "tolerated" if off.max() <= JITTER_TOLERANCE else "more than models accept"
        yield Finding(
            "clock jitter",
            f"The clock jitters by up to {100 * off.max():.1f} % of a step",
            f"The median step is {recording.dt:.6g} s; {int((off > NOTED_JITTER).sum())} of "
            f"{off.size} steps deviate by more than 1 %, rms {100 * _rms(off):.2f} %, most at "
            f"{recording.where(row)} ({tolerated}).",
            "Lags in samples are then not exactly lags in time: timing errors appear as noise at "
            "high frequency.",
            Step(
                f"Interpolate: X, y = resample_runs(X, y, dt={snap(recording.dt):.6g}).",
                f"Interpolate: --resample --dt {snap(recording.dt):.6g}.",
            ),
        )
    if gaps:
        longest, row = max(gaps)
        yield Finding(
            "gaps",
            f"The clock has {counted(len(gaps), 'gap')}",
            f"The longest lasts {longest:.4g} s ({longest / recording.dt:.1f} steps), after "
            f"{recording.where(row)}.",
            "Samples were lost. Models restart after a gap; spectra need a stretch without gaps.",
            Step(
                "Cut the run there, or bridge gaps of up to three steps with resample_runs.",
                "Cut the run there, or bridge gaps of up to three steps with --resample.",
            ),
        )


def _slower(recording: RawRecording) -> Iterator[Finding]:
    """Channels that were recorded at a lower rate than the table's."""
    for name, values in recording.values.items():
        largest = np.nanmax(np.abs(values), initial=0.0)
        with np.errstate(over="ignore"):  # what has no single precision is infinite there
            single = isinstance(values, SingleColumn) or np.array_equal(
                values, values.astype(np.float32), equal_nan=True
            )
        rounding = 4 * np.finfo(np.float32 if single else np.float64).eps * largest
        for order, tolerance, how in ((1, 0.0, "held"), (2, rounding, "interpolated")):
            changes = [
                np.abs(np.diff(values[rows], order)) > tolerance for rows in recording.segments
            ]
            factor = _slow_factor(changes)
            if factor is None:
                continue
            shown = f"{factor:.3g}"
            yield Finding(
                f"{how} samples",
                f"{name} is {how} over {shown} samples",
                f"It {'changes' if order == 1 else 'bends'} every {shown} samples "
                f"({factor * recording.dt:.3g} s), in {100 * REGULAR:.0f} % of the cases or more, "
                f"and {'is constant' if order == 1 else 'is a straight line'} in between.",
                f"It was recorded at {1 / (factor * recording.dt):.4g} Hz"
                + (
                    " and repeated: it lags by half that time on average."
                    if order == 1
                    else " and interpolated: it holds nothing faster than half that rate."
                ),
                Step(
                    f"Decimate the recording by {shown} (Decimator), or use the original samples "
                    "with resample_runs. If the target was generated that way, nothing is wrong.",
                    f"Decimate the recording by {shown} (skhoid identify --decimate). If the "
                    "target was generated that way, nothing is wrong.",
                ),
                about=str(name),
            )
            break


def _slow_factor(changes: list[np.ndarray]) -> float | None:
    """Samples between changes, if these come with the regularity of a slower clock."""
    number = sum(int(part.sum()) for part in changes)
    size = sum(part.size for part in changes)
    if number < LEAST_STEPS or number > 0.8 * size:
        return None
    for k in range(min(COARSEST, size // LEAST_STEPS), 1, -1):
        phases = [np.bincount(np.flatnonzero(part) % k, minlength=k) for part in changes]
        if sum(p.max() for p in phases) >= REGULAR * number and number * k >= FILLED * size:
            return float(k)
    changing, still = (
        np.concatenate([_lengths(part == kind) for part in changes]) for kind in (True, False)
    )
    # If the slower clock is no whole multiple, two lengths of stillness alternate.
    if still.size >= LEAST_STEPS and still.max() <= COARSEST:
        regular = [_share_of_two(lengths) >= REGULAR for lengths in (changing, still)]
        return size / number if all(regular) else None
    return None


def _lengths(flags: np.ndarray) -> np.ndarray:
    """Lengths of the stretches in which a flag is set, without the first and the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return (edges[1::2] - edges[::2])[1:-1]


def _share_of_two(lengths: np.ndarray) -> float:
    """Share of the two most common neighbouring lengths."""
    if not lengths.size:
        return 0.0
    counts = np.bincount(lengths)
    return float((counts[:-1] + counts[1:]).max() / lengths.size)


def _missing(recording: RawRecording) -> Iterator[Finding]:
    for name, values in recording.values.items():
        missing = np.isnan(values)
        if not missing.any():
            continue
        edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(int), [0]])))
        lengths = edges[1::2] - edges[::2]
        longest = int(np.argmax(lengths))
        number, all_of_it = int(missing.sum()), bool(missing.all())
        yield Finding(
            "missing samples",
            f"{name} has no values"
            if all_of_it
            else f"{name} has {counted(number, 'missing sample')}",
            f"{number} of {values.size} rows {'is' if number == 1 else 'are'} missing or infinite, "
            f"the longest stretch {counted(lengths[longest], 'row')} "
            f"({lengths[longest] * recording.dt:.3g} s) from "
            f"{recording.where(edges[2 * longest])} on.",
            "Models leave out rows whose lags need a missing value, and hold the last value in a "
            "free run.",
            "Leave the channel out."
            if all_of_it
            else Step(
                "Cut out long stretches, or fill short ones by interpolation (X.interpolate()).",
                "Cut out long stretches, or fill short ones by interpolation in the file.",
            ),
            about=str(name),
        )


def _wrapping(recording: RawRecording) -> Iterator[Finding]:
    """Angles that jump back by a turn from one row to the next."""
    for name, values in recording.values.items():
        known = values[np.isfinite(values)]
        for turn in TURNS:
            steps = [np.diff(values[rows]) for rows in recording.runs]
            size = np.abs(np.concatenate([*steps, np.zeros(0)]))
            size = size[np.isfinite(size)]
            if not size.size or np.ptp(known) > turn * (1 + 1e-6):
                continue
            jumps, rest = size[size > 0.75 * turn], size[size <= 0.75 * turn]
            most = rest.max(initial=0.0)
            # Unwrapped, it moves there as it does elsewhere; spikes and pulses do not.
            if not jumps.size or most > turn / 4 or (np.abs(jumps - turn) > most).any():
                continue
            yield Finding(
                "wrapped angle",
                f"{name} jumps by a turn {counted(jumps.size, 'time')}",
                f"It jumps by {jumps.min():.4g} or more of {turn:.4g}; elsewhere it moves by "
                f"{most:.3g} at most from row to row.",
                "An angle that wraps: a model cannot follow the jump, and looks for effects in it.",
                Step(
                    f"Unwrap it in each run: numpy.unwrap({name}, period={turn:.8g}).",
                    "Unwrap it in each run of the file.",
                ),
                about=str(name),
            )
            break


def _constant(recording: RawRecording) -> Iterator[Finding]:
    for name, values in recording.values.items():
        still = {}
        for label, rows in zip(recording.labels, recording.runs, strict=True):
            known = values[rows][np.isfinite(values[rows])]
            if known.size > 1 and np.ptp(known) <= 1e-12 * np.abs(known).max():
                still[label] = float(known[0])
        if not still:
            continue
        everywhere = len(still) == len(recording.labels)
        yield Finding(
            "constant channel",
            f"{name} is constant" + ("" if everywhere else f" in {_runs(still)}"),
            f"It is {next(iter(still.values())):g} in every row"
            + ("." if everywhere else f" of run {next(iter(still))}."),
            "It carries no information: it was not connected, or not used in this experiment.",
            "Leave the channel out." if everywhere else "Leave out these runs, or the channel.",
            about=str(name),
        )


def _runs(labels: Any) -> str:
    labels = list(labels)
    return f"run{'s' if len(labels) > 1 else ''} {join_names(labels)}"


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
