"""Prevalence of effects in a group: a closed form, evidence that adds up, and odd people."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from skhoid.effects import effect
from skhoid.lab.experiment.group import condition_contrasts
from skhoid.lab.experiment.prevalence import PersonEvidence, prevalences, summed

COLUMNS = ["instead_of", "effect", "evidence"]
EFFECTS = {name: effect(name) for name in ("dead_zone", "friction", "bias")}
AGAINST = ("", "bias", -4.0)
DOUBTFUL = 5.0  # nats, too few for a name


def person(named=(), *rows):
    return PersonEvidence(tuple(named), pd.DataFrame(rows, columns=COLUMNS), EFFECTS)


def with_dead_zone(evidence=150.0):
    own = [("dead_zone", "dead_zone", evidence), ("dead_zone", "friction", 50.0)]
    return person(["dead_zone"], AGAINST, *own)


def without():
    return person([], ("", "dead_zone", -4.5), ("", "friction", -4.5), AGAINST)


def one_of(people, effect, **options):
    return {found.effect: found for found in prevalences(people, list(EFFECTS), **options)}[effect]


@pytest.mark.parametrize("n_with", [0, 1, 6, 10, 12])
def test_with_clear_evidence_it_is_nearly_the_beta_distribution_of_the_count(n_with):
    """Nearly: who shows nothing may have it all the same, with a factor of 1 to 12."""
    clear = [with_dead_zone(1e5) for _ in range(n_with)]
    found = one_of([*clear, *(without() for _ in range(12 - n_with))], "dead_zone")
    exact = stats.beta(1 + n_with, 13 - n_with)
    assert found.n_with == n_with
    assert found.n_people == 12
    assert found.share == pytest.approx(exact.mean(), abs=0.06)
    assert [found.low, found.high] == pytest.approx(exact.interval(0.95), abs=0.08)
    assert found.more_than(0.25) == pytest.approx(exact.sf(0.25), abs=0.05)


def test_what_is_too_weak_in_each_person_adds_up_over_people():
    weak = [person([], ("", "dead_zone", DOUBTFUL), AGAINST) for _ in range(12)]
    assert one_of(weak, "dead_zone").more_than(0.25) > 0.99
    alone = [weak[0], *(without() for _ in range(11))]
    assert one_of(alone, "dead_zone").has[0] < 0.6


def test_a_rare_effect_asks_for_more_evidence_than_a_common_one():
    doubtful = person([], ("", "dead_zone", DOUBTFUL), AGAINST)
    common = one_of([doubtful, *(with_dead_zone() for _ in range(11))], "dead_zone").has[0]
    rare = one_of([doubtful, *(without() for _ in range(11))], "dead_zone").has[0]
    assert common > 0.9
    assert rare < 0.3


def test_who_cannot_tell_two_effects_apart_counts_for_the_one_that_others_have():
    rows = [("friction", "friction", 51.0), ("friction", "dead_zone", 50.0), AGAINST]
    unsure = person(["friction"], *rows)
    assert one_of([unsure, *(with_dead_zone() for _ in range(11))], "dead_zone").has[0] > 0.8
    alone = [unsure, *(without() for _ in range(11))]
    assert one_of(alone, "friction").has[0] > one_of(alone, "dead_zone").has[0] > 0.05


def test_large_evidence_of_one_person_does_not_make_an_effect_of_the_group():
    people = [with_dead_zone(1e6), *(without() for _ in range(11))]
    found = one_of(people, "dead_zone")
    assert found.has[0] > 0.9
    assert found.more_than(0.25) < 0.5


def test_people_whose_data_cannot_tell_are_left_out_of_the_count():
    blind = person([], ("", "dead_zone", np.nan), AGAINST)
    found = one_of([blind, with_dead_zone(), without()], "dead_zone")
    assert found.n_people == 2
    assert np.isnan(found.has[0])


@pytest.mark.slow
def test_intervals_hold_the_prevalence_of_a_population():
    """Of experiments drawn from populations of any prevalence, 95 % hold it: 3 sigma of 200."""
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(200):
        share = rng.random()
        has = rng.random(12) < share
        found = one_of([with_dead_zone() if h else without() for h in has], "dead_zone")
        held += found.low <= share <= found.high
    assert abs(held / 200 - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 200) + 0.01


def test_evidence_of_all_conditions_adds_up():
    weak = person([], ("", "dead_zone", DOUBTFUL))
    (joined,) = summed([[weak, weak, weak]], ["dead_zone"])
    assert joined.states()[1][1] == pytest.approx(3 * weak.states()[1][1])
    (mixed,) = summed([[with_dead_zone(), without()]], ["dead_zone"])
    assert abs(mixed.states()[1][1]) < joined.states()[1][1] + 3


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
