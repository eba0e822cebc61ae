"""Sentences, figures and pictures of a report, one by one."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from support.page import parse
from support.shapes import a_shape

from skhoid import ARXRegressor, OperatorRegressor, make_tracking_runs, report
from skhoid.lab.report.content import Results, _facts, _next_steps, _shape, _verdict
from skhoid.lab.report.plots import Gallery
from skhoid.search import SearchResult, Verdict


def a_search(*added: str, **attributes: object) -> SimpleNamespace:
    """What a fitted search says of itself."""
    n = len(added) + 1
    path = {"effect": ["baseline", *added], "vaf": [50.0] * n, "rmse": [0.1] * n}
    path |= {"vaf_loop": attributes.pop("vaf_loop", np.nan)}
    given = {
        "error_path_": pd.DataFrame({**path, "ceiling": np.nan, "explainable_gap": np.nan}),
        "predictions_": pd.DataFrame(),
        "ranking_": pd.DataFrame(
            {"step": 1, "status": ["not better", "not better", "does not apply"]}
        ),
        "shape_": None,
        "unexplained_": pd.DataFrame(columns=["description", "where", "points"]),
        "best_effects_": list(added),
        "stand_ins_": [],
        "ceiling_note_": "",
        "experiments_": [],
        "notes_": [],
        "verdict_": Verdict.FOUND,
    }
    given |= attributes
    nothing = pd.DataFrame()
    result = SearchResult(
        left_out=nothing,
        parameters=nothing,
        explainable_gap=0.0,
        searched_runs=[],
        max_effects=4,
        **{name.rstrip("_"): value for name, value in given.items()},
    )
    return SimpleNamespace(**given, result_=result, tries_all=False)


def test_the_figure_of_the_closed_loop_stands_beside_that_of_the_free_run() -> None:
    search = a_search("bias", vaf_loop=[31.24, 38.61])
    told = {name: (value, text) for value, name, text in _facts(search, None, "rows")}
    assert told["VAF in the closed loop"] == ("38.6 %", "held-out rows, the last model")
    sentence = _verdict(search, None)["sentence"]
    assert "in the closed loop, where the model moves x and e, VAF 31.2 % and 38.6 %." in sentence
    search = a_search(vaf_loop=[31.24])
    told = {name: (value, text) for value, name, text in _facts(search, None, "rows")}
    assert told["VAF in the closed loop"] == ("31.2 %", "held-out rows, the baseline")
    assert "VAF 31.2 %." in _verdict(search, None)["sentence"]


@pytest.mark.parametrize(("name", "known"), [("dead_zone-2", True), ("myoffset", False)])
def test_code_is_printed_only_where_it_runs(name: str, known: bool) -> None:
    (step,) = _next_steps(Results(baseline=OperatorRegressor(), search=a_search("bias", name)))
    assert step["why"].startswith("It is search.best_estimator_")
    assert ('.with_effect("dead_zone")' in step["code"]) == bool(step["code"]) == known


@pytest.mark.parametrize(
    ("verdict", "rest", "advice"),
    [
        (
            Verdict.NOT_IN_CATALOGUE,
            "that no effect of the catalogue explains",
            "an effect of your own",
        ),
        (
            Verdict.NOT_TRIED,
            "that none of the 2 effects tried explains",
            'effects="all"',
        ),
        (
            Verdict.CUT_SHORT,
            "that is not explained within max_effects=4",
            "a larger max_effects",
        ),
    ],
)
def test_the_headline_claims_no_more_than_was_tried(
    verdict: Verdict, rest: str, advice: str
) -> None:
    of_verdict = {"verdict_": verdict}
    search = a_search("bias", best_effects_=["bias", "unknown"], **of_verdict)
    told = "the held-out VAF rises from 50.0 to 50.0 %"
    assert _verdict(search, None)["headline"] == (
        f"Missing: bias, and something {rest}; with bias {told}."
    )
    search = a_search(best_effects_=["unknown"], **of_verdict)
    headline = f"Something is missing {rest}: held-out VAF 50.0 %."
    assert _verdict(search, None)["headline"] == headline
    *_, step = _next_steps(Results(baseline=OperatorRegressor(), search=search))
    for other in ("an effect of your own", 'effects="all"', "a larger max_effects"):
        assert (other in step["why"]) == (other == advice)


def test_what_has_no_name_has_its_shape_told_and_drawn() -> None:
    of_verdict = {"verdict_": Verdict.NOT_IN_CATALOGUE}
    shape = a_shape()
    search = a_search(best_effects_=["unknown"], shape_=shape, **of_verdict)
    assert shape.sentences()[0] in _verdict(search, None)["sentence"]
    steps = {
        s["what"]: s for s in _next_steps(Results(baseline=OperatorRegressor(), search=search))
    }
    assert steps["Record what tells effects apart"]["why"] == shape.recordings[0]
    assert "sketch_effect" in steps["Make the shape an effect of your own"]["code"]
    told = _shape(shape, Gallery())
    assert told is not None
    assert told["first"].startswith("It acts on the error")
    assert told["picture"].caption == "Departure from a straight line, deg, over error e, deg"
    assert "<svg" in told["picture"].narrow
    assert [row[1] for row in told["nearest"].rows] == ["0.21", "0.44"]


@pytest.mark.slow
def test_labels_of_runs_are_no_mathematics() -> None:
    X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    X.index = y.index = X.index.set_levels(["a$_$0", "a$x_1$b"], level="run")
    page = parse(report(ARXRegressor(nk=15), X, y, effects=None).html)
    shown = " ".join(svg.text for svg in page.all("svg"))
    assert "a$_$0" in shown
    assert "a$x_1$b" in shown
    assert "mathdefault" not in shown  # the labels of logarithmic axes are


@pytest.mark.slow
def test_templates_are_loaded_when_a_page_is_made() -> None:
    check = "import sys; from skhoid import report; sys.exit('jinja2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check], check=False, cwd="/").returncode == 0
