"""GroupEffectSearch: what people share, who is different, what fails, and what is kept."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from support.made_up_people import made_up_group, made_up_people

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs, report
from skhoid.effects import Effects
from skhoid.lab.experiment.group import GroupEffectSearch, named_by


def joined(people, names):
    X = pd.concat({name: X for name, (X, _) in people.items()}, names=names)
    return X, pd.concat({name: y for name, (_, y) in people.items()}, names=names)


def runs(number, duration=20.48):
    return make_tracking_runs("C1", n_runs=2, duration=duration, random_state=number)


@pytest.fixture(scope="module")
def data():
    """Of three people two are pushed to one side, in condition A only."""
    people = {}
    for number in range(3):
        X, y = runs(number)
        people[f"S{number + 1}", "A"] = X, y + 0.05 * (number > 0)
        people[f"S{number + 1}", "B"] = X, y
    return joined(people, ["subject", "condition"])


@pytest.fixture(scope="module")
def search():
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"])
    return GroupEffectSearch(search, least_prevalence=0.1)


@pytest.fixture(scope="module")
def found(search, data):
    return clone(search).fit(*data)


@pytest.mark.slow
def test_the_order_of_people_and_conditions_changes_nothing(search, data, found):
    key = ["subject", "condition", "effect"]
    backwards = ([cell for _, cell in part.groupby(level=key[:2])][::-1] for part in data)
    other = clone(search).fit(*map(pd.concat, backwards))
    for name in ("evidence_", "members_", "parameters_"):
        by = [column for column in (*key, "parameter") if column in getattr(found, name)]
        one, two = (
            getattr(group, name).sort_values(by, ignore_index=True) for group in (found, other)
        )
        pd.testing.assert_frame_equal(one, two)
    assert other.group_effects_ == found.group_effects_
    shares = [group.prevalence_.set_index("condition")["share"] for group in (found, other)]
    pd.testing.assert_series_equal(shares[0], shares[1].loc[shares[0].index])


@pytest.mark.slow
def test_it_names_the_effect_in_the_condition_in_which_people_have_it(found):
    assert found.group_effects_ == ["bias"]
    table = found.prevalence_.set_index("condition")
    assert table.loc["A", "with_it"] == ["S2", "S3"]
    assert table.loc["A", "without"] == ["S1"]
    assert table.loc["B", "n_with"] == 0
    assert list(table["group"])[:2] == [True, False]
    assert "bias in A: 2 of 3 people" in found.summary()
    assert "bias in B: 0 of 3 people" in found.summary()
    limits = found.limits_.set_index(["subject", "condition"])
    assert set(limits.index) == {("S1", "A"), *((f"S{n}", "B") for n in (1, 2, 3))}
    assert f"not shown in S1 (up to {limits.loc[('S1', 'A'), 'limit']:.2g}" in found.summary()


@pytest.mark.slow
def test_parameters_are_those_of_the_effect_where_it_is(found):
    table = found.parameters_
    bias = table[table["parameter"].str.startswith("bias")]
    assert list(bias["subject"]) == ["S2", "S3"]
    assert set(bias["condition"]) == {"A"}
    np.testing.assert_allclose(bias["estimate"], 0.05, atol=0.01)
    assert (bias["se"] > 0).all()


@pytest.mark.slow
def test_each_person_has_its_search(found):
    assert set(found.searches_) == {(f"S{i}", c) for i in (1, 2, 3) for c in "AB"}
    assert found.people_.set_index(["subject", "condition"]).loc[("S2", "A"), "effects"] == (
        "bias",
    )


@pytest.mark.slow
def test_conditions_are_compared(found):
    (row,) = found.contrasts_.to_dict("records")
    assert (row["n_with"], row["n_other"], row["only_here"]) == (2, 0, 2)
    assert row["p"] == pytest.approx(0.5)


def test_what_single_people_show_has_a_limit_in_the_others():
    group = made_up_group(made_up_people())
    group.group_effects_ = []
    group.members_.loc[0, "has"] = False
    group.limits_ = pd.DataFrame(
        {
            "subject": ["S3", "S3"],
            "condition": ["C1", "C2"],
            "effect": "saturation",
            "parameter": "limit",
            "unit": "deg",
            "sense": "at least",
            "limit": [0.9, 0.72],
        }
    )
    assert (
        "saturation is shown in S2 and S1 (in C2), 2 of 3 people; in the others it is not shown "
        "(at least 0.72 deg)."
    ) in " ".join(group.summary().split())


def test_one_person_is_no_group():
    X, y = joined({"S1": runs(0)}, ["subject"])
    group = GroupEffectSearch(EffectSearchCV(OperatorRegressor()))
    with pytest.raises(ValueError, match=r"at least two people.*S1"):
        group.fit(X, y)


@pytest.mark.slow
def test_who_cannot_be_searched_is_told_and_the_others_are_searched():
    people = {f"S{i}": runs(i) for i in range(3)}
    X, y = people["S1"]
    people["S1"] = X, y * np.nan
    group = GroupEffectSearch(EffectSearchCV(OperatorRegressor(), effects=["bias"]))
    group.fit(*joined(people, ["subject"]))
    assert "S1 could not be searched" in group.summary()
    assert group.people_.set_index("subject").loc["S1", "failure"]
    assert set(group.searches_) == {("S0", "all"), ("S2", "all")}


@pytest.mark.slow
def test_what_is_finished_is_kept_and_gives_the_same(tmp_path, monkeypatch):
    people = {f"S{i}": (X, y + 0.05) for i, (X, y) in enumerate(map(runs, range(2)))}
    X, y = joined(people, ["subject"])
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"])
    first = GroupEffectSearch(search, folder=tmp_path).fit(X, y)
    monkeypatch.setattr(EffectSearchCV, "fit", _stopped)  # nothing is fitted again
    again = GroupEffectSearch(search, folder=tmp_path).fit(X, y)
    for name in ("evidence_", "prevalence_", "parameters_"):
        pd.testing.assert_frame_equal(getattr(again, name), getattr(first, name))


def _stopped(*args, **kwargs):
    raise KeyboardInterrupt


def test_an_effect_that_stands_in_for_something_unknown_is_not_named():
    effects = Effects.of(["bias", "dead_zone"])
    best = SimpleNamespace(effects_=effects, effects=effects)
    search = SimpleNamespace(best_effects_=["bias", "unknown"], best_estimator_=best)
    assert named_by(search).names == ["bias"]


@pytest.mark.slow
def test_where_nothing_is_missing_it_says_so_and_has_empty_tables():
    people = {(f"S{i}", c): runs(i) for i in range(2) for c in "AB"}
    group = GroupEffectSearch(EffectSearchCV(OperatorRegressor(), effects=["bias"]))
    group.fit(*joined(people, ["subject", "condition"]))
    assert group.summary().splitlines()[0] == "Nothing found, in the group or in anybody."
    assert group.group_effects_ == []
    for table in (group.prevalence_, group.members_, group.contrasts_):
        assert len(table) == 0
    assert "Nothing found" in report(group).html
