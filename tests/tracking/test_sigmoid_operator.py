"""Maximum likelihood with sigmoids: what it finds, and how certain it says that is."""

import numpy as np
import pytest
from scipy.special import expit
from support import window_twin as twin

from skhoid import make_tracking_runs
from skhoid.tracking.operator_fitting import OperatorFit
from skhoid.tracking.sigmoid_operator import SigmoidOperator, followed

DT = 0.01
ENDS = {"K_e": (0.09, 0.07), "K_edot": (0.036, 0.084)}


def made(rate, middle, n=6000, noise=0.0, seed=0, omega=(11.25, 11.25)):
    """An error and the output of an operator whose gains, and maybe frequency, change."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    omegas = np.array([0.4, 1.1, 2.3, 3.7, 5.9, 8.3, 12.1])
    e = np.sin(np.outer(t, omegas) + rng.uniform(0, 6, 7)) @ (1 / (1 + omegas / 3))
    share = expit(rate * (t - 0.28 - middle))
    gains = [a + (b - a) * share for a, b in ENDS.values()]
    frequency = omega[0] + (omega[1] - omega[0]) * share if omega[0] != omega[1] else omega[0]
    y = twin.output(e, 0, n, DT, *gains, frequency, 0.35, 0.28)
    return e[:, None], y + noise * rng.standard_normal(n)


def test_without_remnant_the_change_is_found():
    X, y = made(1.3, 27.0)
    model = SigmoidOperator(dt=DT, inputs=[0]).fit(X, y)
    for name, (before, after) in ENDS.items():
        row = model.transition_.loc[name]
        assert row["initial"] == pytest.approx(before, rel=1e-3)
        assert row["final"] == pytest.approx(after, rel=1e-3)
        assert row["rate"] == pytest.approx(1.3, rel=5e-3)
        assert row["time"] == pytest.approx(27.0, abs=5e-3)
    for name, value in {"tau_e": 0.28, "omega_nm": 11.25, "zeta_nm": 0.35}.items():
        assert model.parameters_.value[name] == pytest.approx(value, rel=1e-3)
    assert model.likelihood_ratio_ > 1000
    # Predictions have gains act on the error's rate, not the rate of gain times error.
    away = abs(model.predict(X) - y)
    assert away[500:2000].max() < 1e-3 * y.std()
    assert away[3500:].max() < 1e-3 * y.std()
    assert away[2000:3500].max() < 0.15 * y.std()


def test_the_path_is_the_sigmoid_of_the_transition():
    X, y = make_tracking_runs("C3", n_runs=1, remnant_intensity=0.1, random_state=4)
    model = SigmoidOperator().fit(X, y)
    path, row = model.parameters_path_, model.transition_.loc["K_e"]
    share = expit(row["rate"] * (path.index.to_numpy() - row["time"]))
    expected = row["initial"] + (row["final"] - row["initial"]) * share
    np.testing.assert_allclose(path["K_e"], expected, rtol=1e-12)
    assert path["sd_K_e"].iloc[0] == pytest.approx(row["sd_initial"], rel=1e-3)
    assert path["sd_K_e"].iloc[-1] == pytest.approx(row["sd_final"], rel=1e-3)
    assert path["sd_K_edot"].loc[38:44].max() > 1.5 * path["sd_K_edot"].iloc[0]
    assert path["sd_T_L"].notna().all()
    assert np.ptp(path["omega_nm"]) == 0


@pytest.mark.parametrize("which", range(4))
def test_derivatives_of_the_path(which):
    share_of = np.array([0, 1, 0, -1])
    gains = np.array([0.09, 0.04, -0.02, 0.05])
    dynamics = np.array([2.3, -0.7, 0.28, 2.6, 0.0, 0.5, 3.0, 1.1, 4.0])
    free = np.array([0, 1, 2, 3, 5, 6, 7, 8])
    t = np.linspace(0, 8, 30)

    def path(theta):
        q = dynamics.copy()
        q[free] = theta[4:]
        zero = np.zeros((12, 12))
        fit = OperatorFit(theta[:4], q, np.zeros(0), free, np.zeros(8, bool), 1.0, 100, zero)
        return followed(fit, share_of, which, t)

    theta = np.concatenate([gains, dynamics[free]])
    _, slopes = path(theta)
    for i, step in enumerate(1e-6 * np.eye(12)):
        difference = (path(theta + step)[0] - path(theta - step)[0]) / 2e-6
        np.testing.assert_allclose(slopes[:, i], difference, atol=1e-7)


@pytest.mark.slow
def test_frequency_may_have_a_sigmoid_too():
    X, y = made(3.0, 22.0, noise=0.002, omega=(8.0, 12.0))
    model = SigmoidOperator(varying=("K_edot", "K_e", "omega_nm"), dt=DT, inputs=[0]).fit(X, y)
    found = model.transition_
    assert list(found.index) == ["K_e", "K_edot", "omega_nm"]
    assert found.loc["omega_nm", ["initial", "final"]].tolist() == pytest.approx([8, 12], rel=0.03)
    assert found.loc["K_edot", ["initial", "final"]].tolist() == pytest.approx(
        [0.036, 0.084], rel=0.03
    )
    assert abs(found["time"] - 22.0).max() < 0.5
    assert np.ptp(found["time"]) == 0


@pytest.mark.slow
def test_without_a_change_the_likelihood_hardly_grows():
    X, y = make_tracking_runs("C1", n_runs=1, remnant_intensity=0.15, random_state=5)
    model = SigmoidOperator().fit(X, y)
    assert 0 <= model.likelihood_ratio_ < 20
    assert model.constant_["K_e"] == pytest.approx(0.09, rel=0.15)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"varying": ()}, "varying must list"),
        ({"varying": ("tau_e",)}, "varying must list"),
        ({"varying": ("K_e", "K_e")}, "varying must list"),
    ],
)
def test_bad_options_are_refused(options, match):
    X, y = made(1.3, 5.0, n=1000)
    with pytest.raises(ValueError, match=match):
        SigmoidOperator(dt=DT, inputs=[0], **options).fit(X, y)
