"""The page of an experiment: it says what was found, its links lead somewhere, names are text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from support.made_up_people import made_up_group, made_up_people
from support.page import Node, parse

from skhoid import simulate_experiment
from skhoid.arx.batch import ARXRegressor
from skhoid.lab.experiment import identify_people
from skhoid.lab.report import report, report_experiment
from skhoid.lab.report.plots import ExperimentGallery, Plot

DRAWN = {name: getattr(ExperimentGallery, name) for name in ("_display", "stretch", "parameter")}
EVIL = "<script>window.hacked=1</script>"


@pytest.fixture(scope="module")
def undrawn() -> Iterator[None]:
    """Nothing is drawn, which takes most of the time."""

    def plot(*given: Any) -> Plot:
        caption = ", ".join(part for part in given if isinstance(part, str))
        return Plot("<svg/>", caption)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(ExperimentGallery, "_display", plot)
        patched.setattr(ExperimentGallery, "stretch", plot)
        patched.setattr(ExperimentGallery, "parameter", lambda *given: [plot(*given)])
        yield


@pytest.fixture
def real(undrawn: None) -> Iterator[None]:
    """Everything is drawn in spite of it."""
    with pytest.MonkeyPatch.context() as patched:
        for name, method in DRAWN.items():
            patched.setattr(ExperimentGallery, name, method)
        yield


def section(page: Node, name: str) -> Node:
    return page.one("section", id=name)


@pytest.fixture(scope="module")
def page(undrawn: None) -> Node:
    people = made_up_people(failing=("S2", "C2"))
    return parse(report_experiment(made_up_group(people), people=people).html)


def test_the_page_says_who_has_what(page: Node) -> None:
    verdict = page.one("p", class_="headline").text
    assert verdict == "The group has saturation."
    rows = section(page, "effects").all("table")[0].rows
    assert rows[0][:4] == ["Saturation", "C1", "yes", "2 of 3"]
    assert rows[0][-2:] == ["S1, S2", "S3"]
    differs = section(page, "differs").text
    assert (
        "Saturation, which the group has, is not shown; probability of having it: 3 %." in differs
    )
    assert "C1, run 1: VAF 3 %, other runs 80 %." in differs
    assert "C2: no fit: ValueError: no <rows>." in differs


def test_conditions_are_compared(page: Node) -> None:
    tables = [table.rows for table in section(page, "parameters").all("table")]
    contrasts = [rows[0] for rows in tables if rows[0][0] == "C2 - C1"]
    assert len(contrasts) == 2
    assert float(contrasts[1][1]) == pytest.approx(0.05, abs=0.01)
    named = [h.text for h in section(page, "parameters").all("h3")]
    assert named == ["K_e", "tau_e, s", "saturation: limit, deg"]
    text = section(page, "parameters").text
    assert "Not compared: known of 2 people only." in text


def test_what_factors_change_stands_first(undrawn: None) -> None:
    conditions = ("fast_rested", "fast_tired", "slow_rested", "slow_tired")
    people = made_up_people([f"S{n}" for n in range(6)], conditions)
    verdict = parse(report_experiment(made_up_group(people), people=people).html).one(
        "div", class_="verdict found"
    )
    first, second, third = (p.text for p in verdict.all("p")[:3])
    assert re.fullmatch(r"Slow against fast: tau_e \+0\.10\d+ s \(0\.09\d+ to 0\.1\d+\)\.", first)
    assert re.match(r"Tired against rested: tau_e \+0\.0[45]", second)
    assert third == "The group has saturation."
    factors = report_experiment(people, factors=()).statistics["tau_e"].factors
    assert factors.empty


def test_links_lead_to_people(page: Node) -> None:
    ids = {node.attributes["id"] for node in page.all() if "id" in node.attributes}
    links = [str(a.attributes["href"]) for a in page.all("a")]
    assert {link.removeprefix("#") for link in links} <= ids
    rows = section(page, "data").one("table").one("tbody").all("a")
    assert [a.attributes["href"] for a in rows] == ["#person-1", "#person-2", "#person-3"]
    person = section(page, "each").one("div", id="person-1")
    assert person.all("table")[0].rows[0][:3] == ["C1", "3", "80.0"]
    effects = person.all("table")[1].rows
    assert effects[0] == ["saturation", "C1", "97 %", "yes", "limit 0.500 deg (0.461 to 0.539)"]


def test_headings_follow_each_other_and_regions_have_names(page: Node) -> None:
    levels = [int(n.tag[1]) for n in page.all() if re.fullmatch(r"h\d", n.tag)]
    assert levels[0] == 1
    assert all(b - a <= 1 for a, b in pairwise(levels))
    names = [n.attributes["aria-label"] for n in page.all("div", role="region")]
    assert len(set(names)) == len(names)
    ids = [n.attributes["id"] for n in page.all() if "id" in n.attributes]
    assert len(set(ids)) == len(ids)


def test_names_are_text(undrawn: None) -> None:
    people = made_up_people(names=(f"{EVIL}1", '"><img src=x>', "S3"), conditions=(EVIL, "C2"))
    html = report_experiment(
        made_up_group(people), people=people, title=EVIL, source=EVIL, made_with={EVIL: EVIL}
    ).html
    assert EVIL not in html
    assert "<img" not in html
    assert len(parse(html).all("script")) == 1


def test_nothing_is_loaded(page: Node) -> None:
    for node in page.all():
        assert not {"src", "srcset"} & node.attributes.keys()
        assert str(node.attributes.get("href") or "#").startswith("#")


def test_people_alone_are_reported(undrawn: None) -> None:
    made = report(made_up_people())
    assert repr(made) == "<ExperimentReport 'An experiment with people': 3 people, VAF 80 to 81 %>"
    assert "identified by OperatorRegressor: VAF 80 to 81 %" in made.html
    assert list(made.statistics) == ["K_e", "tau_e"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"reference": "C9"}, "reference is one of C1, C2; got 'C9'"),
        ({"X": "only"}, "Give X and y together"),
    ],
)
def test_what_does_not_fit_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        report_experiment(made_up_people(), **options)


def test_other_results_are_refused() -> None:
    with pytest.raises(TypeError, match="got ARXRegressor"):
        report_experiment(ARXRegressor())  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"report needs the data: report\(model, X, y\)"):
        report(ARXRegressor())  # type: ignore[call-overload]


@pytest.mark.slow
def test_pictures_are_drawn_in_small_files(real: None) -> None:
    people = made_up_people(names=[f"S{n}" for n in range(5)], conditions=["C1", "C2"])
    html = report_experiment(made_up_group(people), people=people).html
    assert len(parse(html).all("svg")) == 2 + 2 * 3 + 5 * 2
    assert len(html) < 1e6


@pytest.mark.slow
def test_a_page_of_recordings_has_their_pictures(real: None) -> None:
    X, y = simulate_experiment(2, "C1", runs=2, duration=20.48, random_state=0)
    people = identify_people(ARXRegressor(nk=29), X, y)
    made = report_experiment(people, X, y)
    page = parse(made.html)
    pictures = section(page, "each").all("svg")
    assert [p.attributes["aria-label"] for p in pictures] == [
        f"{who}, C1, run 2, on the rows of the fit" for who in ("S1", "S2")
    ]
    assert "at 100 Hz" in section(page, "data").text
    assert len(made.html) < 1e6
    with pytest.raises(ValueError, match="X has no runs of S2 in C1"):
        report_experiment(people, X.loc[["S1"]], y.loc[["S1"]])
