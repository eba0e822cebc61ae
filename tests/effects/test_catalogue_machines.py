"""Effects of machines in simulated ones: friction, magnitude at the sensor, reflex, filters."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skhoid import ARXRegressor, EffectSearchCV, SimulatedARX
from skhoid.effects import (
    Friction,
    InputFilter,
    RootFlow,
    SensorMagnitude,
    Stops,
    catalogue,
    effect,
)
from skhoid.testing import synthetic_record

DT = 0.02


def wave(n, seed, smooth=40):
    rng = np.random.default_rng(seed)
    return np.convolve(rng.standard_normal(n + smooth), np.ones(smooth), "valid")[:n] / smooth**0.5


def table(y, noise=0.0, seed=1, **channels):
    index = pd.MultiIndex.from_product([["run"], DT * np.arange(len(y))], names=["run", "time"])
    y = y + noise * np.std(y) * np.random.default_rng(seed).standard_normal(len(y))
    return pd.DataFrame(channels, index), pd.Series(y, index, name="out")


def mass_with_friction(seed, coulomb=0.3):
    """Speed of a mass by an exact rule: it sticks below the force, and loses it above."""
    force = wave(1200, seed)
    speed = np.zeros(1200)
    for k in range(1, 1200):
        driven = 0.95 * speed[k - 1] + 0.05 * force[k]
        speed[k] = np.sign(driven) * max(abs(driven) - 0.05 * coulomb, 0.0)
    return table(speed, 0.01, force=force)


def prbs_drive(seed):
    """A drive of third order, seen by its magnitude."""
    levels = np.random.default_rng(seed).choice([-1.0, 1.0], 40)
    u = np.repeat(levels, 10)
    poles = np.poly([0.93, 0.85 * np.exp(0.3j), 0.85 * np.exp(-0.3j)]).real
    speed = lfilter([0.0, 1.0], poles, u)
    return table(np.abs(speed), 0.01, u=u), speed


def joint(seed):
    """Torque of an elastic joint with a reflex on stretch, which is negative here."""
    angle = wave(1500, seed, 15)
    rate = np.gradient(angle, DT)
    stretch = np.maximum(-rate, 0.0)
    reflex = -0.3 * lfilter([0.1], [1.0, -0.9], np.r_[np.zeros(4), stretch[:-4]])
    torque = lfilter([0.5, -0.2], [1.0, -0.3], angle) + reflex
    return table(torque, 0.02, angle=angle)


@pytest.mark.slow
def test_friction_is_named_and_in_units_of_the_force():
    X, y = mass_with_friction(5)
    effects = ["friction", "dead_zone", "stiction", "backlash", "cubic_gain", "bias"]
    search = EffectSearchCV(ARXRegressor(1, 1, inputs=["force"]), effects=effects).fit(X, y)
    assert search.best_effects_ == ["friction"]
    table_ = search.best_estimator_.parameters_
    assert table_.loc["friction__coulomb", "value"] == pytest.approx(0.3, rel=0.05)
    assert table_.loc["friction__viscous", "value"] == pytest.approx(1.0, rel=0.05)


@pytest.mark.slow
def test_a_sensor_of_the_magnitude_is_seen_through():
    (X, y), speed = prbs_drive(7)
    model = SimulatedARX(3, 2, inputs=["u"], effects=SensorMagnitude()).fit(X, y)
    assert np.sqrt(np.mean((model.predict(X) - np.abs(speed)) ** 2)) < 0.02 * np.std(speed)


def test_a_reflex_has_its_side_and_its_delay():
    X, y = joint(3)
    found = SimulatedARX(1, 2, inputs=["angle"], effects="rate_reflex").fit(X, y)
    (_, reflex), *_ = found.effects_
    assert (reflex.side, reflex.sense) == ("negative", 1)
    assert reflex.gain == pytest.approx(0.3, rel=0.2)
    # Its filter takes part of the lag.
    assert reflex.delay == pytest.approx(4 * DT, abs=2 * DT)


def test_a_filter_before_a_dead_zone():
    x = wave(1500, 4, 10)
    w = lfilter([0.2], [1.0, -0.8], x)
    bent = w - np.clip(w, -0.4, 0.4)
    X, y = table(lfilter([0.3], [1.0, -0.7], bent), 0.01, x=x)
    plain, filtered = (
        SimulatedARX(2, 2, inputs=["x"], effects=one).fit(X, y)
        for one in ("dead_zone", InputFilter(form="dead_zone"))
    )
    assert filtered.vaf_ > 99.5 > plain.vaf_ + 1.0
    assert filtered.parameters_.loc["input_filter__width", "value"] == pytest.approx(0.4, rel=0.1)


def test_effects_of_machines_are_not_tried_on_people():
    record = synthetic_record()
    for kind in map(effect, catalogue().index):
        reason = kind.refusal_in(record, "operator")
        assert "human" in kind.domains or reason == "for machines: domain='machine'"
    assert Friction().physics_in("human") == Friction.physics


@pytest.mark.parametrize(
    ("names", "roles", "domain"),
    [
        (("force", "heat"), None, "machine"),
        (("e", "x"), None, "human"),
        (("force", "heat"), {"force": "e", "heat": "x"}, "human"),
    ],
)
def test_the_domain_of_an_arx_model_follows_from_roles(names, roles, domain):
    first, second = names
    x = wave(400, 0)
    X, y = table(lfilter([0.2], [1.0, -0.8], x), 0.05, **{first: x, second: wave(400, 1)})
    model = ARXRegressor(1, 1, inputs=[first], roles=roles)
    ranking = EffectSearchCV(model, effects=["friction", "bias"]).fit(X, y).ranking_
    refused = ranking.set_index("effect").loc["friction", "status"] == "does not apply"
    assert refused == (domain == "human")
    other = "machine" if domain == "human" else "human"
    told = EffectSearchCV(model, effects=["stiction"], domain=other).fit(X, y)
    words = told.ranking_["words"].iloc[0]
    assert words == effect("stiction").physics_in(other)


def tank(seed, top=2.0, noise=0.01):
    """Inflow and level of a tank with Torricelli's outflow, which runs over."""
    rng = np.random.default_rng(seed)
    inflow = np.repeat(rng.uniform(0.0, 1.6, 40), 25)
    level = np.ones(inflow.size)
    for k in range(1, inflow.size):
        risen = level[k - 1] + 0.05 * (inflow[k] - 0.8 * np.sqrt(level[k - 1]))
        level[k] = min(max(risen, 0.0), top)
    return inflow[:, None], level + noise * rng.standard_normal(level.size)


@pytest.mark.slow
def test_a_tank_with_a_root_outflow_that_runs_over():
    X, y = tank(0)
    effects = RootFlow(form="zero") + Stops(form="high")
    found = SimulatedARX(1, 1, 0, dt=1.0, effects=effects, settling=5.0).fit(X, y)
    values = found.parameters_["value"]
    assert values["a1"] == pytest.approx(-1.0, abs=0.002)  # nothing else flows out
    assert values["root_flow__flow"] == pytest.approx(0.8 * np.sqrt(np.std(y)), rel=0.05)
    assert values["stops__high"] == pytest.approx(2.0, abs=0.02)
