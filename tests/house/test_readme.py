"""What README.md promises: its pictures are there, its table is that of the docs."""

import json
import re
import xml.etree.ElementTree as ET

import pytest
from support.places import ROOT

from skhoid import ARXRegressor, make_tracking_runs, write_runs
from skhoid.effects import catalogue
from skhoid.lab.cli import main

README = ROOT / "README.md"
SVG = "{http://www.w3.org/2000/svg}"

pytestmark = pytest.mark.skipif(not README.exists(), reason="no README beside the tests")


def text():
    return README.read_text(encoding="utf-8")


def marks(page):
    """The cells of each row of a page's tables of what tools can do, by row and column."""
    found = {}
    for table in re.findall(r"^\| \| skhoid .*\n(?:\|.*\n)+", page, re.M):
        head, _, *rows = ([c.strip() for c in r.split("|")[1:-1]] for r in table.splitlines())
        found |= {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}
    return found


def test_each_of_the_two_commands_is_one_line():
    blocks = re.findall(r"<!-- command: (\w+) -->\n```sh\n(.*?)```", text(), re.S)
    assert [name for name, _ in blocks] == ["run", "test"]
    assert all(block.count("\n") == 1 for _, block in blocks)


def test_as_many_effects_are_tried_as_it_says(tmp_path, capsys):
    X, y = make_tracking_runs("C1", 2, channels=["e", "x", "f_t"], duration=40.96)
    write_runs(X, y, tmp_path / "runs.csv")
    assert (
        main(["diagnose", str(tmp_path / "runs.csv"), "--dry-run", "--no-pictures", "--json"]) == 0
    )
    told = json.loads(capsys.readouterr().out)
    said = f"it tries {len(told['tried'])} of the {len(catalogue())} in its catalogue"
    (noise,) = told["looked_for_in_what_is_left"]
    assert f"{said}, and looks for {noise}, which is noise, in what is left" in " ".join(
        text().split()
    )


def test_what_it_marks_as_a_method_is_one():
    methods = ARXRegressor._parameter_constraints["method"][0].options
    assert ({"armax", "oe", "bj"} <= methods) == (
        marks(text())["ARMAX, OE, Box-Jenkins"]["skhoid"] == "●"
    )


def test_its_table_says_what_the_docs_measured():
    shown = marks(text())
    measured = marks((ROOT / "docs" / "other-tools.md").read_text(encoding="utf-8"))
    assert len(shown) > 5
    for row, cells in shown.items():
        assert cells == {tool: measured[row][tool] for tool in cells}, row


def test_what_matlab_has_is_either_here_or_not():
    page = (ROOT / "docs" / "matlab.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.+?) \| (.+) \|$", page, re.M)
    here, missing = [], []
    for matlab, ours in rows:
        names = re.findall(r"`'?(\w+)", matlab)
        (missing if ours == "not there" else here).extend(names)
    assert {"oe", "bj", "armax", "systemIdentification"} <= {*here}
    assert missing
    assert not {*missing} & {*here}


def test_the_moving_picture_is_of_the_demo_and_can_stand_still():
    (path,) = re.findall(r"\]\((\S+demo\.svg)\)", text())
    file = ROOT / path
    assert file.stat().st_size < 1_500_000
    root = ET.parse(file).getroot()
    words = root.find(f"{SVG}desc").text
    assert words.startswith("$ skhoid demo")
    assert "Verdict: effects found: bias and dead zone" in words
    assert "prefers-reduced-motion:reduce" in root.find(f"{SVG}style").text
