"""simulate_experiment: recordings of several people with known truth, as in Section VI."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from ... import (
    CompensatoryTask,
    HumanOperator,
    Remnant,
    RemnantIntensityError,
    Sigmoid,
    UnstableLoopError,
    crossover,
    mixed_condition,
    tracking_condition,
    tune_remnant,
)
from ..._machine import check_memory
from ...human import mix
from ...runs import RUN, TIME
from ...simulation import RATES, Condition, TrackingRecord, entropy_of, known_name

# Spreads of the draws around Table II: standard deviations of logarithms.
GAIN, LEAD, DELAY, FREQUENCY, DAMPING, NOISE = 0.25, 0.15, 0.10, 0.12, 0.20, 0.40
INTENSITY = 0.12  # median P_n of the subjects
INTENSITIES = (0.04, 0.25)
ORDERS = (2, 3)  # of remnant that ARX models can bear (Section VII)
WEAK, STRONG = (0.0, 0.15), (0.7, 1.1)  # part of the change between the states that is made
LAG = (0.2, 1.0)  # s, by which adaptation follows the controlled element
# The first run, relative to those after long practice; the difference falls by e in two runs.
LEARNT_GAIN, LEARNT_NOISE, PRACTICE = 0.85, 1.5, 2.0
RUN_TO_RUN = 0.05  # standard deviation of the logarithm of a run's gain

MARGIN = 15.0  # deg of phase that a person keeps
WORST_SCORE = 1.0  # var(e) / var(f_t): with more, doing nothing would be better
DRAWS = 200
# Spawn keys of random streams of a subject; those of runs are (subject, condition, run, try).
PERSON, TUNING = 1_000, 2_000
BACKWARD = ("C5", "C6")  # from state 2 to state 1


@dataclass(frozen=True)
class RecordingSetup:
    """How the runs are recorded; times in s, 0 is the beginning of the measurement window."""

    sampling_rate: float
    duration: float
    run_in: float
    transition_time: float


# Runs of the thesis last 90.00 s, and the controlled element changes at 50.00 s.
STANDARD = RecordingSetup(sampling_rate=100.0, duration=81.92, run_in=8.08, transition_time=41.92)


@dataclass(frozen=True)
class Subject:
    """A person: an operator for each state, and how this person's runs deviate from it."""

    number: int
    states: tuple[HumanOperator, HumanOperator]
    adaptation: float
    adaptation_lag: float
    remnant_order: int
    remnant_intensity: float
    entropy: int

    def generator(self, *key: int) -> np.random.Generator:
        return np.random.default_rng(
            np.random.SeedSequence(self.entropy, spawn_key=(self.number, *key))
        )

    def condition(self, name: str, transition_time: float) -> Condition:
        """What this person does in a condition; the element changes first, then the person."""
        one, two = (
            replace(tracking_condition(state), operator=operator)
            for state, operator in zip(("C1", "C2"), self.states, strict=True)
        )
        if name not in RATES:
            return replace(one if name == "C1" else two, name=name)
        if name in BACKWARD:
            one, two = two, one
        element, operator = (
            mixed_condition(one, two, Sigmoid(0.0, 1.0, rate=RATES[name], time=time))
            for time in (transition_time, transition_time + self.adaptation_lag)
        )
        return Condition(name, element.controlled_element, operator.operator)

    def practised(self, run: int, rng: np.random.Generator) -> tuple[Subject, float]:
        """The person in a run, counted from 1, and how much more remnant there is (in K_n)."""
        novice = np.exp(-(run - 1) / PRACTICE)
        gain = (1 - (1 - LEARNT_GAIN) * novice) * np.exp(RUN_TO_RUN * rng.standard_normal())
        one, two = (replace(state, K_e=state.K_e * gain) for state in self.states)
        noise = float(np.sqrt(1 + (LEARNT_NOISE - 1) * novice))
        return replace(self, states=(one, two)), noise


@dataclass(frozen=True)
class Participant:
    """A subject at the controls: tasks of a recording, with the remnant's gains."""

    subject: Subject
    recording: RecordingSetup

    @cached_property
    def remnant_gains(self) -> tuple[float, float]:
        """K_n in state 1 and state 2."""
        found = []
        for name in ("C1", "C2"):
            remnant = Remnant(
                order=self.subject.remnant_order, intensity=self.subject.remnant_intensity
            )
            seed = int(self.subject.generator(TUNING).integers(2**32))
            tuned: Any = tune_remnant(self.task(name, remnant), random_state=seed).remnant
            found.append(float(tuned.gain))
        return found[0], found[1]

    def task(self, name: str, remnant: Remnant | None, subject: Any = None) -> CompensatoryTask:
        recording = self.recording
        return CompensatoryTask.of_condition(
            (subject or self.subject).condition(name, recording.transition_time),
            remnant=remnant,
            sampling_rate=recording.sampling_rate,
            duration=recording.duration,
            run_in=recording.run_in,
        )

    def remnant(self, name: str, louder: float = 1.0) -> Remnant | None:
        """The remnant of a condition; where the person adapts, K_n follows."""
        if not self.subject.remnant_intensity:
            return None
        one, two = (louder * gain for gain in self.remnant_gains)
        if name not in RATES:
            gain: Any = one if name == "C1" else two
        else:
            if name in BACKWARD:
                one, two = two, one
            time = self.recording.transition_time + self.subject.adaptation_lag
            gain = mix(one, two, Sigmoid(0.0, 1.0, rate=RATES[name], time=time))
        return Remnant(order=self.subject.remnant_order, gain=gain)

    def run(self, name: str, number: int) -> TrackingRecord:
        """Simulate a run, counted from 1, from rest at the beginning of the run-in."""
        at = int(name[1:])
        for attempt in range(DRAWS):
            rng = self.subject.generator(at, number, attempt)
            practised, louder = self.subject.practised(number, rng)
            task = self.task(name, self.remnant(name, louder), practised)
            try:
                return task.simulate(1, random_state=rng, keep_run_in=self.recording.run_in)
            except UnstableLoopError:
                continue
        raise UnstableLoopError(
            f"Subject S{self.subject.number} loses control in {DRAWS} draws of run {number} in "
            f"{name}. Lower remnant_intensity."
        )


def draw_participant(
    number: int, recording: RecordingSetup, entropy: int, *, intensity: float | None = None
) -> Participant:
    """Draw a subject who can do all six conditions, whichever are used.

    Every third subject, S1 among them, adapts weakly. Where remnant is given by ``intensity``, it
    is P_n of all subjects.
    """
    rng = np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(number, PERSON)))
    for _ in range(DRAWS):
        subject = _drawn(number, rng, recording.sampling_rate, entropy, intensity)
        try:
            # Whether a person is accepted must not depend on how long the runs are.
            standard = Participant(subject, STANDARD)
            if _manages(standard):
                return standard if recording == STANDARD else Participant(subject, recording)
        except (UnstableLoopError, RemnantIntensityError):
            continue
    raise UnstableLoopError(
        f"None of {DRAWS} draws of subject S{number} keeps control in all conditions with a "
        f"remnant intensity of {intensity!r}. Lower remnant_intensity."
    )


def _drawn(
    number: int, rng: np.random.Generator, rate: float, entropy: int, given: float | None
) -> Subject:
    """A person; every call draws the same number of random numbers."""
    gains, leads = rng.standard_normal(2), rng.standard_normal(2)
    delay, frequency, damping, noise = rng.standard_normal(4)
    order = int(rng.choice(ORDERS))
    part, lag = rng.random(2)
    # Every third person adapts weakly.
    low, high = WEAK if number % 3 == 1 else STRONG
    adaptation = low + (high - low) * part
    one, two = (
        np.array([o.K_e, o.T_L]) for o in (tracking_condition(n).operator for n in ("C1", "C2"))
    )
    # A person's gains differ from others' in the same way in both states, and a little in each.
    one = one * np.exp([GAIN * gains[0], LEAD * leads[0]])
    two = two * np.exp([GAIN * (0.9 * gains[0] + 0.44 * gains[1]), LEAD * leads[1]])
    two = one + adaptation * (two - one)
    tau_e = 0.28 * np.exp(DELAY * delay)
    mode = {
        "tau_e": round(tau_e * rate) / rate,
        "omega_nm": float(11.25 * np.exp(FREQUENCY * frequency)),
        "zeta_nm": float(0.35 * np.exp(DAMPING * damping)),
    }
    states = [HumanOperator(K_e=float(K_e), T_L=float(T_L), **mode) for K_e, T_L in (one, two)]
    intensity = float(np.clip(INTENSITY * np.exp(NOISE * noise), *INTENSITIES))
    return Subject(
        number=number,
        states=(states[0], states[1]),
        adaptation=float(adaptation),
        adaptation_lag=float(LAG[0] + (LAG[1] - LAG[0]) * lag),
        remnant_order=order,
        remnant_intensity=intensity if given is None else float(given),
        entropy=entropy,
    )


def _manages(participant: Participant) -> bool:
    """Whether this person keeps control in all conditions, with a margin in both states."""
    for name in ("C1", "C2"):
        condition = participant.subject.condition(name, 0.0)
        _, margin = crossover(condition.operator, condition.controlled_element)
        if not margin > MARGIN:
            return False
    for name in ("C1", "C2", *RATES):
        if not participant.task(name, None).simulate(1).score()[0] < WORST_SCORE:
            return False
    if participant.subject.remnant_intensity:
        _ = participant.remnant_gains  # which may be out of reach
    return True


def list_physics(participant: Participant, name: str) -> dict[str, Any]:
    """A row of the table of true parameters."""
    subject, recording = participant.subject, participant.recording
    operator = subject.condition(name, recording.transition_time).operator
    remnant = participant.remnant(name)
    ends = np.array([-1e9, 1e9])
    values = operator.over_time(ends)
    row: dict[str, Any] = {}
    for parameter in ("K_e", "T_L", "K_edot"):
        row |= {
            f"{parameter}_initial": values[parameter][0],
            f"{parameter}_final": values[parameter][1],
        }
    row |= {parameter: values[parameter][0] for parameter in ("tau_e", "omega_nm", "zeta_nm")}
    gain: Any = 0.0 if remnant is None else remnant.gain
    K_n = gain(ends) if callable(gain) else np.repeat(gain, 2)
    changes = name in RATES
    return row | {
        "remnant_order": subject.remnant_order,
        "remnant_intensity": subject.remnant_intensity,
        "K_n_initial": float(K_n[0]),
        "K_n_final": float(K_n[1]),
        "adaptation": subject.adaptation,
        "adaptation_lag": subject.adaptation_lag,
        "transition_time": recording.transition_time if changes else np.nan,
    }


def simulate_experiment(
    subjects: int = 3,
    conditions: str | Sequence[str] = "C1-C6",
    runs: int = 7,
    *,
    remnant_intensity: float | None = None,
    sampling_rate: float = 100.0,
    duration: float = 81.92,
    run_in: float = 8.08,
    random_state: Any = None,
    return_truth: bool = False,
    n_jobs: int | None = None,
) -> Any:
    """Simulate an experiment: several people, each with several runs in several conditions.

    A stand-in for recordings like those of Section VI. People differ in gains, lead, delay,
    neuromuscular mode and remnant, drawn around Table II; they learn over the first runs, vary a
    little from run to run, and follow a change of the controlled element 0.2 to 1 s later. S1, S4,
    S7, ... hardly adapt to it.

    Parameters
    ----------
    subjects : int, default=3
        Number of people.
    conditions : str or sequence of str, default="C1-C6"
        Conditions of the thesis: a name, a range of them, or a list.
    runs : int, default=7
        Number of runs of each person in each condition.
    remnant_intensity : float or None, default=None
        P_n = var(n) / var(u) of practised runs, for all people; 0 means none. None draws it for
        each person (median 0.12). It holds in C1 and C2; in C3 to C6 the gain K_n goes from one to
        the other.
    sampling_rate : float, default=100.0
        Sampling rate in Hz.
    duration : float, default=81.92
        Measurement window in s.
    run_in : float, default=8.08
        Time recorded before it, in s, from rest. Its times are negative: the window begins at 0.
    random_state : int, RandomState, Generator or None, default=None
        Source of all randomness. A run is the same whatever other subjects, conditions and runs
        there are.
    return_truth : bool, default=False
        Also return the parameters of the people.
    n_jobs : int or None, default=None
        Number of threads, one per person, as in joblib.

    Returns
    -------
    X : DataFrame of shape (n_rows, 3)
        Error ``e``, output of the controlled element ``x``, target ``f_t`` (deg), with the row
        index levels ``subject`` ("S1", ...), ``condition``, ``run`` (from 1), ``time`` (s).
    y : Series of shape (n_rows,)
        Control output ``u`` (deg).
    truth : DataFrame
        Only with ``return_truth``: one row per subject and condition, with K_e, T_L (s), K_edot (s)
        and K_n at both ends (``K_e_initial``, ``K_e_final``, ...), tau_e (s), omega_nm (rad/s),
        zeta_nm, remnant_order, remnant_intensity, adaptation (the share of the change of Table II
        that the person makes), adaptation_lag (s) and transition_time (s; NaN in C1 and C2). These
        are for practised runs.

    Raises
    ------
    UnstableLoopError
        If no draw of a person keeps control.
    RemnantIntensityError
        If the recording does not determine the gain of the remnant.
    ValueError
        If a number or name is not valid.

    Notes
    -----
    Standard deviations of logarithms between people: K_e 0.25, T_L 0.15, tau_e 0.10 (to whole
    samples), omega_nm 0.12, zeta_nm 0.20, P_n 0.40 (0.04 to 0.25); the remnant is of order 2 or 3.
    In C3 to C6 the element changes at the same fraction of the recording as in the thesis: 50.00 s
    of 90.00. People make 0.7 to 1.1 of the change between the states of Table II, those who hardly
    adapt 0 to 0.15, also in C2. In the first run a person has 0.85 times the gain and 1.5 times the
    remnant power of a practised one; the differences fall by a factor e in two runs. Gains scatter
    by 5 % from run to run.

    A person with less than 15 deg of phase margin in C1 or C2, or with an error larger than the
    target in any condition, is redrawn, and so is a run that becomes unstable.

    References
    ----------
    Van Grootheest, thesis, Section VI-A and App. M. The 42.93 s given there for the change are not
    consistent with 90.00 s.

    Examples
    --------
    >>> from skhoid.lab.experiment import simulate_experiment
    >>> X, y, truth = simulate_experiment(2, "C3-C4", runs=2, return_truth=True, random_state=0)
    >>> X.shape, X.index.names
    ((72000, 3), FrozenList(['subject', 'condition', 'run', 'time']))
    >>> truth[["K_e_initial", "T_L_initial", "T_L_final", "tau_e"]].xs("C4", level=1).round(2)
             K_e_initial  T_L_initial  T_L_final  tau_e
    subject
    S1              0.09         0.49       0.52   0.26
    S2              0.09         0.46       1.41   0.26
    """
    recording = _recording(float(sampling_rate), float(duration), float(run_in))
    names = _conditions(conditions)
    for what, number in (("subjects", subjects), ("runs", runs)):
        if int(number) != number or number < 1:
            raise ValueError(f"{what} must be a whole number, at least 1; got {number!r}.")
    if remnant_intensity is not None and not 0 <= remnant_intensity < 1:
        raise ValueError(
            "remnant_intensity must be a fraction var(n) / var(u), at least 0 and below 1; got "
            f"{remnant_intensity!r}."
        )
    n_samples = (recording.run_in + recording.duration) * recording.sampling_rate
    check_memory(
        5 * n_samples * runs * subjects * len(names),  # four signals and the time
        f"The signals of {subjects} subjects with {runs} runs in each condition",
    )
    entropy = entropy_of(random_state)
    sessions = Parallel(n_jobs=n_jobs, prefer="threads")(
        delayed(_session)(number, names, runs, recording, entropy, remnant_intensity)
        for number in range(1, subjects + 1)
    )
    X, y = _frames([signals for signals, _ in sessions], names, runs, recording)
    truth = pd.DataFrame([row for _, rows in sessions for row in rows])
    return (X, y, truth.set_index(["subject", "condition"])) if return_truth else (X, y)


def _session(
    number: int,
    names: list[str],
    runs: int,
    recording: RecordingSetup,
    entropy: int,
    intensity: float | None,
) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """All runs of one subject, with columns e, x, f_t and u, and a row of truth per condition."""
    participant = draw_participant(number, recording, entropy, intensity=intensity)
    records = [participant.run(name, run) for name in names for run in range(1, runs + 1)]
    signals = [np.stack([r.e[0], r.x[0], r.f_t[0], r.u[0]], axis=1) for r in records]
    truth = [
        {"subject": f"S{number}", "condition": name} | list_physics(participant, name)
        for name in names
    ]
    return np.concatenate(signals), truth


def _frames(
    signals: list[np.ndarray], names: list[str], runs: int, recording: RecordingSetup
) -> tuple[pd.DataFrame, pd.Series]:
    """X and y of the sessions of all subjects."""
    rate = recording.sampling_rate
    n_run_in = round(recording.run_in * rate)
    n_rows = len(signals[0]) // (len(names) * runs)
    index = pd.MultiIndex.from_product(
        [
            [f"S{number}" for number in range(1, len(signals) + 1)],
            names,
            range(1, runs + 1),
            np.arange(-n_run_in, n_rows - n_run_in) / rate,
        ],
        names=["subject", "condition", RUN, TIME],
    )
    table = np.concatenate(signals)
    X = pd.DataFrame(table[:, :3], index=index, columns=["e", "x", "f_t"])
    y = pd.Series(table[:, 3].copy(), index=index, name="u")
    X.attrs["units"] = dict.fromkeys(X.columns, "deg")
    y.attrs["units"] = {"u": "deg"}
    return X, y


def _recording(rate: float, duration: float, run_in: float) -> RecordingSetup:
    """The element changes at the same fraction of the recording as in the thesis."""
    part = (STANDARD.run_in + STANDARD.transition_time) / (STANDARD.run_in + STANDARD.duration)
    return RecordingSetup(rate, duration, run_in, round(part * (run_in + duration) - run_in, 6))


def _conditions(conditions: Any) -> list[str]:
    """Names of conditions, of a list of them or of a range such as C1-C6."""
    if isinstance(conditions, str):
        ends = re.fullmatch(r"\s*(C\d+)\s*[-–]\s*(C\d+)\s*", conditions, re.IGNORECASE)
        if ends is None:
            return [known_name(conditions.strip())]
        first, last = (int(known_name(end)[1:]) for end in ends.groups())
        if last < first:
            raise ValueError(f"The range {conditions!r} ends before it begins.")
        return [f"C{number}" for number in range(first, last + 1)]
    names = [known_name(name) for name in conditions]
    if not 0 < len(set(names)) == len(names):
        raise ValueError(
            f"conditions must name at least one condition, each once; got {conditions!r}."
        )
    return names
