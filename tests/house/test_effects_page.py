"""The catalogue's pages say what there is: the grid, the cards, and what tells effects apart."""

import importlib
import inspect
import re
import sys

import numpy as np
import pytest
from numpydoc.docscrape import FunctionDoc
from support.places import ROOT

import skhoid.effects
from skhoid.effects import CoreKind, catalogue, title_of
from skhoid.effects.catalogue import BY_NAME, CLASSES
from skhoid.effects.composition import PLACES
from skhoid.search.likeness import ANY_EXPERIMENT, EXPERIMENTS

pytestmark = pytest.mark.slow

DOCS = ROOT / "docs"
NAMES = list(BY_NAME)


@pytest.fixture(scope="module")
def cards():
    """The extension, which needs Sphinx."""
    pytest.importorskip("sphinx")
    sys.path.insert(0, str(DOCS))
    yield importlib.import_module("effect_cards")
    sys.path.remove(str(DOCS))


def text_of(name):
    return (DOCS / name).read_text(encoding="utf-8")


def html(document):
    """The address of a document, as a builder gives it."""
    return f"{document}.html"


def test_every_place_has_its_group_in_the_order_of_the_map(cards):
    page = text_of("effects.md")
    assert tuple(re.findall(r"^```\{effect-grid\} (\w+)$", page, re.M)) == cards.PLACES_IN_ORDER
    assert sorted(cards.PLACES_IN_ORDER) == sorted(PLACES)
    for number, place in enumerate(cards.PLACES_IN_ORDER, 1):
        assert f"(place-{place})=\n## {number} {place.capitalize()}: " in page


def test_every_effect_is_in_one_group(cards):
    grids = "".join(cards.grid(place, html) for place in PLACES)
    links = re.findall(r'<a href="([^"]+)">', grids)
    assert sorted(links) == sorted(f"{cards.page_of(c)}.html" for c in CLASSES)
    for c in CLASSES:
        assert f"<strong>{cards.heading(c.name)}</strong><code>{c.name}</code>" in grids


def test_every_effect_has_its_page():
    listed = text_of("effects.md").split("autosummary/effect.rst")[1]
    assert set(re.findall(r"^   (\w+)$", listed, re.M)) == {c.__name__ for c in CLASSES}


@pytest.mark.parametrize("name", NAMES)
def test_card(cards, name):
    effect, text = BY_NAME[name], cards.card(name, html)
    assert text.startswith(effect.physics)
    for told in (effect.tex, effect.source, f"effects.html#place-{effect().place}"):
        assert told in text
    examples = cards.examples_of(name)
    assert text.count("<svg") == len(examples)
    (given,) = re.findall(r"^   (.*)  # its numbers are given$", text, re.M)
    assert repr(eval(given, vars(skhoid.effects))) == repr(examples[0])
    for p in (p for example in examples for p in example.parameters):
        assert f"* - ``{p.name}``" in text
        assert " ".join(w for w in p.meaning.split() if w not in cards.SYMBOLS) in re.sub(
            r" :math:`.*?`", "", text
        )
    told_apart = re.findall(
        r"^- :doc:`.* <skhoid\.effects\.(\w+)>`\. To tell them apart, (.*)\.$", text, re.M
    )
    assert set(told_apart) == {
        (BY_NAME[other].__name__, told)
        for pair, told in EXPERIMENTS.items()
        if name in pair
        for other in pair - {name}
    }


@pytest.mark.parametrize("name", NAMES)
def test_examples_show_every_form(cards, name):
    forms = [cards.form_of(example) for example in cards.examples_of(name)]
    effect = BY_NAME[name]
    for argument in ("form", "trigger"):
        if argument in effect.choices:
            assert sorted(forms) == sorted(effect.choices[argument])
    assert forms
    for example in cards.examples_of(name):
        assert not example.free, f"{example} has numbers that are open"


@pytest.mark.parametrize("name", NAMES)
def test_pictures_show_that_the_effect_does_something(cards, name):
    pictures = importlib.import_module("effect_pictures")
    for example in cards.examples_of(name):
        found = pictures.curves_of(example)
        size = np.ptp(np.r_[found.without.y, next(iter(found.curves.values())).y])
        off = max(
            np.abs(c.y - np.interp(c.x, found.without.x, found.without.y)).max()
            for c in found.curves.values()
        )
        assert off > 0.05 * size


@pytest.mark.parametrize("name", NAMES)
def test_formula_in_latex(name):
    tex = BY_NAME[name].tex
    assert tex
    assert tex.count("{") == tex.count("}")
    assert tex.count(r"\begin") == tex.count(r"\end")


def test_pages_name_no_plumbing():
    template = text_of("_templates/autosummary/effect.rst")
    assert ":members:" not in template
    assert ".. autoclass::" in template


def test_table_of_experiments(cards):
    rows = re.findall(r"^   \* - (.*)\n     - (.*)$", cards.pairs(), re.M)
    assert rows[0] == ("effects", "told apart by")
    assert [told for _, told in rows[1:]] == [*EXPERIMENTS.values(), ANY_EXPERIMENT]
    for (named, _), pair in zip(rows[1:], EXPERIMENTS, strict=False):
        assert {title_of(name) for name in pair} == set(re.findall(r":doc:`(.*?) <", named))
    assert ".. effect-pairs::" in text_of("trust-a-name.md")


def test_number_of_effects_is_said_right():
    said = re.findall(r"all (\d+) effects", text_of("find-what-is-missing.md"))
    assert set(map(int, said)) <= {len(catalogue())}


def test_every_public_name_is_in_the_api_page():
    words = text_of("api.md").split()
    assert set(skhoid.effects.__all__) <= set(words)


@pytest.mark.parametrize("name", skhoid.effects.__all__)
def test_docstrings_of_effects(name):
    obj = getattr(skhoid.effects, name)
    doc = FunctionDoc(obj)
    documented = {
        part.strip().lstrip("*") for entry in doc["Parameters"] for part in entry.name.split(",")
    }
    if obj is not CoreKind and not getattr(obj, "_is_protocol", False):  # which nobody calls
        assert documented == set(inspect.signature(obj).parameters)
    assert len(doc["Summary"]) == 1
    assert ">>> " in "\n".join(doc["Examples"])
