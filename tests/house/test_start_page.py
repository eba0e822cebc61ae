"""What the start page of the documentation quotes is what skhoid says."""

import re

import pytest
from support.places import ROOT

from skhoid import EffectSearchCV, OperatorRegressor, load_human_tracking

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
