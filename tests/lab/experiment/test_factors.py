"""Conditions that are combinations of factors: main effects, interactions, and who finds them."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from skhoid.lab.experiment import mixed_model

FOUR = ("fast_rested", "fast_tired", "slow_rested", "slow_tired")
# Tired adds .15 when slow and .25 when fast, slow takes .02 away from the rested.
TRUE = dict(zip(FOUR, (0.30, 0.55, 0.28, 0.43), strict=True))


def made(people=8, runs=1, seed=0, scatter=0.02, answers=0.03, se=np.nan, conditions=FOUR):
    """A width of people whose answers to each factor differ."""
    rng = np.random.default_rng(seed)
    rows = []
    for p in range(people):
        own = dict(zip(FOUR, rng.normal(0, 0.1) + rng.normal(0, answers, 4), strict=True))
        for c in conditions:
            rows += [
                (f"P{p}", c, r, TRUE[c] + own[c] + rng.normal(0, scatter)) for r in range(runs)
            ]
    table = pd.DataFrame(rows, columns=["subject", "condition", "run", "estimate"])
    return table.assign(parameter="width", unit="deg", se=se, outlying="", failure="")


def test_factors_are_those_of_an_analysis_of_variance():
    """F = t² of main effects and interaction, each against its own answers of people."""
    table = made()
    found = mixed_model(table, "width").factors
    assert found[["factor", "level", "against"]].to_numpy().tolist() == [
        ["fast/slow", "slow", "fast"],
        ["rested/tired", "tired", "rested"],
        ["fast/slow x rested/tired", "tired - rested in slow", "in fast"],
    ]
    wide = table.pivot_table(index="subject", columns="condition", values="estimate")[list(FOUR)]
    for row, signs in zip(
        found.to_dict("records"),
        ([-0.5, -0.5, 0.5, 0.5], [-0.5, 0.5, -0.5, 0.5], [1, -1, -1, 1]),
        strict=True,
    ):
        twin = stats.ttest_1samp(wide @ np.array(signs), 0.0)
        assert row["t"] == pytest.approx(twin.statistic)
        ends = twin.confidence_interval()
        np.testing.assert_allclose((row["low"], row["high"]), (ends.low, ends.high))
    classical = pytest.importorskip("statsmodels.stats.anova").AnovaRM
    table["a"], table["b"] = zip(*table["condition"].str.split("_"), strict=True)
    anova = classical(table, "estimate", "subject", within=["a", "b"]).fit().anova_table
    np.testing.assert_allclose(anova["F Value"], found["t"] ** 2, rtol=1e-6)


@pytest.mark.parametrize(
    ("conditions", "factors"),
    [
        (FOUR, ["fast/slow", "rested/tired"]),
        (("a 1", "a 2", "a 3", "b 1", "b 2", "b 3"), ["a/b", "1/2/3"]),
        (("1-1", "1-2", "2-1", "2-2"), ["1/2", "1/2 (2)"]),
        (("C1_low_x", "C1_high_x", "C2_low_x", "C2_high_x"), ["C1/C2", "low/high"]),
        (FOUR[:3], []),  # not all combinations
        (("fast", "fast_tired"), []),
        (("a_x", "a_y"), []),  # one factor is the condition
    ],
)
def test_factors_in_names(conditions, factors):
    parts = [made(conditions=FOUR[:1], seed=seed) for seed in range(len(conditions))]
    named = [part.assign(condition=name) for part, name in zip(parts, conditions, strict=True)]
    found = mixed_model(pd.concat(named, ignore_index=True), "width").factors
    plain = [] if found.empty else [name for name in found["factor"].unique() if " x " not in name]
    assert plain == factors


def test_factors_are_given_by_columns_or_levels_or_not_wanted():
    table = made()
    table["pace"], table["state"] = zip(*table["condition"].str.split("_"), strict=True)
    whole = mixed_model(table, "width").factors
    columns = mixed_model(table, "width", factors=["pace", "state"]).factors
    levels = {c: "odd" if c.startswith("fast") else "even" for c in FOUR}
    given = mixed_model(table, "width", factors={"pace": levels}).factors
    np.testing.assert_allclose(columns["t"], whole["t"])
    assert columns["factor"].tolist() == ["pace", "state", "pace x state"]
    assert given[["level", "against"]].to_numpy().tolist() == [["even", "odd"]]
    assert mixed_model(table, "width", factors=()).factors.empty
    turned = mixed_model(table, "width", reference="slow_tired").factors
    assert turned["level"].tolist()[:2] == ["fast", "rested"]
    with pytest.raises(ValueError, match="no column 'place'"):
        mixed_model(table, "width", factors=["place"])
    with pytest.raises(ValueError, match="no level for fast_tired"):
        mixed_model(table, "width", factors={"pace": {"fast_rested": "fast"}})
    with pytest.raises(ValueError, match="fast_rested has several levels of the factor 'run'"):
        mixed_model(made(runs=2), "width", factors=["run"])


def test_who_lacks_a_condition_is_told_and_logarithms_are_ratios():
    table = made().query("not (subject == 'P3' and condition == 'fast_tired')")
    result = mixed_model(table, "width", transform="log")
    assert "factors are without P3, who lack a condition" in result.notes
    assert result.factors["df"].tolist() == [6.0] * 3
    np.testing.assert_allclose(result.factors["ratio"], np.exp(result.factors["difference"]))
    assert "tired / rested" in result.summary()


@pytest.mark.slow
def test_intervals_hold_the_truth():
    """Of 100 experiments 95 should, with a standard deviation of 2.2."""
    truth = np.array([-0.07, 0.20, -0.10])
    held = np.zeros(3)
    for seed in range(100):
        found = mixed_model(made(runs=2, seed=seed, se=0.02), "width").factors
        held += (found["low"] < truth) & (truth < found["high"])
    np.testing.assert_allclose(held, 95.0, atol=7.0)
