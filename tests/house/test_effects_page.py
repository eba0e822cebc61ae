"""The catalogue's pages say what there is: the grid, the cards, and what tells effects apart."""

import importlib
import re
import sys

import numpy as np
import pytest
from support.places import ROOT

import skhoid.effects
from skhoid.effects import catalogue, effect

DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def cards():
    """The extension, which needs Sphinx."""
    pytest.importorskip("sphinx")
    sys.path.insert(0, str(DOCS))
    yield importlib.import_module("effect_cards")
    sys.path.remove(str(DOCS))


def html(document):
    """The address of a document, as a builder gives it."""
    return f"{document}.html"


def test_every_place_has_its_group_in_the_order_of_the_map(cards):
    page = (DOCS / "effects.md").read_text(encoding="utf-8")
    assert tuple(re.findall(r"^```\{effect-grid\} (\w+)$", page, re.M)) == cards.PLACES_IN_ORDER
    for number, place in enumerate(cards.PLACES_IN_ORDER, 1):
        assert f"(place-{place})=\n## {number} {place.capitalize()}: " in page


def test_every_other_public_name_is_in_the_api_page():
    words = (DOCS / "api.md").read_text(encoding="utf-8").split()
    assert set(skhoid.effects.__all__) - set(catalogue()["class"]) <= set(words)


@pytest.mark.slow
def test_every_effect_is_in_one_group(cards):
    grids = "".join(cards.grid(place, html) for place in cards.PLACES_IN_ORDER)
    shown = re.findall(r"<strong>.*?</strong><code>(\w+)</code>", grids)
    assert sorted(shown) == sorted(catalogue().index)


@pytest.mark.slow
@pytest.mark.parametrize("name", catalogue().index)
def test_card_says_what_the_entry_says_and_shows_what_the_effect_does(cards, name):
    pictures = importlib.import_module("effect_pictures")
    entry, text = effect(name), cards.card(name, html)
    for told in (entry.physics, entry.tex, entry.source, f"effects.html#place-{entry.place}"):
        assert told in text
    examples = cards.examples_of(name)
    assert text.count("<svg") == len(examples)
    for example in examples:
        found = pictures.curves_of(example)
        lines = list(found.curves.values())
        size = np.ptp(np.r_[found.without.y, lines[0].y])
        off = [np.abs(c.y - np.interp(c.x, found.without.x, found.without.y)).max() for c in lines]
        assert max(off) > 0.05 * size
