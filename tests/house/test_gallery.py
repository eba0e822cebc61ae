"""Every page of the gallery opens with a question and ends with its answer."""

import ast
import re

import pytest
from support.places import ROOT

EXAMPLES = ROOT / "examples"
PAGES = sorted(EXAMPLES.glob("*/*.py"))
TOPICS = sorted({page.parent for page in PAGES})


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_question_and_answer(page):
    text = page.read_text(encoding="utf-8")
    head = ast.get_docstring(ast.parse(text))
    title, underline = head.splitlines()[:2]
    assert underline == "=" * len(title)
    assert "?" in head
    assert re.findall(r"^# (.+)\n# -{3,}$", text, re.MULTILINE)[-1] == "The answer"
    answer = text.rsplit("# The answer\n", 1)[1].splitlines()[1:]
    assert all(line.startswith("#") for line in answer), "the answer is in words"


def test_names():
    names = [page.name for page in PAGES]
    assert names
    assert len(set(names)) == len(names)
    assert all(name.startswith("plot_") for name in names)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_topic_has_a_header(topic):
    title, underline, blank, *words = (topic / "GALLERY_HEADER.rst").read_text().splitlines()
    assert underline == "-" * len(title)
    assert not blank
    assert words


def test_topics_are_in_order():
    conf = (EXAMPLES.parent / "docs" / "conf.py").read_text(encoding="utf-8")
    listed = re.search(r"for topic in (\(.*?\))", conf, re.DOTALL)
    order = ast.literal_eval(listed.group(1))
    assert order[0] == "diagnosis"  # what skhoid is for
    assert sorted(order) == [topic.name for topic in TOPICS]
