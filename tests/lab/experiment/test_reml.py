import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

from skhoid.lab.experiment.reml import KenwardRoger, equations, evaluate, reml

SLEEP = Path(__file__).parent / "data" / "sleepstudy.csv"


def draw(seed, interaction=0.5, people=12, conditions=4, runs=5):
    """Rows of unequal weights with some missing: y, X, groups, weights."""
    rng = np.random.default_rng(seed)
    subject, condition, _ = (a.ravel() for a in np.indices((people, conditions, runs)))
    kept = rng.random(subject.size) > 0.1
    kept &= ~((subject == 3) & (condition == 2))
    subject, condition = subject[kept], condition[kept]
    cell = np.unique(subject * conditions + condition, return_inverse=True)[1]
    w = rng.uniform(0.2, 3.0, subject.size)
    y = (
        10.0
        + rng.normal(size=people)[subject]
        + interaction * rng.normal(size=cell.max() + 1)[cell]
    )
    return (
        y + rng.normal(size=y.size) / np.sqrt(w),
        np.eye(conditions)[condition],
        [subject, cell],
        w,
    )


class Dense:
    """The same model with matrices of the size of the data."""

    def __init__(self, y, X, groups, w):
        self.y, self.X = y, X
        Z = [np.eye(codes.max() + 1)[codes] for codes in groups]
        self.G = [z @ z.T for z in Z] + [np.diag(1.0 / w)]

    def parts(self, variances):
        V = sum(v * G for v, G in zip(variances, self.G, strict=True))
        inverse = np.linalg.inv(V)
        phi = np.linalg.inv(self.X.T @ inverse @ self.X)
        return V, inverse, phi, phi @ self.X.T @ inverse @ self.y

    def criterion(self, variances):
        V, inverse, phi, beta = self.parts(variances)
        rest = self.y - self.X @ beta
        n, p = self.X.shape
        return (
            np.linalg.slogdet(V)[1]
            - np.linalg.slogdet(phi)[1]
            + rest @ inverse @ rest
            + (n - p) * np.log(2.0 * np.pi)
        )

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
    at = reml(equations(data["reaction"].to_numpy(), X, [pd.factorize(data["subject"])[0]]))
    assert round(at.criterion, 1) == 1786.5
    assert at.variances.round(1).tolist() == [1378.2, 960.5]
    assert at.beta.round(4).tolist() == [251.4051, 10.4673]
    assert np.sqrt(np.diag(at.covariance)).round(4).tolist() == [9.7467, 0.8042]
    # lmerTest 3.1 with ddf="Kenward-Roger" prints 22.8102 and 161.
    assert KenwardRoger(at).rows(np.eye(2))[2].round(4).tolist() == [22.8102, 161.0]


@pytest.mark.parametrize("interaction", [0.5, 0.0])
def test_equals_a_dense_likelihood_maximised_by_another_method(interaction):
    y, X, groups, w = draw(1, interaction, people=6, conditions=3, runs=3)
    dense = Dense(y, X, groups, w)
    at = reml(equations(y, X, groups, w))
    assert at.criterion == pytest.approx(dense.criterion(at.variances), abs=1e-9)
    found = optimize.minimize(
        lambda log: dense.criterion(np.exp(log)),
        np.zeros(3),
        method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 600},
    )
    np.testing.assert_allclose(at.variances, np.exp(found.x), atol=1e-4)
    np.testing.assert_allclose(at.beta, dense.parts(np.exp(found.x))[3], atol=1e-4)
    assert at.criterion <= found.fun + 1e-8


def test_adjusted_covariance_is_that_of_the_paper():
    y, X, groups, w = draw(2)
    at = reml(equations(y, X, groups, w))
    adjusted, of_variances = Dense(y, X, groups, w).kenward_roger(at.variances)
    kr = KenwardRoger(at)
    np.testing.assert_allclose(kr.covariance, adjusted, rtol=1e-9)
    np.testing.assert_allclose(kr.variance_covariance, of_variances, rtol=1e-8)


def test_gradient_and_hessian_are_those_of_differences():
    y, X, groups, w = draw(3)
    data = equations(y, X, groups, w)
    v = np.array([0.7, 0.3, 1.2])
    slope, _, hessian = evaluate(data, v).gradient()
    step = 1e-5 * np.eye(3)
    differences = [
        (evaluate(data, v + s).criterion - evaluate(data, v - s).criterion) / 4e-5 for s in step
    ]
    np.testing.assert_allclose(slope, differences, rtol=1e-6)
    seconds = [
        (evaluate(data, v + s).gradient()[0] - evaluate(data, v - s).gradient()[0]) / 2e-5
        for s in step
    ]
    np.testing.assert_allclose(hessian, seconds, rtol=1e-6)


def test_balanced_data_give_the_split_plot_analysis():
    """F, degrees of freedom and p are exact in balanced data."""
    rng = np.random.default_rng(4)
    subject, condition, _ = (a.ravel() for a in np.indices((8, 3, 4)))
    cell = subject * 3 + condition
    y = rng.normal(size=8)[subject] + rng.normal(size=24)[cell] + rng.normal(size=96)
    at = reml(equations(y, np.eye(3)[condition], [subject, cell]))
    test = KenwardRoger(at).test(np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]))
    means = y.reshape(8, 3, 4).mean(axis=2)
    rest = means - means.mean(axis=1, keepdims=True)
    expected = 7 * 8 * np.sum(rest.mean(axis=0) ** 2) / np.sum((rest - rest.mean(axis=0)) ** 2)
    np.testing.assert_allclose(test.F, expected, rtol=1e-6)
    assert (test.df1, test.df2) == (2.0, pytest.approx(14.0, rel=1e-6))
    assert test.p == pytest.approx(stats.f.sf(expected, 2, 14), rel=1e-5)


def test_scale_of_the_data_does_not_matter():
    y, X, groups, w = draw(5, interaction=0.0)
    one = reml(equations(y, X, groups, w))
    other = reml(equations(1e-5 * y, X, groups, 1e4 * w))
    np.testing.assert_allclose(other.variances[:2], 1e-10 * one.variances[:2], rtol=1e-4)
    np.testing.assert_allclose(other.beta, 1e-5 * one.beta, rtol=1e-6)


def test_what_cannot_be_estimated_is_said():
    with pytest.raises(ValueError, match="do not determine"):
        equations(np.ones(3), np.ones((3, 2)), [])
    with pytest.raises(ValueError, match="do not scatter"):
        reml(equations(np.ones(9), np.ones((9, 1)), [np.repeat([0, 1, 2], 3)]))


@pytest.mark.slow
def test_is_never_above_statsmodels():
    """Which stops above the optimum in some of these, and never below ours."""
    module = pytest.importorskip("statsmodels.regression.mixed_linear_model")
    apart = []
    for seed in range(20):
        y, X, groups, w = draw(seed)
        subject, cell = groups
        root = np.sqrt(w)
        members = [np.flatnonzero(subject == p) for p in range(12)]
        cells = [np.unique(cell[of]) for of in members]
        mats = [
            root[of, None] * (cell[of, None] == c) for of, c in zip(members, cells, strict=True)
        ]
        names = [list(map(str, c)) for c in cells]
        model = module.MixedLM(
            root * y, root[:, None] * X, groups=subject, exog_re=root[:, None],
            exog_vc=module.VCSpec(["cell"], [names], [mats]),
        )  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            theirs = -2.0 * model.fit(reml=True).llf
        ours = reml(equations(y, X, groups, w)).criterion + np.log(w).sum()
        apart.append(theirs - ours)
    assert min(apart) > -1e-6
    assert np.median(apart) < 1e-3
