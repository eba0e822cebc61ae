"""The delay by the likelihood of impulse responses: noise on the output does not move it."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import cont2discrete, lfilter
from sklearn.pipeline import make_pipeline

from skhoid import ARXRegressor, Decimator, DelaySearchCV

SYSTEMS = {
    "resonant": ([9.0], [1.0, 1.8, 9.0], 0.1, 5),
    "fast sampling": ([100.0], [1.0, 10.0, 100.0], 0.02, 12),
    "first order": ([2.0], [0.5, 1.0], 0.1, 7),
    "lead": ([1.0, 2.0], [1.0, 4.0, 9.0], 0.05, 9),
    "integral": ([1.0], [1.0, 0.1], 0.1, 3),
}


def recording(name, noise, seed, kind, n=1500, colour=(1.0,)):
    num, den, dt, delay = SYSTEMS[name]
    rng = np.random.default_rng(seed)
    b, a, _ = cont2discrete((num, den), dt)
    u = lfilter([0.3], [1, -0.7], rng.standard_normal(n))
    if kind == "steps":
        u = np.repeat(rng.standard_normal(n // 25), 25)
    y = lfilter(np.r_[np.zeros(delay), b.ravel()], a, u)
    rest = lfilter([1.0], colour, rng.standard_normal(n))
    return u[:, None], y + noise * y.std() / rest.std() * rest, dt, delay + 1


def off(criterion, *asked, **options):
    X, y, dt, truth = recording(*asked, **options)
    search = DelaySearchCV(ARXRegressor(dt=dt), nk=range(1, 31), criterion=criterion).fit(X, y)
    return search.best_nk_ - truth


@pytest.mark.parametrize(
    ("name", "kind"),
    [*((name, "noise") for name in SYSTEMS), ("lead", "steps"), ("integral", "steps")],
)
def test_noise_does_not_move_the_delay(name, kind):
    assert abs(off("impulse", name, 0.1, 100, kind)) <= (
        1 if kind == "steps" or name == "fast sampling" else 0
    )


def test_the_one_step_error_is_moved():
    one_step = [abs(off("one_step", "fast sampling", 0.1, s, "noise")) for s in (110, 111)]
    impulse = [abs(off("impulse", "fast sampling", 0.1, s, "noise")) for s in (110, 111)]
    assert np.mean(one_step) > 1
    assert np.mean(impulse) < 0.5


def test_coloured_noise_does_not_either():
    assert abs(off("impulse", "first order", 0.2, 7, "noise", colour=(1.0, -1.6, 0.9))) <= 1


def test_several_inputs_runs_and_gaps():
    rng = np.random.default_rng(3)
    X, y = [], []
    for _ in range(3):
        U = rng.standard_normal((500, 2))
        clean = lfilter([0, 0, 0, 0, 1.0], [1, -0.8], U[:, 0])
        clean += lfilter([0, 0, 0.7], [1, -0.8], U[:, 1])
        X.append(U)
        y.append(clean + 0.5 * rng.standard_normal(500) + 30.0)
    index = pd.MultiIndex.from_product([range(3), np.arange(500) * 0.1], names=["run", "time"])
    X = pd.DataFrame(np.concatenate(X), index=index, columns=["a", "b"])
    y = pd.Series(np.concatenate(y), index=index)
    y.iloc[700:720] = np.nan
    nk = [(i, j) for i in range(1, 7) for j in range(1, 5)]
    model = ARXRegressor(1, 1, fit_intercept=True)
    with pytest.warns(UserWarning, match="NaN"):
        search = DelaySearchCV(model, nk=nk, criterion="impulse").fit(X, y)
    assert search.best_nk_ == (4, 2)
    assert "likelihood of an impulse response" in str(search.summary())


def test_units_and_short_records_do_not_matter():
    X, y, dt, truth = recording("first order", 0.05, 1, "noise", n=200)
    for size in (1.0, 1e-6, 1e6):
        search = DelaySearchCV(ARXRegressor(dt=dt), nk=range(1, 16), criterion="impulse")
        assert search.fit(X * size, y / size).best_nk_ == truth


def test_behind_a_decimator():
    X, y, dt, truth = recording("resonant", 0.02, 1, "noise", n=3000)
    index = pd.MultiIndex.from_product([[1], np.arange(3000) * dt], names=["run", "time"])
    pipe = make_pipeline(Decimator(2, method="downsample"), ARXRegressor())
    search = DelaySearchCV(pipe, nk=range(1, 10), criterion="impulse")
    search.fit(pd.DataFrame({"u": X[:, 0]}, index=index), pd.Series(y, index=index))
    assert search.best_delay_ == pytest.approx(truth * dt, abs=0.2)
