import numpy as np
import pandas as pd
import pytest
from scipy import stats
from support.parameter_tables import simulated

from skhoid.lab.experiment import mixed_model
from skhoid.lab.experiment.mixed import ADJUSTED, adjusted
from skhoid.lab.experiment.rows import select, variance_between_runs


@pytest.fixture(scope="module")
def result():
    return mixed_model(simulated(), "K_e")


def test_finds_the_effect_that_was_put_in(result):
    """Within 5 standard errors, and the intervals are those of t."""
    found = result.contrasts
    steps = found["condition"].str[1].astype(int) - found["against"].str[1].astype(int)
    assert np.all(abs(found["difference"] - 0.3 * steps) < 5.0 * found["se"])
    reach = stats.t.isf(0.025, found["df"]) * found["se"]
    np.testing.assert_allclose(found["high"] - found["difference"], reach)
    np.testing.assert_allclose(found["t"], found["difference"] / found["se"])
    assert len(found) == 6
    assert result.omnibus.df1 == 3.0
    assert result.omnibus.p < 1e-6
    # (P - 1)(C - 1) = 33, but one person lacks a condition.
    assert found["df"].between(31, 33.5).all()


def test_differences_are_those_of_the_means(result):
    mean = result.effects.set_index("condition")["mean"]
    for row in result.contrasts.to_dict("records"):
        wanted = mean[row["condition"]] - mean[row["against"]]
        assert row["difference"] == pytest.approx(wanted)


@pytest.mark.slow
def test_order_of_rows_and_unit_do_not_matter(result):
    table = simulated().sample(frac=1.0, random_state=0)
    table[["estimate", "se"]] *= 1000.0
    other = mixed_model(table, "K_e").effects.set_index("condition")
    here = result.effects.set_index("condition")
    for name in ("mean", "se", "low"):
        np.testing.assert_allclose(other.loc[here.index, name], 1000.0 * here[name], rtol=1e-5)
    np.testing.assert_allclose(other.loc[here.index, "df"], here["df"], rtol=1e-4)


def test_blups_are_drawn_towards_the_mean_and_missing_cells_have_one(result):
    people = result.people.set_index(["subject", "condition"])
    assert people.loc[("S11", "C4"), "n_rows"] == 0
    width = people["high"] - people["low"]
    assert width["S11", "C4"] > width["S11", "C3"]
    means = result.data.groupby(["subject", "condition"])["value"].mean().unstack()
    blups = people["estimate"].unstack()
    assert blups.std().sum() < means.std().sum()


@pytest.mark.slow
def test_reference_gives_the_contrasts_against_it(result):
    found = mixed_model(simulated(), "K_e", reference="C2").contrasts
    assert found["against"].tolist() == ["C2"] * 3
    same = result.contrasts.iloc[0]  # C2 - C1
    assert found.loc[0, "difference"] == pytest.approx(-same["difference"])
    assert found.loc[0, "p"] == pytest.approx(same["p"])


@pytest.mark.slow
def test_logarithm_gives_ratios():
    table = simulated(effect=0.0)
    table.loc[table["condition"] == "C2", ["estimate", "se"]] *= 1.25
    found = mixed_model(table, "K_e", transform="log", reference="C1")
    row = found.contrasts.iloc[0]
    assert row["ratio"] == pytest.approx(1.25, abs=0.05)
    assert row["ratio"] == pytest.approx(np.exp(row["difference"]))
    assert found.effects["low"].lt(found.effects["mean"]).all()
    assert "C2 / C1" in found.summary()


def test_unweighted_balanced_single_rows_are_the_paired_t_test():
    table = simulated(conditions=2, runs=1)
    found = mixed_model(table, "K_e", weighted=False).contrasts.iloc[0]
    wide = table.pivot_table(index="subject", columns="condition", values="estimate")
    t = stats.ttest_rel(wide["C2"], wide["C1"])
    assert found["t"] == pytest.approx(t.statistic)
    assert found["p"] == pytest.approx(t.pvalue)
    assert found["df"] == pytest.approx(11.0)


def test_one_condition_gives_the_mean_of_people():
    found = mixed_model(simulated(conditions=1, missing=0.0), "K_e", weighted=False)
    assert found.omnibus is None
    assert found.contrasts.empty
    means = simulated(conditions=1, missing=0.0).groupby("subject")["estimate"].mean()
    row = found.effects.iloc[0]
    assert row["mean"] == pytest.approx(means.mean())
    assert row["se"] == pytest.approx(means.std() / np.sqrt(12.0), rel=1e-5)
    assert row["df"] == pytest.approx(11.0)
    assert "over people" in found.summary()


def test_scatter_of_runs_beyond_the_errors_is_found():
    """Paule and Mandel's variance, to 4 standard errors of a variance with 400 degrees."""
    rng = np.random.default_rng(0)
    errors = rng.uniform(0.05, 0.2, 500)
    values = rng.normal(size=500) * np.hypot(errors, 0.3)
    cell = np.repeat(np.arange(100), 5)
    found = variance_between_runs(values, errors, cell)
    assert found == pytest.approx(0.09, rel=4.0 * np.sqrt(2.0 / 400.0) * 1.2)
    assert variance_between_runs(0.01 * values, errors, cell) == 0.0


def test_cells_are_weighted_means_of_their_runs():
    rows = select(simulated(people=4, conditions=2), "K_e")
    runs = rows.data.dropna(subset="weight")
    by = [runs["subject"], runs["condition"]]
    np.testing.assert_allclose(runs["weight"].groupby(by).sum(), 1.0)
    mean = (runs["weight"] * runs["value"]).groupby(by, sort=False).sum()
    np.testing.assert_allclose(np.sort(mean), np.sort(rows.y))
    w = 1.0 / (runs["value_se"] ** 2 + rows.tau**2)
    error = (1.0 / np.sqrt(w.groupby(by, sort=False).sum())).to_numpy()
    np.testing.assert_allclose(np.sort(error), np.sort(rows.cells.error))
    assert rows.weights.mean() == pytest.approx(1.0)
    order = np.argsort(rows.cells.error)
    assert np.all(np.diff(rows.weights[order]) <= 1e-12)


def test_rows_left_out_are_counted_and_say_why():
    table = simulated()
    table.loc[0, "estimate"] = np.nan
    table.loc[1, "outlying"] = "far from the other runs"
    failed = table.iloc[[2]].assign(parameter="", failure="no rows", run="9", estimate=np.nan)
    table = pd.concat([table, failed], ignore_index=True)
    found = mixed_model(table, "K_e", outlying="leave_out")
    told = found.data["left_out"].value_counts().to_dict()
    assert (told["no estimate"], told["outlying"], told["the fit failed"]) == (1, 1, 1)
    assert any("1 row left out: the fit failed" in note for note in found.notes)
    assert any("no rows of S11 in C4" in note for note in found.notes)
    kept = mixed_model(table, "K_e")
    assert "outlying" not in set(kept.data["left_out"])


def test_pooled_fits_beside_single_ones_do_not_count_twice():
    table = simulated(people=3, conditions=2)
    pooled = table.iloc[[0]].assign(run="all", estimate=9.0)
    found = select(pd.concat([table, pooled], ignore_index=True), "K_e")
    assert found.data["left_out"].str.startswith("a fit of all runs").sum() == 1
    assert found.runs["estimate"].max() < 9.0


def test_rows_without_an_error_get_the_largest_of_their_cell():
    table = simulated(people=3, conditions=2)
    table.loc[0, "se"] = np.nan
    rows = select(table, "K_e")
    here = (table["subject"] == "S1") & (table["condition"] == "C1")
    assert rows.runs.loc[0, "value_se"] == table.loc[here, "se"].max()
    assert any("without a standard error" in note for note in rows.notes)


@pytest.mark.slow
def test_who_changes_the_conclusion_is_named():
    table = simulated(effect=0.0, people=6, conditions=2, interaction=0.0)
    strange = (table["subject"] == "S2") & (table["condition"] == "C2")
    table.loc[table["condition"] == "C2", "estimate"] += 0.25
    table.loc[strange, "estimate"] -= 1.2
    found = mixed_model(table, "K_e")
    changing = found.influence[found.influence["changes"]]
    assert "S2" in set(changing["without"])
    check = found.checks.set_index("check").loc["influence"]
    assert not check["ok"]
    assert "without S2" in check["said"]


@pytest.mark.slow
def test_checks_tell_errors_that_are_too_small():
    table = simulated()
    table["se"] /= 2.0
    row = mixed_model(table, "K_e").checks.set_index("check").loc["standard errors"]
    assert row["statistic"] == pytest.approx(2.0, abs=0.4)
    assert not row["ok"]
    assert "further sd" in row["said"]


def test_summary_says_it_in_words(result):
    text = result.summary()
    assert "The conditions differ: F(3, " in text
    assert "between people" in text
    assert "d is the difference divided by the sd of people" in text
    assert all(len(line) <= 110 for line in text.splitlines())


@pytest.mark.parametrize("adjust", ADJUSTED)
def test_adjusted_p_values_are_those_of_statsmodels(adjust):
    p = np.random.default_rng(0).uniform(size=7) ** 3
    module = pytest.importorskip("statsmodels.stats.multitest")
    method = {"fdr": "fdr_bh"}.get(adjust, adjust)
    wanted = p if adjust == "none" else module.multipletests(p, method=method)[1]
    np.testing.assert_allclose(adjusted(p, adjust), wanted)


@pytest.mark.parametrize(
    ("change", "options", "told"),
    [
        ({}, {"parameter": "T_L"}, "no parameter 'T_L'; there are K_e"),
        ({}, {"reference": "C9"}, "reference is one of C1, C2"),
        ({}, {"adjust": "tukey"}, "adjust is"),
        ({}, {"transform": "sqrt"}, "transform is"),
        ({}, {"confidence": 95}, "confidence is"),
        ({"subject": "S1", "run": None}, {}, "one person only"),
        ({"se": np.nan}, {}, "weighted=False"),
        ({"estimate": np.nan}, {}, "No row of K_e can be used"),
        ({"run": "1"}, {}, "several rows of the same run: S1, C1, run 1"),
        ({"estimate": -1.0}, {"transform": "log"}, r"not above 0 in 30 rows \(S1, C1, run 1;"),
    ],
)
def test_errors_say_what_to_do(change, options, told):
    table = simulated(people=3, conditions=2, missing=0.0)
    for name, value in change.items():
        table[name] = [str(i) for i in range(len(table))] if value is None else value
    with pytest.raises(ValueError, match=told):
        mixed_model(table, **{"parameter": "K_e"} | options)


def test_table_of_other_columns_is_refused():
    with pytest.raises(ValueError, match="no column se"):
        mixed_model(simulated().drop(columns="se"), "K_e")
