"""Conditions compared by who has an effect."""

import pandas as pd
import pytest

from skhoid.lab.experiment.group import condition_contrasts


def members(table):
    rows = [
        {"subject": f"S{i}", "condition": condition, "effect": "dead_zone", "has": bool(has)}
        for condition, column in table.items()
        for i, has in enumerate(column)
        if has is not None
    ]
    return pd.DataFrame(rows)


def test_mcnemar_by_hand():
    found = condition_contrasts(members({"A": [1] * 10 + [0, 0], "B": [1] + [0] * 11}))
    (row,) = found.to_dict("records")
    assert (row["n_with"], row["n_other"], row["n_people"]) == (10, 1, 12)
    assert (row["only_here"], row["only_there"]) == (9, 0)
    assert row["p"] == pytest.approx(2 * 0.5**9)


def test_people_without_a_condition_do_not_count_in_it():
    found = condition_contrasts(members({"A": [1, 1, 0], "B": [0, None, 0]}))
    assert found.loc[0, "n_people"] == 2
    assert found.loc[0, "p"] == 1.0


def test_one_condition_has_no_contrasts():
    found = condition_contrasts(members({"A": [1, 0]}))
    assert len(found) == 0
    assert "p_adjusted" in found
