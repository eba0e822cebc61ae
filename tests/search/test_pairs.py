"""Pairs are tried where nothing alone has a name; each must pass beside the other."""

from types import SimpleNamespace

import pytest

from skhoid.search import pairs
from skhoid.search.candidates import Candidate
from skhoid.search.pairs import N_FEW, likeliest_few, pair_of
from skhoid.search.statuses import Against, Reason


class Listed:
    """Effects by name alone."""

    def __init__(self, names):
        self.names = list(names)
        self.steps = [(name, SimpleNamespace(name=name, neutral={})) for name in names]

    def __len__(self):
        return len(self.names)

    def __iter__(self):
        return iter(self.steps)


def model(*names):
    return SimpleNamespace(effects=Listed(names))


def candidate(name, gain=1.0, weight=20.0, refused=None):
    effect = SimpleNamespace(name=name, neutral={})
    return Candidate(
        name, effect, model(name), gain=gain, delta_bic=weight, joint=weight / 2, refused=refused
    )


def path_of(*candidates, added=()):
    first = SimpleNamespace(candidates=list(candidates), parent=model(), weigh=None)
    return SimpleNamespace(steps=[first], added=list(added), core={})


def test_the_likeliest_that_gain_are_tried_and_not_what_was():
    found = [
        candidate("bias", weight=5.0),
        candidate("drift", weight=9.0),
        candidate("lapses", weight=7.0),
        candidate("tv_gain", weight=6.0),
        candidate("preview", weight=90.0, gain=0.0),
        candidate("integral", weight=80.0, refused=Against(Reason.AT_BOUND, "at the bound")),
        candidate("dead_zone", weight=70.0),
    ]
    path = path_of(*found, added=["dead_zone", "bias"])
    few = likeliest_few(path.steps[0], path)
    assert [c.id for c in few] == ["drift", "lapses", "tv_gain"]
    assert len(few) == N_FEW


class Searching:
    """A search in which effects pass beside others as a table says."""

    def __init__(self, passes):
        self.passes, self.asked = passes, []

    def step(self, parent):
        beside = parent.effects.names[0]
        self.asked.append(beside)
        second = self.passes.get(beside)
        best = None if second is None else SimpleNamespace(model=model(beside, second))
        return SimpleNamespace(best=best)

    def fewer(self, pair, name, core):
        return model(*(n for n in pair.effects.names if n != name))

    def judged(self, fewer, candidates):
        second = fewer.effects.names[0]
        passes = self.passes.get(second) == candidates[0].name
        return SimpleNamespace(best=candidates[0] if passes else None)


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    monkeypatch.setattr(pairs, "output_error_fit", lambda one: one)
    monkeypatch.setattr(pairs, "follow_from", lambda search, path, most: path)
    monkeypatch.setattr(pairs, "trimmed", lambda search, path, most: path)

    def ended(search, path, first):
        return SimpleNamespace(model=path.model, added=path.model.effects.names)

    monkeypatch.setattr(pairs, "in_gaining_order", ended)


def test_a_pair_is_found_where_each_passes_beside_the_other():
    path = path_of(candidate("drift", weight=9.0), candidate("lapses", weight=7.0))
    search = Searching({"lapses": "tv_gain", "tv_gain": "lapses"})
    assert pair_of(search, path, 4).added == ["lapses", "tv_gain"]
    assert search.asked == ["drift", "lapses"]


def test_no_pair_where_one_passes_alone_beside_the_other_or_two_are_too_many():
    path = path_of(candidate("lapses"))
    assert pair_of(Searching({"lapses": "tv_gain"}), path, 4) is None
    both = Searching({"lapses": "tv_gain", "tv_gain": "lapses"})
    assert pair_of(both, path, 1) is None
    assert both.asked == []
