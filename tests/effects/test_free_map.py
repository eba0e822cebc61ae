"""Free maps as forces of the output and its rate, and of an output whose sign is hidden."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import decimate, lfilter
from support.places import RECORDINGS
from support.synthetic import run_time

from skhoid import ARXRegressor, OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import FreeMap, Friction, HardeningStiffness
from skhoid.effects.operator_signals import Spring
from skhoid.model.estimator import vaf_of_output
from skhoid.model.extend import extended
from skhoid.model.fitting import Criterion
from skhoid.model.smoothing import posterior_of


def needs(folder):
    found = (RECORDINGS / folder).exists()
    return pytest.mark.skipif(not found, reason="needs ../shared/data, which is not bundled")


def table(x, y, dt):
    index = run_time([len(x)], dt=dt)
    return pd.DataFrame({"x": x}, index), pd.Series(y, index, name="y")


def added(estimator, X, y, effect):
    """The model with the effect, and the effect with its values."""
    prepared = estimator.prepare(X, y)
    criterion = Criterion(prepared.record)
    base = estimator.first_fit(prepared)
    model = extended(base, effect.name, effect, criterion, criterion.coarse())
    found = dict(model.effects.steps)[effect.name]
    values = {k.split("__")[1]: v for k, v in model.values().items() if "__" in k}
    return model, found.with_values(values)


def vaf(model):
    return vaf_of_output(model.simulator.record, model.output)


def bend(force, at):
    """A curve less its straight line, by least squares over points."""
    line = np.stack([np.ones_like(at), at], axis=1)
    return force - line @ np.linalg.lstsq(line, force, rcond=None)[0]


def central(signal):
    low, high = np.quantile(signal, [0.025, 0.975])
    return signal[(signal >= low) & (signal <= high)]


def force_of(effect, at):
    return effect.curve(np.asarray(effect.values), at)


def cosine(a, b):
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def test_a_force_by_a_table_is_the_curve():
    knots = tuple(np.linspace(-1.0, 2.0, 7).tolist())
    effect = FreeMap(at="spring", knots=knots, values=tuple((np.array(knots) ** 2).tolist()))
    at = np.linspace(-2.0, 3.0, 41)
    expected = force_of(effect, at) - force_of(effect, np.zeros(1))
    got = effect.apply(Spring(), None).force(at)
    np.testing.assert_allclose(got, expected, atol=5e-5)
    rate = FreeMap(at="rate", knots=knots, values=effect.values).apply(Spring(), None)
    np.testing.assert_allclose(rate.force(np.zeros_like(at), at), expected, atol=5e-5)


def test_forces_have_no_line_and_are_zero_at_rest():
    knots = tuple(np.linspace(-1.0, 2.0, 7).tolist())
    effect = FreeMap(at="spring", knots=knots)
    given = effect.with_values({p.name: 1.0 for p in effect.free})
    assert force_of(given, np.zeros(1)) == pytest.approx(0.0, abs=1e-12)
    assert np.polyfit(knots, given.values, 1)[0] == pytest.approx(0.0, abs=1e-9)
    total = effect.design(np.array([0.3])).sum()
    assert total == pytest.approx(float(force_of(given, np.array([0.3]))[0]))


@pytest.mark.parametrize("at", ["spring", "rate"])
def test_places_and_words(at):
    effect = FreeMap(at=at)
    assert effect.place == "spring"
    assert effect.over == {"spring": "u", "rate": "du/dt"}[at]
    assert "force against the command" in effect.sentence


@pytest.mark.slow
def test_the_spring_of_a_limb_is_found_as_a_shape():
    """Within 30 % of its rms over the central 95 %, beside remnant of a tenth of the output.

    The fit of least simulation error has the bias of the loop; 24 % here.
    """
    X, y = make_tracking_runs(
        condition="C1",
        n_runs=5,
        remnant_intensity=0.1,
        random_state=0,
        effects=HardeningStiffness(stiffness=30.0, form="cubic"),
    )
    _, effect = added(OperatorRegressor(), X, y, FreeMap(at="spring"))
    at = central(y.to_numpy())
    # The curve has no linear part: the limb is as much stiffer, and forces are relative to that.
    knots = np.array(effect.knots)
    stiffer = 1 + 30.0 * np.sum(knots**4) / np.sum(knots**2)
    expected = bend(30.0 * at**3 / stiffer, at)
    got = bend(force_of(effect, at), at)
    assert np.std(got - expected) < 0.3 * np.std(expected)


@pytest.mark.slow
def test_the_friction_of_a_limb_is_found_as_a_shape():
    """Within 20 % of its rms over the central 95 %, less straight lines."""
    knots = (-2.0, -1.0, -0.5, -0.2, -0.1, -0.03, 0.0, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0)
    friction = tuple((0.05 * np.tanh(np.array(knots) / 0.1)).tolist())
    true = FreeMap(at="rate", knots=knots, values=friction)
    X, y = make_tracking_runs(
        condition="C1", n_runs=5, remnant_intensity=0.1, random_state=0, effects=true
    )
    model, effect = added(OperatorRegressor(), X, y, FreeMap(at="rate"))
    rate = np.diff(model.simulator.record.y, axis=0) / model.simulator.record.dt
    at = central(rate.ravel())
    expected = bend(force_of(true, at), at)
    assert np.std(bend(force_of(effect, at), at) - expected) < 0.2 * np.std(expected)


@pytest.mark.slow
@pytest.mark.parametrize("at", ["spring", "rate"])
def test_nothing_is_a_straight_line(at):
    X, y = make_tracking_runs(condition="C1", n_runs=2, remnant_intensity=0.1, random_state=3)
    model, effect = added(OperatorRegressor(), X, y, FreeMap(at=at))
    criterion = Criterion(model.simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    dof = posterior_of(model, criterion).dof[-len(effect.knots) + 2 :]
    assert dof.sum() < 4.0, "of nine or thirteen"


def duffing(n=4000, seed=0):
    """A second-order ARX system with a cubic force of its output."""
    rng = np.random.default_rng(seed)
    x = np.convolve(rng.standard_normal(n), np.ones(4) / 2, "same")
    y = np.zeros(n)
    for k in range(2, n):
        force = 0.3 * y[k - 1] ** 3
        y[k] = 1.5 * y[k - 1] - 0.7 * y[k - 2] + 0.25 * (x[k - 1] - force)
    return table(x, y + 0.01 * rng.standard_normal(n), 0.02)


def test_a_fit_with_a_spring_of_any_shape_through_the_public_class():
    X, y = duffing()
    plain = ARXRegressor(2, 1, 1).fit(X, y)
    model = SimulatedARX(2, 1, 1, effects=FreeMap(at="spring")).fit(X, y)
    left = [float(np.mean((y - m.predict(X)) ** 2) / np.mean(y**2)) for m in (plain, model)]
    assert left[1] < 0.1 * left[0]
    assert left[1] < 0.002


@pytest.mark.slow
@needs("silverbox")
@pytest.mark.parametrize(("orders", "most"), [((2, 3, 0), 0.06), ((2, 1, 1), 0.08)])
def test_the_spring_of_the_silverbox(orders, most):
    """Its odd part is the cubic, which has no even one; SOURCE.md: it has a small square too."""
    pytest.importorskip("pyarrow")
    data = pd.read_parquet(RECORDINGS / "silverbox" / "SNLS80mV.parquet")[40_700:57_084]
    X, y = table(data["V1"].to_numpy(), data["V2"].to_numpy(), 2**14 / 1e7)
    estimator = SimulatedARX(*orders, fit_intercept=True, settling=0.1)
    named_model, named = added(estimator, X, y, HardeningStiffness(form="cubic"))
    model, effect = added(estimator, X, y, FreeMap(at="spring"))
    at = central(y.to_numpy())
    got = bend((force_of(effect, at) - force_of(effect, -at)) / 2, at)
    expected = bend(named.stiffness * at**3, at)
    assert np.std(got - expected) < most * np.std(expected)
    assert vaf(model) > vaf(named_model) - 0.001


@pytest.mark.slow
@needs("coupled_electric_drives")
@pytest.mark.parametrize("record", [1, 2, 3])
def test_the_speed_sensor_of_the_drives_shows_no_sign(record):
    data = pd.read_csv(RECORDINGS / "coupled_electric_drives" / "DATAPRBS.csv")[:300]
    X, y = table(data[f"u{record}"].to_numpy(), data[f"z{record}"].to_numpy(), 0.02)
    model, effect = added(ARXRegressor(3, 3, 1), X, y, FreeMap(at="output"))
    assert effect.folded
    at = np.array(effect.knots)
    shape = at + np.array(effect.values)
    assert cosine(shape - shape.mean(), np.abs(at) - np.abs(at).mean()) > 0.9
    assert vaf(model) > 97


def test_a_fold_changes_nothing_where_it_is_greatest():
    form = FreeMap(at="output", knots=(-2.0, -1.0, 0.0, 1.0, 2.0), folded=True)
    assert len(form.parameters) == len(form.knots) - 1
    assert np.abs(form.design(np.array([2.0]))).max() < 1e-12
    (start,) = form.starts(None)
    fold = form.with_values(start)
    signal = np.array([-2.0, -0.5, 0.5, 1.5, 2.0])
    by_values, by_coefficients = fold.apply(signal, None), form.apply(signal, None, **start)
    np.testing.assert_allclose(by_coefficients, by_values, atol=1e-12)
    np.testing.assert_allclose(fold.values, [4.0, 2.0, 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(by_values[[0, -1]], [2.0, 2.0], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "gain"), [(1, 0.02), (2, 1.0)])
def test_a_sensor_without_sign_is_a_fold_over_the_range_of_its_output(seed, gain):
    """Without a unit of its own the signal has that of what the sensor shows where it is greatest.

    A fold of any other size would be as good, with curves where the output never is.
    """
    rng = np.random.default_rng(seed)
    x = np.repeat(rng.choice([-1.0, 1.0], 60), rng.integers(3, 12, 60))
    moved = lfilter([0.0, gain, 0.4 * gain], [1.0, -1.6, 0.75], x)
    y = np.abs(moved) + 0.02 * np.std(moved) * rng.standard_normal(x.size)
    model, effect = added(ARXRegressor(2, 2, 1), *table(x, y, 0.02), FreeMap(at="output"))
    assert effect.folded
    assert max(effect.knots) == pytest.approx(y.max())
    at = np.array(effect.knots)
    shape = at + np.array(effect.values)
    assert cosine(shape - shape.mean(), np.abs(at) - np.abs(at).mean()) > 0.97
    assert vaf(model) > 99


@pytest.mark.slow
@needs("emps")
def test_the_friction_of_a_slide_has_the_sign_of_its_speed():
    pytest.importorskip("pyarrow")
    data = pd.read_parquet(RECORDINGS / "emps" / "DATA_EMPS.parquet")
    place, force = (decimate(decimate(data[name].to_numpy(), 10), 5) for name in ("qm", "vir"))
    X, y = table(35.15 * force, place, 0.05)
    estimator = ARXRegressor(2, 1, 1, fit_intercept=True)
    named_model, _ = added(estimator, X, y, Friction(form="coulomb", of="rate"))
    model, effect = added(estimator, X, y, FreeMap(at="rate"))
    at = central(np.diff(place) / 0.05)
    assert cosine(bend(force_of(effect, at), at), bend(np.sign(at), at)) > 0.85
    assert vaf(model) > vaf(named_model)
