import numpy as np
import pandas as pd
import pytest
from scipy import stats
from support.parameter_tables import simulated

from skhoid.lab.experiment import repeated_measures


def test_is_the_analysis_by_hand():
    table = simulated(missing=0.0)
    found = repeated_measures(table, "K_e")
    means = table.groupby(["subject", "condition"])["estimate"].mean().unstack().to_numpy()
    rest = means - means.mean(axis=1, keepdims=True)
    within = np.sum((rest - rest.mean(axis=0)) ** 2)
    row = found.anova.iloc[0]
    expected = 12 * np.sum(rest.mean(axis=0) ** 2) / 3 / (within / 33)
    assert row["F"] == pytest.approx(expected)
    assert (row["df1"], row["df2"]) == (3.0, 33.0)
    # Greenhouse and Geisser's own formula.
    s, k = np.cov(means, rowvar=False), 4
    upper = k**2 * (np.trace(s) / k - s.mean()) ** 2
    lower = (k - 1) * (np.sum(s**2) - 2 * k * np.sum(s.mean(axis=1) ** 2) + k**2 * s.mean() ** 2)
    assert row["epsilon_gg"] == pytest.approx(upper / lower)
    assert row["p_gg"] >= row["p"]
    assert row["epsilon_gg"] <= row["epsilon_hf"] <= 1.0
    assert 0.0 < row["mauchly_W"] < 1.0
    t = stats.ttest_rel(means[:, 1], means[:, 0])
    assert found.pairs.loc[0, "p"] == pytest.approx(t.pvalue)
    assert found.pairs.loc[0, "se"] == pytest.approx(found.pairs.loc[0, "difference"] / t.statistic)


def test_agrees_with_statsmodels():
    module = pytest.importorskip("statsmodels.stats.anova")
    table = simulated(missing=0.0)
    means = table.groupby(["subject", "condition"], as_index=False)["estimate"].mean()
    theirs = module.AnovaRM(means, "estimate", "subject", ["condition"]).fit().anova_table.iloc[0]
    row = repeated_measures(table, "K_e").anova.iloc[0]
    assert row["F"] == pytest.approx(theirs["F Value"])
    assert row["p"] == pytest.approx(theirs["Pr > F"])
    module = pytest.importorskip("statsmodels.stats.multitest")
    pairs = repeated_measures(table, "K_e").pairs
    np.testing.assert_allclose(
        pairs["p_adjusted"], module.multipletests(pairs["p"], method="holm")[1]
    )


def test_people_without_a_condition_are_named():
    found = repeated_measures(simulated(), "K_e")
    assert "left out: S11" in found.summary()
    assert len(found.means) == 11


def test_two_conditions_are_the_paired_t_test():
    found = repeated_measures(simulated(conditions=2, missing=0.0), "K_e")
    row = found.anova.iloc[0]
    assert row["F"] == pytest.approx(found.pairs.loc[0, "t"] ** 2)
    assert row["p"] == pytest.approx(found.pairs.loc[0, "p"])
    assert np.isnan(row["mauchly_p"])


def test_what_it_cannot_do_is_said():
    with pytest.raises(ValueError, match="one condition only"):
        repeated_measures(simulated(conditions=1), "K_e")
    table = simulated(people=2, conditions=2, missing=0.0)
    table = table[~((table["subject"] == "S2") & (table["condition"] == "C2"))]
    with pytest.raises(ValueError, match="1 person with runs in all"):
        repeated_measures(pd.DataFrame(table), "K_e")
