"""What the start page of the documentation quotes is what skhoid says."""

import re

import pytest
from support.places import ROOT

from skhoid import EffectSearchCV, OperatorRegressor, load_human_tracking
from skhoid.lab.cli import main

PAGE = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
CARDS = re.findall(r"^> (.+)\n\n(.+)\n:::$", PAGE, flags=re.MULTILINE)


def of_the_page(**changed):
    """The search that the page's own lines make."""
    code = re.search(r"^```python\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)[1]
    hidden = re.search(r"effects=(.+?), \*\*task", code)[1]
    code = code.replace(f"effects={hidden}", f"effects=changed.get('effects', {hidden})")
    variables = {"changed": changed}
    exec(code, variables)
    return variables["search"]


def of_a_real_person():
    X, y = load_human_tracking([f"phase-size {name}" for name in ("2b", "2c", "2d")])
    middle = X["f_t"].mean()
    model = OperatorRegressor(inputs=["f_t"])
    return EffectSearchCV(model, display="pursuit").fit(X - middle, y - middle)


def test_three_outcomes():
    assert len(CARDS) == 3


def test_readme_has_the_same_lines():
    pages = [PAGE, (ROOT / "README.md").read_text(encoding="utf-8")]
    code, same = (re.search(r"^```python\n(.*?)^```$", p, re.M | re.S)[1] for p in pages)
    assert re.sub(r"  #.*", "", same) == re.sub(r"  #.*", "", code)


def test_five_minutes_show_what_the_command_prints(tmp_path, monkeypatch, capsys):
    text = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "88")
    code = re.search(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)[1]
    exec(code.replace("mkdtemp()", "'.'"), {})
    assert main(["identify", "run1.csv", "--run-in", "2", "--no-pictures"]) == 0
    printed = capsys.readouterr().out.splitlines()
    shown = re.search(r"^```text\n(run1.csv.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)[1]
    assert [line for line in shown.splitlines() if line not in printed] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("card", "search"),
    [
        (0, of_the_page),
        (1, lambda: of_the_page(effects=None)),
        (2, of_a_real_person),
    ],
    ids=["named", "nothing", "unknown"],
)
def test_cards_quote_what_is_said(card, search):
    quote, words = CARDS[card]
    said = " ".join(str(search().summary()).split())
    assert quote.removesuffix(" …") in said
    for figure in re.findall(r"\d+\.\d+", words):
        assert figure in said
