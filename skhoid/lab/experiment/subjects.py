"""Subjects of a simulated experiment: people who differ from each other and learn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...exceptions import RemnantIntensityError, UnstableLoopError
from ...human import HumanOperator, Sigmoid, crossover
from ...human.variation import mix
from ...simulation import (
    CompensatoryTask,
    Remnant,
    mixed_condition,
    tracking_condition,
    tune_remnant,
)
from ...simulation.conditions import RATES, Condition
from ...simulation.engine import TrackingRecord

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


def physics_of(participant: Participant, name: str) -> dict[str, Any]:
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
