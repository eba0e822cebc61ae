import runpy
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats
from support.parameter_tables import simulated
from support.places import ROOT

from skhoid.lab.experiment import mixed_model
from skhoid.lab.experiment.reml import fit_reml

SLEEP = Path(__file__).parent / "data" / "sleepstudy.csv"


@pytest.fixture(scope="module")
def result():
    return mixed_model(simulated(), "K_e")


def small(**options):
    return simulated(people=3, conditions=2, **options)


def test_finds_the_effect_that_was_put_in(result):
    """Within 5 standard errors, and the intervals are those of t."""
    found = result.contrasts
    steps = found["condition"].str[1].astype(int) - found["against"].str[1].astype(int)
    assert np.all(abs(found["difference"] - 0.3 * steps) < 5.0 * found["se"])
    mean = result.effects.set_index("condition")["mean"]
    apart = mean[found["condition"]].to_numpy() - mean[found["against"]].to_numpy()
    np.testing.assert_allclose(found["difference"], apart)
    reach = stats.t.isf(0.025, found["df"]) * found["se"]
    np.testing.assert_allclose(found["high"] - found["difference"], reach)
    assert result.omnibus.df1 == 3.0
    assert result.omnibus.p < 1e-6
    # (P - 1)(C - 1) = 33, but one person lacks a condition.
    assert found["df"].between(31, 33.5).all()
    text = result.summary()
    assert "The conditions differ: F(3, " in text
    assert "no rows of S11 in C4" in text


def test_order_of_rows_and_unit_do_not_matter():
    table = small()
    here = mixed_model(table, "K_e").effects.set_index("condition")
    table = table.sample(frac=1.0, random_state=0)
    table[["estimate", "se"]] *= 1000.0
    other = mixed_model(table, "K_e").effects.set_index("condition").loc[here.index]
    for name in ("mean", "se", "low"):
        np.testing.assert_allclose(other[name], 1000.0 * here[name], rtol=1e-5)


def test_blups_are_drawn_towards_the_mean_and_missing_cells_have_one(result):
    people = result.people.set_index(["subject", "condition"])
    assert people.loc[("S11", "C4"), "n_rows"] == 0
    width = people["high"] - people["low"]
    assert width["S11", "C4"] > width["S11", "C3"]
    means = result.data.groupby(["subject", "condition"])["value"].mean().unstack()
    assert people["estimate"].unstack().std().sum() < means.std().sum()


def test_logarithm_gives_ratios_against_the_reference():
    table = small(effect=0.0)
    table.loc[table["condition"] == "C2", ["estimate", "se"]] *= 1.25
    found = mixed_model(table, "K_e", transform="log", reference="C1")
    row = found.contrasts.iloc[0]
    assert (row["condition"], row["against"]) == ("C2", "C1")
    assert row["ratio"] == pytest.approx(1.25, abs=0.05)
    assert row["ratio"] == pytest.approx(np.exp(row["difference"]))
    assert "C2 / C1" in found.summary()


def test_without_errors_balanced_single_rows_are_the_paired_t_test():
    table = simulated(conditions=2, runs=1).assign(se=np.nan)
    result = mixed_model(table, "K_e")
    assert "no row has a standard error: all count alike" in result.notes
    found = result.contrasts.iloc[0]
    wide = table.pivot_table(index="subject", columns="condition", values="estimate")
    t = stats.ttest_rel(wide["C2"], wide["C1"])
    assert found["t"] == pytest.approx(t.statistic)
    assert found["p"] == pytest.approx(t.pvalue)
    assert found["df"] == pytest.approx(11.0)


def test_one_condition_gives_the_mean_of_people():
    table = simulated(conditions=1, missing=0.0).assign(se=np.nan)
    found = mixed_model(table, "K_e")
    assert found.omnibus is None
    assert found.contrasts.empty
    means = table.groupby("subject")["estimate"].mean()
    row = found.effects.iloc[0]
    assert row["mean"] == pytest.approx(means.mean())
    assert row["se"] == pytest.approx(means.std() / np.sqrt(12.0), rel=1e-5)
    assert row["df"] == pytest.approx(11.0)


def test_scatter_of_runs_beyond_the_errors_is_found():
    """Paule and Mandel's variance, to 4 standard errors of a variance with 400 degrees."""
    rng = np.random.default_rng(0)
    errors = rng.uniform(0.05, 0.2, 500)
    table = pd.DataFrame(
        {
            "subject": np.repeat([f"S{k}" for k in range(100)], 5),
            "run": np.tile(np.arange(5), 100),
            "estimate": rng.normal(size=500) * np.hypot(errors, 0.3),
            "se": errors,
        }
    ).assign(parameter="a", condition="C1", unit="", outlying="", failure="")
    result = mixed_model(table, "a")
    assert result.tau**2 == pytest.approx(0.09, rel=4.0 * np.sqrt(2.0 / 400.0) * 1.2)
    row = result.checks.set_index("check").loc["standard errors"]
    assert not row["ok"]
    assert "further sd" in row["said"]
    assert mixed_model(table.assign(estimate=0.01 * table["estimate"]), "a").tau == 0.0


def test_cells_are_means_of_their_runs_weighted_by_precision():
    result = mixed_model(small(), "K_e")
    runs = result.data.dropna(subset="weight")
    by = [runs["subject"], runs["condition"]]
    np.testing.assert_allclose(runs["weight"].groupby(by).sum(), 1.0)
    w = 1.0 / (runs["value_se"] ** 2 + result.tau**2)
    np.testing.assert_allclose(runs["weight"], w / w.groupby(by).transform("sum"))
    error = 1.0 / np.sqrt(w.groupby(by).sum())
    assert error.rank().tolist() == (1 / runs["cell_weight"].groupby(by).first()).rank().tolist()


def test_rows_left_out_are_counted_and_say_why():
    table = small()
    table.loc[0, "estimate"] = np.nan
    table.loc[1, "outlying"] = "far from the other runs"
    failed = table.iloc[[2]].assign(parameter="", failure="no rows", run="9", estimate=np.nan)
    pooled = table.iloc[[3]].assign(run="all", estimate=9.0)
    table = pd.concat([table, failed, pooled], ignore_index=True)
    found = mixed_model(table, "K_e", outlying="leave_out")
    told = found.data["left_out"].value_counts().to_dict()
    assert (told["no estimate"], told["outlying"], told["the fit failed"]) == (1, 1, 1)
    assert told["a fit of all runs, where they have fits of their own"] == 1
    assert any("1 row left out: the fit failed" in note for note in found.notes)
    assert "outlying" not in set(mixed_model(table, "K_e").data["left_out"])


def test_rows_without_an_error_get_the_largest_of_their_cell():
    table = small()
    table.loc[0, "se"] = np.nan
    result = mixed_model(table, "K_e")
    here = (table["subject"] == "S1") & (table["condition"] == "C1")
    assert result.data.loc[0, "value_se"] == table.loc[here, "se"].max()
    assert any("without a standard error" in note for note in result.notes)


def test_who_changes_the_conclusion_is_named():
    table = simulated(effect=0.0, people=6, conditions=2, interaction=0.0)
    strange = (table["subject"] == "S2") & (table["condition"] == "C2")
    table.loc[table["condition"] == "C2", "estimate"] += 0.25
    table.loc[strange, "estimate"] -= 1.2
    check = mixed_model(table, "K_e").checks.set_index("check").loc["influence"]
    assert not check["ok"]
    assert "without S2" in check["said"]


@pytest.mark.parametrize(
    ("change", "options", "told"),
    [
        ({}, {"parameter": "T_L"}, "no parameter 'T_L'; there are K_e"),
        ({}, {"reference": "C9"}, "reference is one of C1, C2"),
        ({}, {"transform": "sqrt"}, "transform is"),
        ({"subject": "S1", "run": None}, {}, "one person only"),
        ({"estimate": np.nan}, {}, "No row of K_e can be used"),
        ({"run": "1"}, {}, "several rows of the same run: S1, C1, run 1"),
        ({"estimate": -1.0}, {"transform": "log"}, r"not above 0 in 30 rows \(S1, C1, run 1;"),
    ],
)
def test_errors_say_what_to_do(change, options, told):
    table = small(missing=0.0)
    for name, value in change.items():
        table[name] = [str(i) for i in range(len(table))] if value is None else value
    with pytest.raises(ValueError, match=told):
        mixed_model(table, **{"parameter": "K_e"} | options)


def cells_of(seed, between=1.0, people=9, conditions=4):
    """Cells of unequal weights with some missing: y, X, group, weights."""
    rng = np.random.default_rng(seed)
    subject, condition = (a.ravel() for a in np.indices((people, conditions)))
    kept = (rng.random(subject.size) > 0.1) | (subject == condition)
    subject, condition = subject[kept], condition[kept]
    w = rng.uniform(0.2, 3.0, subject.size)
    y = 10.0 + between * rng.normal(size=people)[subject]
    y += rng.normal(size=y.size) / np.sqrt(w)
    return y, np.eye(conditions)[condition], np.unique(subject, return_inverse=True)[1], w


class Dense:
    """The same model with matrices of the size of the data: the optimiser's twin."""

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


def test_equals_a_dense_likelihood_maximised_by_another_method():
    given = cells_of(1)
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
    covariance, of_variances = dense.kenward_roger(fit.variances)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-9)
    np.testing.assert_allclose(fit.variance_covariance, of_variances, rtol=1e-8)


def test_people_who_do_not_differ_have_a_variance_of_zero():
    fits = [fit_reml(*cells_of(seed, between=0.0)) for seed in range(12)]
    assert any(fit.variances[0] == 0.0 for fit in fits)
    assert all(fit.variances[0] >= 0.0 and np.isfinite(fit.criterion) for fit in fits)


def test_is_never_above_statsmodels():
    module = pytest.importorskip("statsmodels.regression.mixed_linear_model")
    for seed in range(4):
        y, X, group, w = cells_of(seed)
        root = np.sqrt(w)
        model = module.MixedLM(root * y, root[:, None] * X, group, root[:, None])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            theirs = -2.0 * model.fit(reml=True).llf
        apart = theirs - fit_reml(y, X, group, w).criterion - np.log(w).sum()
        assert -1e-6 < apart < 1e-3


@pytest.mark.slow
def test_error_rates_and_coverage_are_as_wanted():
    """100 experiments of the benchmark: 4 standard errors of 5 % are 9 points."""
    benchmark = runpy.run_path(str(ROOT / "benchmarks" / "people_statistics.py"))
    world, truth = benchmark["WORLDS"]["as planned"], np.full(4, 3.0)
    found = [
        benchmark["analysed"](world.draw(np.random.default_rng(seed), 0.0), truth, False)
        for seed in range(100)
    ]
    rates = 100.0 * pd.DataFrame(found).mean()
    assert rates[["F", "Holm"]].max() < 14.0
    assert 1.0 < rates["contrast"] < 10.0
    assert 90.0 < rates["cover difference"] < 99.5
    assert 90.0 < rates["cover mean"] < 99.5
