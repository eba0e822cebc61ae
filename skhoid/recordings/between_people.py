"""Faults of one person that only a comparison with the others can show, run by run."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from ..preprocessing.gate import as_table
from ..runs import RUN, TIME, run_name
from ..runs.roles import role_of
from ..text import counted
from .recording import NamedSignals, join_names

LAGS = np.linspace(-1.0, 1.0, 21)  # s
_MOST = 6  # channels that are compared
_LEAST_ROWS = 20
_SAME_CLOCK = 5.0  # times the usual step, up to which a clock may be right


@dataclass(frozen=True)
class RunFacts:
    """One run: labels, clock, and by channel the spread and the spread of steps.

    ``curves`` are correlations of the second channel, later by ``LAGS``, with the first.
    ``digest`` is the same for the same numbers.
    """

    subject: Any
    condition: Any
    run: Any
    rows: int
    step: float
    duration: float
    missing: int
    size: dict[str, float]
    rough: dict[str, float]
    curves: dict[tuple[str, str], np.ndarray]
    digest: bytes


@dataclass(frozen=True)
class Recordings:
    """The runs of an experiment, and the usual step (s) of their clocks."""

    runs: list[RunFacts]
    step: float

    @cached_property
    def subjects(self) -> list[Any]:
        return list(dict.fromkeys(run.subject for run in self.runs))

    @cached_property
    def conditions(self) -> list[Any]:
        return list(dict.fromkeys(run.condition for run in self.runs))

    @property
    def channels(self) -> list[str]:
        return list(self.runs[0].size)

    @cached_property
    def _cells(self) -> dict[tuple[Any, Any], list[RunFacts]]:
        cells: dict[tuple[Any, Any], list[RunFacts]] = defaultdict(list)
        for run in self.runs:
            cells[run.subject, run.condition].append(run)
        return dict(cells)

    @cached_property
    def curves(self) -> dict[tuple[tuple[str, str], Any], dict[Any, np.ndarray]]:
        """By pair of channels and condition, the median relation of each person."""
        found: dict[tuple[tuple[str, str], Any], dict[Any, np.ndarray]] = defaultdict(dict)
        for (subject, condition), runs in self._cells.items():
            for pair in {pair for run in runs for pair in run.curves}:
                own = [run.curves[pair] for run in runs if pair in run.curves]
                found[pair, condition][subject] = np.median(own, axis=0)
        return dict(found)

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Pairs of channels that are related in any run."""
        return list(dict.fromkeys(pair for run in self.runs for pair in run.curves))

    def of(self, subject: Any, condition: Any = None) -> list[RunFacts]:
        """The runs of a person, in one condition if it is given."""
        conditions = self.conditions if condition is None else [condition]
        return [run for c in conditions for run in self._cells.get((subject, c), [])]


def gather_facts(X: pd.DataFrame, y: Any) -> Recordings:
    """The facts of all runs of an experiment."""
    X = as_table(X)
    if not isinstance(X, pd.DataFrame):
        raise TypeError(
            "X must be a DataFrame with the row index levels run and time, as read_experiment "
            f"makes it; got {type(X).__name__}."
        )
    names = list(X.index.names)
    if TIME not in names or RUN not in names:
        raise ValueError(
            f"X must have the row index levels run and time, and subject and condition where there "
            f"are any; it has {names!r}. read_experiment makes them."
        )
    if not len(X):
        raise ValueError("X has no rows, so there is nothing to check.")
    signals = NamedSignals(X, y)
    values = {
        str(name): np.asarray(column, dtype=np.float64)
        for name, column in zip(signals.channels, signals.columns, strict=True)
    }
    values = dict(list(values.items())[:_MOST])
    if signals.output is not None:
        output = str(signals.output_name)
        values[f"{output} (y)" if output in values else output] = signals.output
    every = np.stack(
        [np.asarray(column, dtype=np.float64) for column in (*signals.columns,)]
        + ([] if signals.output is None else [signals.output])
    )
    time = X.index.get_level_values(TIME).to_numpy(dtype=np.float64)
    stretches = list(_stretches(X.index))
    steps = [_usual_step(time[rows]) for _, rows in stretches if _long(rows)]
    usual = float(np.median(steps)) if steps else 1.0
    runs = [_facts(labels, rows, time, values, every, usual) for labels, rows in stretches]
    return Recordings(runs, usual)


def _usual_step(time: np.ndarray) -> float:
    """The mean of the steps near the median: a clock that is rounded has no median step of its own.

    At 60 Hz and 10 µs the median says 59.988.
    """
    steps = np.diff(time)
    median = float(np.median(steps))
    near = steps[np.abs(steps - median) < 0.5 * abs(median)]
    return float(near.mean()) if near.size else median


def _long(rows: slice) -> bool:
    return rows.stop - rows.start > 1


def _stretches(index: pd.MultiIndex) -> Iterator[tuple[tuple[Any, Any, Any], slice]]:
    """Labels and rows of the runs; levels that are not there are ``"all"``."""
    keys = [name for name in index.names if name != TIME]
    codes = np.stack([index.codes[index.names.index(name)] for name in keys])
    starts = np.append(0, np.flatnonzero((np.diff(codes) != 0).any(axis=0)) + 1)
    stops = np.append(starts[1:], codes.shape[1])
    others = [name for name in keys if name not in ("subject", "condition")]
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        label = dict(zip(index.names, index[start], strict=True))
        inner = tuple(label[name] for name in others)
        run = inner[0] if len(inner) == 1 else run_name(inner)
        yield (label.get("subject", "all"), label.get("condition", "all"), run), slice(start, stop)


def _facts(
    labels: tuple[Any, Any, Any],
    rows: slice,
    time: np.ndarray,
    values: dict[str, np.ndarray],
    every: np.ndarray,
    usual: float,
) -> RunFacts:
    step = _usual_step(time[rows]) if _long(rows) else usual
    own = {name: column[rows] for name, column in values.items()}
    size = {name: _spread(column) for name, column in own.items()}
    rough = {name: _spread(np.diff(column)) for name, column in own.items()}
    trusted = step if usual / _SAME_CLOCK < step < usual * _SAME_CLOCK else usual
    curves = {
        pair: curve
        for pair in combinations(own, 2)
        if (curve := _curve(own[pair[0]], own[pair[1]], trusted)) is not None
    }
    table = every[:, rows]
    return RunFacts(
        *labels,
        rows=rows.stop - rows.start,
        step=step,
        duration=float(time[rows.stop - 1] - time[rows.start]),
        missing=int(np.isnan(table).sum()),
        size=size,
        rough=rough,
        curves=curves,
        digest=hashlib.blake2b(np.ascontiguousarray(table).tobytes(), digest_size=16).digest(),
    )


def _spread(values: np.ndarray) -> float:
    there = values[np.isfinite(values)]
    return float(there.std()) if there.size > 1 else 0.0


def _curve(one: np.ndarray, other: np.ndarray, step: float) -> np.ndarray | None:
    """Correlations of ``other``, later by each of the lags, with ``one``."""
    shifts = np.round(LAGS / step).astype(int)
    if one.size < max(_LEAST_ROWS, 2 * int(np.abs(shifts).max())):
        return None
    a, b = (np.nan_to_num(v - np.nanmean(v)) if np.isfinite(v).any() else v for v in (one, other))
    size = float(np.sqrt((a @ a) * (b @ b)))
    if not size > 0 or not np.isfinite(size):
        return None
    n = a.size
    return np.array(
        [a[max(-k, 0) : n - max(k, 0)] @ b[max(k, 0) : n - max(-k, 0)] / size for k in shifts]
    )


LEAST_PEOPLE = 3  # of two that differ, nobody knows which is wrong
SAME_STEP = 1.01  # ratio of sampling times
AGREE = 2 / 3  # share of the others whose relation has the usual form
USUAL = 0.5  # cosine with the usual relation, from which on it has its form
OPPOSITE = -0.5  # cosine, from which down it is the opposite one
# The same of the median run, below which nothing else explains it: of 144 simulated people without
# a fault none came there, each of 24 with an inverted stick did.
SURELY_OPPOSITE = -0.8
MOSTLY_OPPOSITE = -0.4  # mean cosine of all relations of a channel that is inverted
RELATED = 0.2  # correlation at some lag, below which channels are not related
FACTORS = {
    180 / np.pi: ("180/pi", "pi/180"),
    1000.0: ("1000", "1/1000"),
    10.0: ("10", "1/10"),
}
NEAR = 1.8  # ratio within which a factor explains a difference between people
OFF = 4.5  # ratio to the others' size that people do not reach
LARGER = 2.0  # ratio from which on signals of the loop are large together
NOT_LOST = 30.0  # ratio that no person reaches by nearly losing control
SPREADS = 5.0  # robust standard deviations of the others, that it must exceed as well
SHORT = 0.6  # of the usual duration of runs
ALIKE = 0.1  # spread of durations, of the usual one, up to which there is a usual one
SIZE_SD, ROUGH_SD = 0.35, 0.2  # of logarithms, least that people are taken to differ by
FORM_SD = 0.15  # of 1 - cosine of relations, that people are taken to differ by
SWAPPED = 9.0  # mean square of deviations in standard deviations
BETTER = 0.25  # of it, that is left when the channels are exchanged


@dataclass(frozen=True)
class BetweenFinding:
    """A fault and whose it is; an empty list of people, conditions or runs stands for all.

    ``channel`` is the one to invert, if that mends it; ``sure`` says that nothing else explains it,
    so that an analysis goes on with the channel inverted, or else without these runs.
    """

    subjects: list[Any]
    conditions: list[Any]
    runs: list[Any]
    name: str
    title: str
    evidence: str
    next_step: str
    channel: str = ""
    sure: bool = False


def compare_people(recordings: Recordings) -> list[BetweenFinding]:
    """All that differs between people in a way that behaviour does not explain."""
    found = [*_same_data(recordings), *_clocks(recordings), *_durations(recordings)]
    found += _missing(recordings)
    if len(recordings.subjects) >= LEAST_PEOPLE:
        swapped = list(_swapped(recordings))
        explained = {who for finding in swapped for who in finding.subjects}
        found += swapped
        found += [f for f in _inverted(recordings) if explained.isdisjoint(f.subjects)]
        found += [f for f in _gains(recordings) if explained.isdisjoint(f.subjects)]
    return found


def _findings(
    recordings: Recordings,
    wrong: Iterable[RunFacts],
    name: str,
    title: str,
    evidence: str,
    next_step: str,
    channel: str = "",
    sure: bool = False,
) -> Iterator[BetweenFinding]:
    """One finding of a person; of a condition, and of runs, if others of the person are right."""
    told = (name, title, evidence, next_step, channel, sure)
    runs = list(wrong)
    subject = runs[0].subject
    conditions = list(dict.fromkeys(run.condition for run in runs))
    every = len(runs) == len(recordings.of(subject))
    if every:
        yield BetweenFinding([subject], [], [], *told)
        return
    for condition in conditions:
        own = [run.run for run in runs if run.condition == condition]
        whole = len(own) == len(recordings.of(subject, condition))
        labels = [] if whole else own
        yield BetweenFinding([subject], [condition], labels, *told)


def _same_data(recordings: Recordings) -> Iterator[BetweenFinding]:
    groups: dict[bytes, list[RunFacts]] = defaultdict(list)
    for run in recordings.runs:
        if any(size > 0 for size in run.size.values()):
            groups[run.digest].append(run)
    for same in groups.values():
        if len(same) < 2:
            continue
        first = same[0]
        names = [f"{run.subject}/{run.condition}/{run.run}" for run in same]
        subjects = list(dict.fromkeys(run.subject for run in same))
        conditions = list(dict.fromkeys(run.condition for run in same))
        yield BetweenFinding(
            subjects,
            conditions,
            list(dict.fromkeys(run.run for run in same)),
            "same data",
            f"{join_names(names)} are the same recording",
            f"All {first.rows} rows of all channels are equal.",
            f"Find out whose it is, and leave out {join_names(names[1:])} or read the right file.",
        )


def _clocks(recordings: Recordings) -> Iterator[BetweenFinding]:
    usual = recordings.step
    groups: dict[tuple[Any, int], list[RunFacts]] = defaultdict(list)
    for run in recordings.runs:
        if run.rows > 1 and not 1 / SAME_STEP < run.step / usual < SAME_STEP:
            groups[run.subject, round(100 * np.log(run.step / usual))].append(run)
    for (subject, _), runs in groups.items():
        step = float(np.median([run.step for run in runs]))
        ratio = step / usual
        evidence = f"The median step is {step:.6g} s, of most runs {usual:.6g} s."
        factor = next((f for f in (1000.0, 1e6) if 1 / SAME_STEP < ratio / f < SAME_STEP), None)
        if factor is not None:
            unit = "ms" if factor == 1000.0 else "us"
            title = f"The clock of {subject} looks like {unit}, read as s"
            step_text = f'Read these files with units={{"time": "{unit}"}}, or divide their time.'
        else:
            title = f"{subject} was recorded at another rate, {1 / step:.4g} Hz"
            step_text = f"Put all runs on one grid: resample_runs(X, y, dt={max(step, usual):.6g})."
        sure = factor is not None
        yield from _findings(recordings, runs, "clock", title, evidence, step_text, sure=sure)


def _durations(recordings: Recordings) -> Iterator[BetweenFinding]:
    usual_step = recordings.step
    for condition in recordings.conditions:
        runs = [run for run in recordings.runs if run.condition == condition]
        lasting = np.array([run.rows * _true_step(run, usual_step) for run in runs])
        usual = float(np.median(lasting))
        if len(runs) < 4 or _robust_sd(lasting) > ALIKE * usual:
            continue
        of_person: dict[Any, list[tuple[RunFacts, float]]] = defaultdict(list)
        for run, seconds in zip(runs, lasting.tolist(), strict=True):
            if seconds < SHORT * usual:
                of_person[run.subject].append((run, seconds))
        for subject, short in of_person.items():
            shortest = min(seconds for _, seconds in short)
            yield BetweenFinding(
                [subject],
                [condition],
                [run.run for run, _ in short],
                "short run",
                f"{subject} has {counted(len(short), 'run')} much shorter than usual",
                f"The shortest has {shortest:.4g} s, most have {usual:.4g} s.",
                "Look whether control was lost or the file is cut; leave the run out if so.",
            )


def _true_step(run: RunFacts, usual: float) -> float:
    """The step of a clock, or the usual one if its unit may be wrong."""
    return run.step if usual / 5 < run.step < usual * 5 else usual


def _missing(recordings: Recordings) -> Iterator[BetweenFinding]:
    subjects = recordings.subjects
    if len(subjects) < 2:
        return
    for condition in recordings.conditions:
        cells = {
            subject: [r.run for r in recordings.of(subject, condition)] for subject in subjects
        }
        there = sum(bool(runs) for runs in cells.values())
        usual = Counter(len(runs) for runs in cells.values() if runs).most_common(1)[0][0]
        of_label = Counter(run for runs in cells.values() for run in runs)
        shared = [label for label, n in of_label.items() if n > len(subjects) / 2]
        for subject, runs in cells.items():
            if not runs and there > len(subjects) / 2:
                title = f"{subject} has no run in condition {condition}"
                lacking: list[Any] = []
            else:
                lacking = [label for label in shared if label not in runs]
                if not runs or len(runs) >= usual or not lacking:
                    continue
                title = f"{subject} lacks {counted(usual - len(runs), 'run')}"
            yield BetweenFinding(
                [subject],
                [condition],
                lacking,
                "missing runs",
                title,
                f"There are {counted(len(runs), 'run')}; most people have {usual}.",
                "Look for the files. Analyses per person and condition can do without them.",
            )


def _inverted(recordings: Recordings) -> Iterator[BetweenFinding]:
    """Channels that go with the others by the usual relations, but with the opposite sign."""
    likeness: dict[int, dict[tuple[str, str], float]] = defaultdict(dict)
    by_id = {id(run): run for run in recordings.runs}
    for (pair, condition), curves in recordings.curves.items():
        for subject in curves:
            usual = _usual_curve(curves, subject)
            if usual is None:
                continue
            for run in recordings.of(subject, condition):
                if pair in run.curves and np.abs(run.curves[pair]).max() > RELATED:
                    likeness[id(run)][pair] = _cosine(run.curves[pair], usual)
    wrong: dict[tuple[Any, tuple[str, ...]], list[RunFacts]] = defaultdict(list)
    alike: dict[tuple[Any, tuple[str, ...]], list[float]] = defaultdict(list)
    for number, of_pairs in likeness.items():
        channels = _opposite_channels(of_pairs, recordings.channels)
        if channels:
            key = by_id[number].subject, channels
            wrong[key].append(by_id[number])
            alike[key].append(min(of_pairs.values()))
    for (subject, channels), runs in wrong.items():
        channel, own = " or ".join(channels), alike[subject, channels]
        yield from _findings(
            recordings,
            runs,
            "opposite sign",
            f"{channel} of {subject} has the opposite sign of the others'",
            f"Its correlations with other channels, at lags up to 1 s, have the form of the "
            f"others' with the opposite sign (likeness {max(own):.2f}; -1 is the "
            "exact opposite).",
            f"Check the polarity of {channel} there, and multiply it by -1 if it was inverted.",
            channels[0],
            float(np.median(own)) < SURELY_OPPOSITE,
        )


def _opposite_channels(
    likeness: dict[tuple[str, str], float], channels: list[str]
) -> tuple[str, ...]:
    """The channel whose relations are the most opposite; of two channels alone, both."""
    if min(likeness.values()) > OPPOSITE:
        return ()
    if len(channels) == 2:
        return tuple(reversed(channels))
    means = {
        channel: float(np.mean(own))
        for channel in channels
        if (own := [value for pair, value in likeness.items() if channel in pair])
    }
    channel = min(reversed(list(means)), key=lambda name: means[name])
    return (channel,) if means[channel] < MOSTLY_OPPOSITE else ()


def _usual_curve(curves: dict[Any, np.ndarray], subject: Any) -> np.ndarray | None:
    """The relation of the others, if they agree on one."""
    others = [curve for other, curve in curves.items() if other != subject]
    if len(others) < LEAST_PEOPLE - 1:
        return None
    usual = np.median(others, axis=0)
    alike = [_cosine(curve, usual) > USUAL for curve in others]
    if np.abs(usual).max() < RELATED or np.mean(alike) < AGREE:
        return None
    return usual


def _cosine(one: np.ndarray, other: np.ndarray) -> float:
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size > 0 else 0.0


def _gains(recordings: Recordings) -> Iterator[BetweenFinding]:
    """Channels of a size that differs from the others' by a factor of units."""
    found: dict[tuple[Any, str], list[tuple[RunFacts, float]]] = defaultdict(list)
    larger: dict[int, set[str]] = defaultdict(set)
    for channel in recordings.channels:
        for run, deviation, is_off in _of_other_size(recordings, channel):
            if is_off:
                found[run.subject, channel].append((run, deviation))
            if np.log(LARGER) < deviation < np.log(NOT_LOST):
                larger[id(run)].add(channel)
    groups: dict[tuple[Any, frozenset[int], int], list[str]] = defaultdict(list)
    for (subject, channel), off in found.items():
        # Where control is nearly lost all signals of the loop are large, but the target is not.
        kept = [(run, d) for run, d in off if not _nearly_lost(larger[id(run)], recordings)]
        if kept:
            ratio = float(np.median([deviation for _, deviation in kept]))
            same = frozenset(id(run) for run, _ in kept)
            groups[subject, same, round(ratio / np.log(NEAR))].append(channel)
    for (subject, same, _), channels in groups.items():
        runs = [(run, d) for c in channels for run, d in found[subject, c] if id(run) in same]
        deviation = float(np.median([d for _, d in runs]))
        named = join_names(channels)
        factor = _factor(deviation)
        near = f"A factor of {factor} would explain it: " if factor else ""
        yield from _findings(
            recordings,
            {id(run): run for run, _ in runs}.values(),
            "gain",
            f"{named} of {subject} {'is' if len(channels) == 1 else 'are'} "
            f"{np.exp(deviation):.3g} times as large as the others'",
            "That is the ratio of standard deviations, to the median of the others in the same "
            "condition; people differ by less.",
            f"Check unit and gain of {named} there. {near}radians for degrees make 57.3, mm for m "
            "make 1000.",
            sure=abs(deviation) > np.log(NOT_LOST),
        )


def _of_other_size(recordings: Recordings, channel: str) -> Iterator[tuple[RunFacts, float, bool]]:
    """Runs with the logarithm of their ratio to the others, and whether it is far off."""
    for condition in recordings.conditions:
        sizes = _sizes_of_people(recordings, channel, condition)
        for subject in sizes:
            others = np.array([size for other, size in sizes.items() if other != subject])
            if others.size < LEAST_PEOPLE - 1:
                continue
            usual = float(np.median(others))
            least = max(np.log(OFF), SPREADS * _robust_sd(others))
            runs = [run for run in recordings.of(subject, condition) if run.size[channel] > 0]
            ratios = [float(np.log(run.size[channel])) - usual for run in runs]
            most = 2 * sum(abs(ratio) > least for ratio in ratios) >= len(runs)
            for run, ratio in zip(runs, ratios, strict=True):
                # One run of many that is larger by no factor of units may be of lost control.
                yield run, ratio, abs(ratio) > least and (most or bool(_factor(ratio)))


def _nearly_lost(larger: set[str], recordings: Recordings) -> bool:
    """Whether signals of the loop are large together, and the target is not."""
    output = recordings.channels[-1]
    roles = {role_of(name) for name in larger - {output}}
    in_loop = len(roles & {"e", "x"}) + (output in larger)
    return in_loop > 1 and "f_t" not in roles


def _factor(deviation: float) -> str:
    """The factor of units that is nearest, as text; "" if none is near."""
    nearest = min(FACTORS, key=lambda factor: abs(np.log(factor) - abs(deviation)))
    if abs(np.log(nearest) - abs(deviation)) > np.log(NEAR):
        return ""
    return FACTORS[nearest][deviation < 0]


def _sizes_of_people(recordings: Recordings, channel: str, condition: Any) -> dict[Any, float]:
    found = {}
    for subject in recordings.subjects:
        own = [r.size[channel] for r in recordings.of(subject, condition) if r.size[channel] > 0]
        if own:
            found[subject] = float(np.log(np.median(own)))
    return found


def _robust_sd(values: np.ndarray) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _swapped(recordings: Recordings) -> Iterator[BetweenFinding]:
    """Pairs of channels that are those of the others when their names are exchanged."""
    channels = recordings.channels
    pairs = [(a, b) for k, a in enumerate(channels) for b in channels[k + 1 :]]
    for subject in recordings.subjects:
        best: tuple[float, float, tuple[str, str]] | None = None
        for pair in pairs:
            apart = [_apart(recordings, subject, c, pair) for c in recordings.conditions]
            known = [found for found in apart if found is not None]
            if not known:
                continue
            as_named, exchanged = np.median(known, axis=0)
            if (
                as_named > SWAPPED
                and exchanged < BETTER * as_named
                and (best is None or exchanged < best[1])
            ):
                best = float(as_named), float(exchanged), pair
        if best is not None:
            one, other = best[2]
            yield from _findings(
                recordings,
                recordings.of(subject),
                "swapped channels",
                f"{one} and {other} of {subject} seem to be exchanged",
                f"By size, smoothness and their relation, they deviate from the others' by "
                f"{best[0] ** 0.5:.3g} standard deviations, exchanged by {best[1] ** 0.5:.3g}.",
                f"Compare both with the others', and exchange them: inputs={{{one!r}: {other!r}, "
                f"{other!r}: {one!r}}}.",
                sure=True,
            )


def _apart(
    recordings: Recordings, subject: Any, condition: Any, pair: tuple[str, str]
) -> tuple[float, float] | None:
    """Mean square deviation of two channels from the others', as named and exchanged."""
    features = {
        other: found
        for other in recordings.subjects
        if (found := _features(recordings.of(other, condition), pair)) is not None
    }
    if subject not in features or len(features) < LEAST_PEOPLE:
        return None
    others = np.array([f for other, f in features.items() if other != subject])
    least = np.array([SIZE_SD, ROUGH_SD, SIZE_SD, ROUGH_SD])
    spread = np.maximum([_robust_sd(column) for column in others.T], least)
    usual, own = np.median(others, axis=0), features[subject]
    as_named = [*((own - usual) / spread)]
    exchanged = [*((own[[2, 3, 0, 1]] - usual) / spread)]
    for as_is, turned in _relations(recordings, subject, condition, pair):
        as_named.append(as_is / FORM_SD)
        exchanged.append(turned / FORM_SD)
    return float(np.mean(np.square(as_named))), float(np.mean(np.square(exchanged)))


def _relations(
    recordings: Recordings, subject: Any, condition: Any, pair: tuple[str, str]
) -> Iterator[tuple[float, float]]:
    """Unlikeness of each relation of two channels to the others', as named and exchanged."""
    one, other = pair
    exchange = {one: other, other: one}
    for relation in recordings.pairs:
        if one not in relation and other not in relation:
            continue
        curves = recordings.curves.get((relation, condition), {})
        usual = _usual_curve(curves, subject)
        a, b = (exchange.get(name, name) for name in relation)
        forward, backward = (
            recordings.curves.get((names, condition), {}) for names in ((a, b), (b, a))
        )
        if usual is None or subject not in curves:
            continue
        if subject in forward:
            turned = forward[subject]
        elif subject in backward:
            turned = backward[subject][::-1]  # the lag of b on a is that of a on b, negative
        else:
            continue
        yield 1 - _cosine(curves[subject], usual), 1 - _cosine(turned, usual)


def _features(runs: list[RunFacts], pair: tuple[str, str]) -> np.ndarray | None:
    """Logarithms of the spread and of the relative spread of steps of two channels."""
    rows = [
        [value for name in pair for value in (run.size[name], run.rough[name] / run.size[name])]
        for run in runs
        if all(run.size[name] > 0 and run.rough[name] > 0 for name in pair)
    ]
    return np.log(np.median(rows, axis=0)) if rows else None
