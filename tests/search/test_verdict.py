"""When an effect is named, and when something is missing beside it."""

from types import SimpleNamespace

import numpy as np
import pytest

from skhoid.effects import Bias, DeadZone, Effects, Feedforward
from skhoid.search import Verdict
from skhoid.search.leftover import Leftover
from skhoid.search.search_numbers import SearchNumbers
from skhoid.search.verdict import BESIDE_ONE, decided

OWN = {"feedforward": Feedforward(), "dead_zone": DeadZone(), "bias": Bias()}


def numbers(added, gained, worst, *, share=1.0, cut=False, first=None):
    """What a search ended with: effects that gained points, and a structure of points left.

    The ``first`` of several gained so many of the points.
    """
    vafs = [80.0, 80.0 + gained] if first is None else [80.0, 80.0 + first, 80.0 + gained]
    model = SimpleNamespace(effects=Effects([(name, OWN[name]) for name in added]))
    last = SimpleNamespace(best=object() if cut else None)
    left = [Leftover("time", "t", "something", worst, np.nan)] if worst else []
    return SearchNumbers(
        path=SimpleNamespace(model=model, steps=[last]),
        steps=[SimpleNamespace(vaf=vaf) for vaf in vafs],
        added=list(added),
        left=left,
        noises=[],
        ceiling=np.nan,
        no_ceiling="",
        share=share,
        changes={},
    )


def verdict(*args, tries_all=True, **options):
    return decided(numbers(*args, **options), tries_all=tries_all)


def test_nothing_left_and_nothing_found():
    found = verdict([], 0.0, 0.0)
    assert (found.verdict, found.best_effects) == (Verdict.NOTHING, [])


def test_effect_that_leaves_little_is_found():
    found = verdict(["feedforward"], 5.0, 0.3)
    assert (found.verdict, found.best_effects) == (Verdict.FOUND, ["feedforward"])


@pytest.mark.parametrize(
    ("gained", "worst"), [(6.7, 1.2), (9.0, 3.0), (10.0, 4.0), (34.0, 10.8), (70.0, 50.0)]
)
def test_effect_that_explains_much_stays_named_beside_unknown(gained, worst):
    """However many runs say that something else repeats in them."""
    found = verdict(["feedforward"], gained, worst)
    assert found.verdict is Verdict.NOT_IN_CATALOGUE
    assert found.best_effects == ["feedforward", "unknown"]
    assert found.stand_ins == []


@pytest.mark.parametrize(("gained", "worst"), [(2.0, 8.0), (3.0, 1.0), (9.0, 8.0), (12.0, 14.0)])
def test_effect_that_explains_little_stands_in(gained, worst):
    found = verdict(["feedforward"], gained, worst)
    assert found.best_effects == ["unknown"]
    assert found.stand_ins == ["feedforward"]


@pytest.mark.parametrize("above", [True, False])
def test_the_limits_beside_one(above):
    least, small, _, large = BESIDE_ONE
    little = 1e-6 if above else -1e-6
    worst = (small + little) / (1 - small) * 50.0
    assert ("unknown" in verdict(["bias"], 50.0, worst).best_effects) == above
    worst = (large + little) / (1 - large) * 50.0
    assert (verdict(["bias"], 50.0, worst).named == []) == above
    assert ("unknown" in verdict([], 0.0, least + little).best_effects) == above


def test_several_that_leave_something_are_stand_ins_sooner():
    assert verdict(["bias"], 20.0, 9.0).named == ["bias"]
    both = verdict(["bias", "dead_zone"], 20.0, 9.0, first=8.0)
    assert both.named == []
    assert both.stand_ins == ["bias", "dead_zone"]


def test_the_first_of_several_stays_named_if_it_would_alone():
    found = verdict(["feedforward", "bias"], 35.6, 14.4, first=28.0)
    assert found.best_effects == ["feedforward", "unknown"]
    assert found.stand_ins == ["bias"]


def test_points_count_about_the_mean():
    """0.3 points of an output of which 1 % is not its mean are 30 points about the mean."""
    assert verdict([], 0.0, 0.3).verdict is Verdict.NOTHING
    assert verdict([], 0.0, 0.3, share=0.01).verdict is Verdict.NOT_IN_CATALOGUE


def test_what_was_not_tried_and_what_was_cut_short():
    assert verdict([], 0.0, 9.0, tries_all=False).verdict is Verdict.NOT_TRIED
    cut = verdict(["bias"], 10.0, 4.0, cut=True)
    assert (cut.verdict, cut.best_effects) == (Verdict.CUT_SHORT, ["bias", "unknown"])
    assert verdict(["bias"], 10.0, 0.1, cut=True).verdict is Verdict.FOUND


def test_effects_that_lose_are_no_name():
    """Structure that is left beside what gains nothing has no name."""
    found = verdict(["bias"], -0.5, 5.0)
    assert found.named == []
    assert found.stand_ins == ["bias"]
