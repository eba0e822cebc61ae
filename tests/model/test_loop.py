"""Runs of the closed loop: against a loop in NumPy, sample by sample."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from support.person_in_loop import Person, sampled_loop

from skhoid import LinearElement
from skhoid.effects import Effects
from skhoid.effects.record import Record
from skhoid.model.cores import OperatorCore
from skhoid.model.fitting import Criterion, minimise
from skhoid.model.loop import (
    Loop,
    LoopSimulator,
    choose_pulse_response,
    find_loop,
)
from skhoid.model.simulator import Simulator

DT = 0.02
ELEMENTS = {
    "1/s": Person(K_e=2.0, K_edot=0.1, omega_nm=9.0, zeta_nm=0.5, tau_e=0.2),
    "1/(s(s+1))": Person(K_e=1.6, K_edot=1.4, omega_nm=10.0, zeta_nm=0.4, tau_e=0.16),
}


def read_theta(person):
    return np.array([person.K_e, person.K_edot, person.omega_nm, person.zeta_nm, person.tau_e])


def excited(rng, n, runs):
    """A signal that begins at zero, with power below 1.5 Hz."""
    t = np.arange(n) * DT
    f = np.array([0.05, 0.1, 0.15, 0.25, 0.35, 0.55, 0.85, 1.3])[:, None, None]
    phase = rng.uniform(0, 2 * np.pi, (f.size, 1, runs))
    wave = (np.sin(2 * np.pi * f * t[:, None] + phase) / (1 + (f / 0.4) ** 1.5)).sum(axis=0)
    return wave * np.clip(t, 0, 1)[:, None] ** 2


class World:
    """Target and disturbance that go in, and the record of a person among them."""

    def __init__(self, text, *, remnant=0.3, runs=2, seconds=20.0, seed=0):
        rng = np.random.default_rng(seed)
        n = round(seconds / DT)
        self.person = ELEMENTS[text]
        self.element = LinearElement.of(text)
        self.b, self.a = self.element.discrete(DT)
        self.target, self.disturbance = excited(rng, n, runs), 0.7 * excited(rng, n, runs)
        noise = lfilter([0.1], [1, -0.9], rng.standard_normal((n, runs)), axis=0)
        self.noise = noise / np.std(noise)
        e, u = self.run(self.person)
        self.noise *= remnant * np.std(u)
        e, u = self.run(self.person, self.noise)
        x = self.target - e
        known = np.ones_like(u, dtype=bool)
        known[: round(3 / DT)] = False
        t = np.arange(n)[:, None] * DT
        roles = {"e": "e", "x": "x", "f_t": "f_t"}
        channels = {"e": e, "x": x, "f_t": self.target}
        record = Record(DT, t, channels, roles, ("e",), known, u, controlled_element=self.element)
        self.core = OperatorCore(None)
        self.record = self.core.add_to_record(record)

    def run(self, person, remnant=None):
        remnant = np.zeros_like(self.target) if remnant is None else remnant
        return sampled_loop(person, self.b, self.a, self.target, self.disturbance, remnant, DT)

    def simulator(self, *, begin=0, effects=(), **options):
        loop = Loop(self.b, self.a, begin, **options)
        return LoopSimulator(self.core, Effects(list(effects)), self.record, loop)


@pytest.fixture(scope="module", params=ELEMENTS)
def world(request):
    return World(request.param)


OTHER = {"K_e": 1.3, "K_edot": 1.2, "omega_nm": 0.8, "zeta_nm": 1.3, "tau_e": 1.25}


def changed(person, *names):
    values = {name: getattr(person, name) * OTHER[name] for name in names}
    if "tau_e" in values:
        values["tau_e"] = round(values["tau_e"] / DT) * DT
    return replace(person, **values)


@pytest.mark.parametrize("names", [("tau_e",), ("K_e", "K_edot", "omega_nm", "zeta_nm")])
def test_run_is_the_loop_of_another_person_without_remnant(world, names):
    """With target and disturbance as they were, though nobody recorded the disturbance."""
    person = changed(world.person, *names)
    _, u = world.run(person)
    simulator = world.simulator()
    found = simulator.run(read_theta(person))
    np.testing.assert_allclose(found, u, atol=1e-4 * np.std(u))


def test_a_loop_that_rings_for_long_is_solved():
    """Near the gain at which it no longer settles (2.25 to 2.3 times), within any trials."""
    world = World("1/s", seconds=80.0)
    person = replace(world.person, K_e=4.2, K_edot=0.21)
    _, u = world.run(person)
    simulator = world.simulator()
    for _ in range(2):
        found = simulator.run(read_theta(person))
        np.testing.assert_allclose(found, u, atol=1e-4 * np.std(u))
        assert np.isnan(simulator.run(read_theta(person) * [40, 40, 1, 1, 1])).all()


@pytest.mark.parametrize("position", [0, 2, 4])
def test_change_of_a_parameter_is_that_of_the_loop(world, position):
    simulator, theta = world.simulator(begin=50), read_theta(world.person)
    base = simulator.run(theta)
    step = 1e-3 * simulator.size(position, theta[position])
    moved = theta.copy()
    moved[position] += step
    change = simulator.run_with_change(position, moved[position]) - base
    rerun = world.simulator(begin=50)
    rerun.run(theta)
    difference = rerun.run(moved) - base
    assert np.std(change - difference) < 0.02 * np.std(difference)
    # without the loop it is another one
    opened = Simulator(world.core, Effects([]), world.record)
    start = opened.run(theta)
    apart = opened.run_with_change(position, moved[position]) - start
    assert np.std(apart - difference) > 0.1 * np.std(difference)


def test_unstable_loop_is_nan_without_warning(world):
    simulator = world.simulator(begin=100)
    theta = read_theta(world.person)
    before = simulator.run(theta)
    theta[0] *= 40.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        output = simulator.run(theta)
        assert np.isnan(output).all()
        assert Criterion(world.record).sse(output) == np.inf
    again = simulator.run(read_theta(world.person))  # and leaves no trace
    np.testing.assert_allclose(again, before, atol=1e-4 * np.std(before))


def without(record, **changes):
    return replace(record, remembered={}, **changes)


def test_loop_of_an_output_with_gaps_is_unknown_but_not_of_short_runs():
    record = World("1/s", runs=2, seconds=10.0).record
    y, known = record.y.copy(), record.known.copy()
    y[400:, 1], known[400:, 1] = 0.0, False  # a shorter run
    assert find_loop(without(record, y=y, known=known)) is not None
    y, known = record.y.copy(), record.known.copy()
    y[250:300], known[250:300] = 0.0, False  # a gap in between
    assert find_loop(without(record, y=y, known=known)) is None


@pytest.mark.parametrize(
    ("kind", "step"), [("zoh", 0.0), ("foh", 1e-3), ("direct", 0.0)]
)  # of a sensor, in standard deviations
def test_pulse_response_finds_what_the_output_does_between_samples(kind, step):
    world = World("1/(s(s+1))", runs=2)
    element, y = world.element, world.record.y
    held = replace(element, direct=True) if kind == "direct" else element
    b, a = held.discrete(DT, "foh") if kind == "foh" else held.discrete(DT)
    x = lfilter(b, a, y, axis=0) + lfilter(*element.discrete(DT, "foh"), world.disturbance, axis=0)
    if step:
        x = step * x.std() * np.round(x / (step * x.std()))
    channels = {**world.record.channels, "x": x}
    found = choose_pulse_response(element, without(world.record, channels=channels), 150)
    np.testing.assert_array_equal(found[0], b)


def loop_and_open_fit(seed):
    world = World("1/s", remnant=0.5, runs=4, seconds=30.0, seed=seed)
    criterion, start = Criterion(world.record), read_theta(world.person)
    found = []
    for simulator in (
        world.simulator(begin=150),
        Simulator(world.core, Effects([]), world.record),
    ):
        fit = minimise(simulator, criterion, start, max_iter=20)
        found.append(fit.theta / start - 1)
    return found


@pytest.mark.slow
def test_remnant_does_not_bias_the_fit_in_the_loop():
    """That of the measured error is biased, in the gain above all."""
    inside, outside = np.median([loop_and_open_fit(seed) for seed in range(3)], axis=0)
    assert abs(inside[0]) < 0.1
    assert abs(inside[4]) < 0.15
    assert abs(outside[0]) > abs(inside[0])
    assert np.abs(inside[[0, 4]]).max() < np.abs(outside[[0, 4]]).max()
