"""docs/effects.md lists what there is: the catalogue, and what tells effects apart."""

import inspect

import pytest
from numpydoc.docscrape import FunctionDoc
from support.places import ROOT

import skhoid.effects
from skhoid.effects import catalogue
from skhoid.search.explanations import ANY_EXPERIMENT, EXPERIMENTS

DOCS = ROOT / "docs"


def rows_of(heading):
    """Rows of the first table under a heading of the page."""
    page = (DOCS / "effects.md").read_text(encoding="utf-8")
    lines = page.split(f"## {heading}\n")[1].splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith("| --- |")) + 1
    end = next(i for i in range(begin, len(lines)) if not lines[i].startswith("|"))
    return lines[begin:end]


def test_table_of_the_catalogue():
    wanted = [
        f"| `{name}` | {{class}}`~skhoid.effects.{row['class']}` | {row['place']} | "
        f"{row['physics']} |"
        for name, row in catalogue().iterrows()
    ]
    assert rows_of("The catalogue") == wanted


def test_table_of_experiments():
    wanted = {
        f"| {', '.join(f'`{name}`' for name in sorted(names))} | {told} |"
        for names, told in EXPERIMENTS.items()
    }
    wanted.add(f"| others | {ANY_EXPERIMENT} |")
    assert set(rows_of("What cannot be told apart, with which data")) == wanted


def test_every_public_name_is_in_the_api_page():
    words = (DOCS / "api.md").read_text(encoding="utf-8").split()
    assert set(skhoid.effects.__all__) <= set(words)


@pytest.mark.parametrize("name", skhoid.effects.__all__)
def test_docstrings_of_effects(name):
    obj = getattr(skhoid.effects, name)
    doc = FunctionDoc(obj)
    documented = {
        part.strip().lstrip("*") for entry in doc["Parameters"] for part in entry.name.split(",")
    }
    if not getattr(obj, "_is_protocol", False):  # which nobody calls
        assert documented == set(inspect.signature(obj).parameters)
    assert len(doc["Summary"]) == 1
    assert ">>> " in "\n".join(doc["Examples"])
