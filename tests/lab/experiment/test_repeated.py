import numpy as np
import pandas as pd
import pytest
from scipy import stats
from support.parameter_tables import simulated

from skhoid.lab.experiment import repeated_measures
from skhoid.lab.experiment.repeated import sphericity


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
    assert row["p_gg"] >= row["p"]
    assert row["epsilon_gg"] <= row["epsilon_hf"] <= 1.0
    t = stats.ttest_rel(means[:, 1], means[:, 0])
    assert found.pairs.loc[0, "p"] == pytest.approx(t.pvalue)
    assert found.pairs.loc[0, "se"] == pytest.approx(found.pairs.loc[0, "difference"] / t.statistic)


def test_epsilon_is_that_of_the_formula_with_the_covariance():
    """Greenhouse and Geisser's own formula, and its least value 1/(k-1)."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(15, 4)) @ rng.normal(size=(4, 4))
    s = np.cov(values, rowvar=False)
    k = 4
    upper = k**2 * (np.trace(s) / k - s.mean()) ** 2
    lower = (k - 1) * (np.sum(s**2) - 2 * k * np.sum(s.mean(axis=1) ** 2) + k**2 * s.mean() ** 2)
    epsilon, _, w, p = sphericity(values)
    assert epsilon == pytest.approx(upper / lower)
    assert 0.0 < w < 1.0
    assert 0.0 <= p <= 1.0
    line = np.outer(rng.normal(size=15), [0.0, 1.0, 2.0, 3.0])
    assert sphericity(line)[0] == pytest.approx(1 / 3)


@pytest.mark.slow
def test_mauchly_holds_its_level():
    """5 % of 600 spherical samples, within 4 standard errors of 0.9 %."""
    rng = np.random.default_rng(1)
    found = [sphericity(rng.normal(size=(12, 4)))[3] < 0.05 for _ in range(600)]
    assert np.mean(found) == pytest.approx(0.05, abs=0.036)


def test_people_without_a_condition_are_named():
    found = repeated_measures(simulated(), "K_e")
    assert found.left_out == ["S11"]
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
    with pytest.raises(ValueError, match="reference is one of"):
        repeated_measures(simulated(), "K_e", reference="x")
