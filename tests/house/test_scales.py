"""Other units of X and y: everything scales with them, exactly for powers of two."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    DelayShift,
    EffectSearchCV,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    SimulatedARX,
    compare,
    make_tracking_runs,
)
from skhoid.pipelines import taken_apart

pytestmark = pytest.mark.filterwarnings("ignore:The instrumental-variable estimate")

X, Y = make_tracking_runs(
    "C1",
    2,
    duration=10.24,
    sampling_rate=50,
    remnant_intensity=0.1,
    channels=("e", "x", "f_t"),
    random_state=0,
)
POWERS = [(-120, 120), (120, -120), (30, 0), (-1000, 0), (0, 1000)]
BATCH = ARXRegressor(nk=15)
EXACT = {
    "batch": BATCH,
    "constant": ARXRegressor(nk=15, fit_intercept=True, covariance="hac"),
    "instruments": ARXRegressor(
        nk=15, method="iv", inputs=["e"], instruments=["f_t"], covariance="hac", fit_intercept=True
    ),
    "bias": SimulatedARX(nk=15, fit_intercept=True, effects="dead_zone"),
    "recursive": RecursiveARX(nk=15, memory_time=2.0),
    "variable": RecursiveARX(nk=15, forgetting="variable", fit_intercept=True),
    "smooth": RecursiveARX(nk=15, forgetting="auto", smooth=True, inputs=["e", "f_t"]),
    "horizons": RecursiveARXCV([32.0, 128.0], nk=15),
    "delays": DelaySearchCV(ARXRegressor(), nk=range(13, 17), criterion="vaf"),
    "orders": OrderSearchCV(BATCH, na=[1, 2], nb=[1, 2], nk=[14, 15]),
    "chain": make_pipeline(Decimator(2), DelayShift(0.2), ARXRegressor()),
    "operator": OperatorRegressor(),
    "dead zone": OperatorRegressor(delay=0.28, effects="dead_zone"),
    "stiff": OperatorRegressor(delay=0.28, effects="hardening_stiffness"),
}


def scaled(model, c, d):
    """A model that was fitted in other units, its free run in those of Y, and its score."""
    model = clone(model).fit(X * c, Y * d)
    return model, model.predict(X * c) / d, model.score(X * c, Y * d)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXACT)
def test_other_units_change_nothing_else(name):
    model, expected, score = scaled(EXACT[name], 1.0, 1.0)
    for i, j in POWERS:
        c, d = 2.0**i, 2.0**j
        if max(abs(i), abs(j)) > 130:
            with pytest.raises(ValueError, match=r"too (large|small) to compute with"):
                clone(EXACT[name]).fit(X * c, Y * d)
            continue
        other, found, other_score = scaled(EXACT[name], c, d)
        np.testing.assert_array_equal(found, expected, err_msg=f"2^{i}, 2^{j}")
        assert other_score == pytest.approx(score, abs=1e-9), (i, j)
        last, same = taken_apart(other)[1], taken_apart(model)[1]
        if hasattr(last, "coef_"):
            names = last.parameter_names_
            factor = np.array(
                [1.0 if n[0] == "a" else d if n == "intercept" else d / c for n in names]
            )
            np.testing.assert_array_equal(last.coef_, same.coef_ * factor)
            np.testing.assert_allclose(
                last.standard_errors_, same.standard_errors_ * factor, rtol=1e-9
            )


@pytest.mark.parametrize("name", ["batch", "recursive", "operator"])
def test_other_units_that_are_no_powers_of_two(name):
    _, expected, _ = scaled(EXACT[name], 1.0, 1.0)
    for c, d in ((180 / np.pi, 1.0), (1e-30, 1e30), (1e3, 1e-9)):
        _, found, _ = scaled(EXACT[name], c, d)
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.slow
def test_a_comparison_and_a_search_in_other_units():
    def figures(c, d):
        model = clone(BATCH).fit(X * c, Y * d)
        found = compare(model, X * c, Y * d)
        search = EffectSearchCV(OperatorRegressor(), effects=["dead_zone", "bias"])
        search.fit(X * c, Y * d)
        path = search.error_path_
        return [found.vaf, found.noise_ceiling, found.one_step_vaf, *path["vaf"]], [
            *found.tests["exceeds"],
            *path["effect"],
        ]

    expected, verdicts = figures(1.0, 1.0)
    for i, j in ((-100, 0), (100, -100)):
        found, same = figures(2.0**i, 2.0**j)
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        assert same == verdicts
