"""REML and the tests of Kenward and Roger, against lme4, statsmodels and dense matrices."""

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

from skhoid.lab.experiment.reml import fit_reml

SLEEP = Path(__file__).parent / "data" / "sleepstudy.csv"


def draw(seed, between=1.0, people=9, conditions=4):
    """Cells of unequal weights with some missing: y, X, group, weights."""
    rng = np.random.default_rng(seed)
    subject, condition = (a.ravel() for a in np.indices((people, conditions)))
    kept = (rng.random(subject.size) > 0.1) | (subject == condition)
    subject, condition = subject[kept], condition[kept]
    w = rng.uniform(0.2, 3.0, subject.size)
    y = 10.0 + between * rng.normal(size=people)[subject]
    return (
        y + rng.normal(size=y.size) / np.sqrt(w),
        np.eye(conditions)[condition],
        np.unique(subject, return_inverse=True)[1],
        w,
    )


class Dense:
    """The same model with matrices of the size of the data."""

    def __init__(self, y, X, group, w):
        self.y, self.X = y, X
        Z = np.eye(group.max() + 1)[group]
        self.G = [Z @ Z.T, np.diag(1.0 / w)]

    def parts(self, variances):
        V = sum(v * G for v, G in zip(variances, self.G, strict=True))
        inverse = np.linalg.inv(V)
        phi = np.linalg.inv(self.X.T @ inverse @ self.X)
        return V, inverse, phi, phi @ self.X.T @ inverse @ self.y

    def criterion(self, variances):
        V, inverse, phi, beta = self.parts(variances)
        rest = self.y - self.X @ beta
        n, p = self.X.shape
        logs = np.linalg.slogdet(V)[1] - np.linalg.slogdet(phi)[1]
        return logs + rest @ inverse @ rest + (n - p) * np.log(2.0 * np.pi)

    def kenward_roger(self, variances):
        """Adjusted covariance, and covariance of the variances, as the paper has them."""
        _, inverse, phi, _ = self.parts(variances)
        XV = self.X.T @ inverse
        P = inverse - XV.T @ phi @ XV
        w = np.linalg.inv([[0.5 * np.trace(P @ a @ P @ b) for b in self.G] for a in self.G])
        slopes = [-XV @ G @ XV.T for G in self.G]
        inner = sum(
            w[i, j] * (XV @ a @ inverse @ b @ XV.T - slopes[i] @ phi @ slopes[j])
            for i, a in enumerate(self.G)
            for j, b in enumerate(self.G)
        )
        return phi + 2.0 * phi @ inner @ phi, w


def test_sleepstudy_is_as_lme4_has_it():
    """Reaction ~ Days + (1 | Subject), as lme4 prints it: REML 1786.5, 1378.2, 960.5."""
    data = pd.read_csv(SLEEP)
    X = np.column_stack([np.ones(180), data["days"]])
    group = pd.factorize(data["subject"])[0]
    fit = fit_reml(data["reaction"].to_numpy(), X, group, np.ones(180))
    assert round(fit.criterion, 1) == 1786.5
    assert fit.variances.round(1).tolist() == [1378.2, 960.5]
    assert fit.beta.round(4).tolist() == [251.4051, 10.4673]
    assert np.sqrt(np.diag(fit.plain)).round(4).tolist() == [9.7467, 0.8042]
    # lmerTest 3.1 with ddf="Kenward-Roger" prints 22.8102 and 161.
    assert fit.estimate(np.eye(2))[2].round(4).tolist() == [22.8102, 161.0]


@pytest.mark.parametrize("seed", [1, 2])
def test_equals_a_dense_likelihood_maximised_by_another_method(seed):
    given = draw(seed)
    dense, fit = Dense(*given), fit_reml(*given)
    assert fit.criterion == pytest.approx(dense.criterion(fit.variances), abs=1e-9)
    found = optimize.minimize(
        lambda log: dense.criterion(np.exp(log)),
        np.zeros(2),
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-10},
    )
    np.testing.assert_allclose(fit.variances, np.exp(found.x), rtol=1e-4)
    np.testing.assert_allclose(fit.beta, dense.parts(np.exp(found.x))[3], atol=1e-5)
    adjusted, of_variances = dense.kenward_roger(fit.variances)
    np.testing.assert_allclose(fit.covariance, adjusted, rtol=1e-9)
    np.testing.assert_allclose(fit.variance_covariance, of_variances, rtol=1e-8)


def test_people_who_do_not_differ_have_a_variance_of_zero():
    fits = [fit_reml(*draw(seed, between=0.0)) for seed in range(12)]
    assert any(fit.variances[0] == 0.0 for fit in fits)
    assert all(fit.variances[0] >= 0.0 and np.isfinite(fit.criterion) for fit in fits)


def test_balanced_data_give_the_analysis_of_repeated_measures():
    """F, degrees of freedom and p are exact in balanced data."""
    rng = np.random.default_rng(4)
    subject, condition = (a.ravel() for a in np.indices((8, 3)))
    y = rng.normal(size=8)[subject] + 0.5 * rng.normal(size=24)
    fit = fit_reml(y, np.eye(3)[condition], subject, np.ones(24))
    test = fit.test(np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]))
    values = y.reshape(8, 3)
    rest = values - values.mean(axis=1, keepdims=True)
    expected = 7 * 8 * np.sum(rest.mean(axis=0) ** 2) / np.sum((rest - rest.mean(axis=0)) ** 2)
    np.testing.assert_allclose(test.F, expected, rtol=1e-6)
    assert (test.df1, test.df2) == (2.0, pytest.approx(14.0, rel=1e-6))
    assert test.p == pytest.approx(stats.f.sf(expected, 2, 14), rel=1e-5)


def test_scale_of_the_data_does_not_matter():
    y, X, group, w = draw(5)
    one, other = fit_reml(y, X, group, w), fit_reml(1e-5 * y, X, group, 1e4 * w)
    np.testing.assert_allclose(other.variances, np.array([1e-10, 1e-6]) * one.variances, rtol=1e-4)
    np.testing.assert_allclose(other.beta, 1e-5 * one.beta, rtol=1e-6)


def test_what_cannot_be_estimated_is_said():
    with pytest.raises(ValueError, match="do not determine"):
        fit_reml(np.arange(3.0), np.ones((3, 2)), None, np.ones(3))
    with pytest.raises(ValueError, match="do not scatter"):
        fit_reml(np.ones(9), np.ones((9, 1)), np.repeat([0, 1, 2], 3), np.ones(9))


def test_is_never_above_statsmodels():
    module = pytest.importorskip("statsmodels.regression.mixed_linear_model")
    for seed in range(4):
        y, X, group, w = draw(seed)
        root = np.sqrt(w)
        model = module.MixedLM(root * y, root[:, None] * X, group, root[:, None])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            theirs = -2.0 * model.fit(reml=True).llf
        apart = theirs - fit_reml(y, X, group, w).criterion - np.log(w).sum()
        assert -1e-6 < apart < 1e-3
