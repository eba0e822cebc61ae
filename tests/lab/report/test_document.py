"""The report: it says what the results say, needs nothing else, and lets no text become markup."""

from __future__ import annotations

import pickle
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn.pipeline import make_pipeline
from support.page import Node, parse

from skhoid import (
    ARXRegressor,
    Decimator,
    EffectSearchCV,
    OperatorRegressor,
    RecursiveARX,
    Report,
    make_tracking_runs,
    report,
    select_runs,
)
from skhoid.effects import Bias, DeadZone
from skhoid.lab.report.page import fingerprint_of

pytestmark = pytest.mark.slow

EVIL = "<script>window.hacked=1</script>"
CANDIDATES = ["bias", "dead_zone", "saturation", "motion_feedback"]


@pytest.fixture(scope="module")
def runs() -> tuple[pd.DataFrame, pd.Series]:
    return make_tracking_runs(
        n_runs=3,
        duration=20.48,
        remnant_intensity=0.1,
        channels=["e", "x", "f_t"],
        sampling_rate=40,
        effects=DeadZone(width=0.3) + Bias(level=0.05),
        random_state=11,
    )


@pytest.fixture(scope="module")
def made(runs: tuple[pd.DataFrame, pd.Series]) -> Report:
    search = EffectSearchCV(OperatorRegressor(), effects=CANDIDATES).fit(*runs)
    return report(search, *runs, source="lambda < 1 & more", made_with={"seed": "11"})


@pytest.fixture(scope="module")
def page(made: Report) -> Node:
    return parse(made.html)


def scripts(page: Node) -> list[Node]:
    """Those that run: the data of what there is to touch do not."""
    return [node for node in page.all("script") if "type" not in node.attributes]


def section(page: Node, name: str) -> Node:
    return page.one("section", id=name)


def test_steps_show_the_error_path(made: Report, page: Node) -> None:
    path = made.search.error_path_
    steps = section(page, "steps")
    tabs = steps.one("div", class_="stairs").all("a")
    assert len(tabs) == len(path) == 3
    panels = steps.all("div", class_="step")
    for tab, panel, (number, row) in zip(tabs, panels, path.iterrows(), strict=True):
        assert tab.attributes["href"] == f"#{panel.attributes['id']}"
        name = row["model"]
        assert name == ["baseline", "with bias", "with bias and dead zone"][number]
        assert tab.text == f"{name} VAF {row['vaf']:.1f} % RMSE {row['rmse']:.4g} deg"
        assert panel.one("h3").text == name
        loops = path["vaf_loop"][max(number - 1, 0) : number + 1]
        assert f"in the closed loop VAF {' -> '.join(f'{v:.1f}' for v in loops)} %" in panel.text
        bar = tab.one("span", class_="bar").attributes["style"]
        assert bar == f"--size: {100 * row['rmse'] / path['rmse'].max():.1f}%"
        assert name in panel.one("svg").attributes["aria-label"]


def test_ranking_holds_each_candidate_with_a_reason(made: Report, page: Node) -> None:
    ranking = made.search.ranking_
    ranked = section(page, "ranking")
    rows = [row for table in ranked.all("table") for row in table.rows if len(row) == 9]
    tried = ranking[ranking["status"] != "does not apply"]
    assert len(rows) == len(tried)
    for cells, (_, row) in zip(rows, tried.iterrows(), strict=True):
        rank, effect, why, vaf, gain, evidence, judge, chance, words = cells
        assert (rank, effect.split(" (")[0]) == (str(row["rank"]), row["title"])
        assert float(vaf) == pytest.approx(row["vaf_after"], abs=0.005)
        assert float(gain) == pytest.approx(row["vaf_gain"], abs=0.005)
        assert float(evidence) == pytest.approx(row["evidence"], abs=0.51)
        assert judge == row["judge"]
        assert float(chance) == pytest.approx(100 * row["probability"], abs=0.51)
        assert why
        assert words.startswith(row["words"])
        assert ("Added" in why) == (row["status"] == "added")
    refused = ranking[ranking["status"] == "does not apply"]
    assert set(refused["effect"]) == {"motion_feedback"}
    items = [item.text for item in ranked.all("li")]
    assert len(items) == len(refused)
    assert all(item.startswith("motion feedback: ") for item in items)
    assert refused["reason"].iloc[0] in items[0]
    assert "1 that does not apply in step 1" in [s.text for s in ranked.all("summary")]


def test_parameters_with_units_and_intervals(made: Report, page: Node) -> None:
    table = made.search.best_estimator_.parameters_
    baseline = made.search.baseline_.parameters_
    rows = section(page, "parameters").one("table").rows
    assert [row[0] for row in rows] == list(table.index)
    for (name, value, sd, interval, unit, before, meaning), (_, row) in zip(
        rows, table.iterrows(), strict=True
    ):
        error = row["sd"]
        assert float(value) == pytest.approx(row["value"], abs=0.06 * error)
        assert float(sd) == pytest.approx(error, rel=0.06)
        low, high = map(float, interval.split(" to "))
        assert (low, high) == pytest.approx((row["low"], row["high"]), abs=0.06 * error)
        assert unit == ("" if row["unit"] == "-" else row["unit"])
        assert meaning == row["meaning"]
        if name in baseline.index:
            was = baseline.loc[name]
            assert before.endswith(" (at its bound)") == bool(np.isnan(was["sd"]))
            error = max(0.06 * np.nan_to_num(was["sd"]), 1e-3 * abs(was["value"]))
            assert float(before.split(" ")[0]) == pytest.approx(was["value"], abs=error)
        else:
            assert before == "-"


def test_comparison_before_and_after(made: Report, page: Node) -> None:
    compared = section(page, "comparison")
    second, first = (dict(t.rows) for t in compared.all("table"))  # what was before is folded
    assert "Before the search" in compared.one("details", class_="before").one("summary").text
    assert first["VAF, free run"] == f"{made.comparison.vaf:.1f} %"
    assert second["VAF, free run"] == f"{made.final_comparison.vaf:.1f} %"
    assert made.final_comparison.vaf > made.comparison.vaf + 10
    text = compared.text
    for found in (made.comparison, made.final_comparison):
        for finding in found.findings:
            assert finding.title in text
    left = {finding.name for finding in made.final_comparison.findings}
    gone = [finding for finding in made.comparison.findings if finding.name not in left]
    assert gone
    before = compared.one("details", class_="before").text
    assert before.count("Explained by bias and dead zone.") == len(gone)
    assert 'with_effect("bias")' not in text  # it is there
    for finding in made.final_comparison.findings:
        assert finding.next_step in text
    labels = [svg.attributes["aria-label"] for svg in compared.all("svg")]
    assert not [label for label in labels if "$" in label]
    assert any("residual over" in label and "f_t" in label for label in labels)
    for where in ("in time:", "in frequency", "in amplitude", "in time and frequency", "Run by"):
        assert sum(where in label for label in labels) == 2, where


def test_data_verdict_and_how_it_was_made(
    made: Report, page: Node, runs: tuple[pd.DataFrame, pd.Series]
) -> None:
    X, y = runs
    headline = page.one("h1", class_="headline").text
    assert re.match(
        r"Missing: bias( \(\d+ %\))? and dead zone( \(\d+ %\))?; with them the", headline
    )
    (ceiling,) = [
        fact for fact in page.one("dl", class_="facts").all("div") if "noise ceiling" in fact.text
    ]
    assert ceiling.text.endswith("on held-out rows, judged after the last step")
    assert "so is the ceiling at the top" in section(page, "comparison").text
    channels, by_run = section(page, "data").all("table")
    assert [row[:4] for row in channels.rows] == [
        ["e", "input", "e", "deg"],
        ["x", "", "x", "deg"],
        ["f_t", "", "f_t", "deg"],
        ["u", "output", "", "deg"],
    ]
    rms = [float(row[5]) for row in channels.rows]
    expected = [*np.sqrt((X**2).mean()), np.sqrt((y**2).mean())]
    assert rms == pytest.approx(expected, rel=1e-3)
    assert [row[:3] for row in by_run.rows] == [[str(n), "819", "20.48"] for n in range(3)]
    told = section(page, "made").text
    assert "Seed 11" in told
    assert "EffectSearchCV" in told
    assert "OperatorRegressor" in told
    assert fingerprint_of(X, y) in told


def test_nothing_is_loaded_and_ids_are_unique(made: Report, page: Node) -> None:
    for node in page.all():
        for name in ("src", "href", "xlink:href", "data", "action"):
            link = node.attributes.get(name)
            assert link is None or link.startswith(("#", "data:image/png")), (node.tag, link)
    assert "@import" not in made.html
    assert not re.search(r"url\((?!#)", made.html)
    ids = Counter(node.attributes["id"] for node in page.all() if "id" in node.attributes)
    assert ids.most_common(1)[0][1] == 1
    used = set(re.findall(r'(?:url\(|href=")#([^")]+)', made.html))
    assert used <= set(ids)
    assert len(scripts(page)) == 1


def test_text_from_the_user_stays_text(runs: tuple[pd.DataFrame, pd.Series]) -> None:
    X, y = select_runs(*runs, first=2)
    names = {"x": EVIL, "f_t": "a$b$<img src=x onerror=alert(1)>"}
    X = X.rename(columns=names)
    X.attrs = {"units": {"e": "<b>deg</b>", EVIL: "&deg;"}}
    y = y.rename(f'"{EVIL}')
    X.index = y.index = X.index.set_levels([f"{EVIL}1", "</svg>2"], level="run")
    made = report(
        ARXRegressor(nk=12, roles={EVIL: "x"}),
        X,
        y,
        effects=None,
        title=f"</title>{EVIL}",
        source=EVIL,
        made_with={EVIL: f"</dd>{EVIL}"},
    )
    page = parse(made.html)
    assert len(scripts(page)) == 1
    assert not page.all("img")
    assert not page.all("b")
    assert all(EVIL not in node.text for node in page.all("script"))
    assert page.one("title").text == f"</title>{EVIL}"
    assert page.one("h1").text == f"</title>{EVIL}"
    rows = section(page, "data").all("table")[0].rows
    assert [row[0] for row in rows] == ["e", EVIL, names["f_t"], f'"{EVIL}']
    assert any(EVIL in svg.text for svg in page.all("svg"))  # as text of a picture too
    assert any("a$b$<img" in svg.text for svg in page.all("svg"))
    frame = parse(made._repr_html_()).one("iframe")
    assert parse(frame.attributes["srcdoc"]).one("h1").text == f"</title>{EVIL}"
    policy = page.one("meta", **{"http-equiv": "Content-Security-Policy"}).attributes["content"]
    assert "default-src 'none'" in policy
    assert "script-src 'sha256-" in policy


def test_a_model_without_a_search_gets_the_sections_that_apply(
    runs: tuple[pd.DataFrame, pd.Series],
) -> None:
    X, y = select_runs(*runs, first=2)
    model = RecursiveARX(nk=12, memory_horizon=512, inputs=["e"])
    pipeline = make_pipeline(Decimator(factor=1), model).fit(X, y)
    made = report(pipeline, X, y, effects=["bias"])
    page = parse(made.html)
    assert made.search is None
    assert not page.all("section", id="steps")
    assert not page.all("section", id="ranking")
    targets = {section.attributes["id"] for section in page.all("section")}
    assert {f"#{name}" for name in targets} == {a.attributes["href"] for a in page.all("a")}
    assert "has not been asked" in section(page, "next").all("li")[0].text
    assert page.one("h1", class_="headline").text.startswith(f"VAF {made.comparison.vaf:.1f} %")
    rows, last = section(page, "parameters").one("table").rows, pipeline[-1]
    assert [row[0] for row in rows] == list(last.parameter_names_)
    for row, value, sd in zip(rows, last.coef_, last.standard_errors_, strict=True):
        assert float(row[1]) == pytest.approx(value, abs=0.06 * sd)
    assert [row[4] for row in rows[:3]] == ["", "", "deg/deg"]
    labels = [svg.attributes["aria-label"] for svg in page.all("svg")]
    assert "Parameters over the time in a run" in labels


def test_arrays_without_names_and_too_short_to_compare(
    runs: tuple[pd.DataFrame, pd.Series],
) -> None:
    X, y = (data.loc[0].to_numpy()[:60] for data in runs)
    made = report(ARXRegressor(nk=12, dt=0.025), X[:, :1], y, effects=None)
    page = parse(made.html)
    channels, _ = section(page, "data").all("table")
    assert [row[0] for row in channels.rows] == ["x0", "u"]
    assert page.one("h1").text == "ARXRegressor against measured u"
    assert made.comparison is None
    assert "Not possible: No run has 64 successive rows" in section(page, "comparison").text


def test_what_no_effect_tried_explains_is_said() -> None:
    X, y = make_tracking_runs(
        n_runs=3, duration=20.48, remnant_intensity=0.05, sampling_rate=40, random_state=13
    )
    y = y.clip(-0.06, 0.06)
    made = report(OperatorRegressor(), X, y, effects=["drift"])  # not what is missing
    page = parse(made.html)
    assert made.search.best_effects_[-1] == "unknown"
    headline = "Something is missing that the only effect tried does not explain: held-out VAF"
    assert page.one("h1", class_="headline").text.startswith(headline)
    advice = section(page, "next").text
    assert 'effects="all"' in advice
    assert "an effect of your own" not in advice
    left = made.search.unexplained_["description"].iloc[0]
    assert left[1:] in section(page, "next").text
    assert left in page.one("div", class_="verdict unknown").text


def test_a_search_of_other_data_is_refused(
    made: Report, runs: tuple[pd.DataFrame, pd.Series]
) -> None:
    X, y = runs
    with pytest.raises(ValueError, match="Pass the X and y that it was fitted to"):
        report(made.search, *select_runs(X, y, first=1))
    with pytest.raises(ValueError, match="is not that output"):
        report(made.search, X, y + 1)
    again = pickle.loads(pickle.dumps(made.search))
    for other in (3 * X + 5, X.rename(columns={"x": "z"}), X[["x", "e", "f_t"]]):
        with pytest.raises(ValueError, match="was fitted to another X"):
            report(again, other, y)


def test_a_name_that_is_none_is_an_error(runs: tuple[pd.DataFrame, pd.Series]) -> None:
    with pytest.raises(ValueError, match="No effect is called 'dead_zoen'"):
        report(ARXRegressor(nk=12), *runs, effects=["bias", "dead_zoen"])


def test_save_replaces(made: Report, tmp_path: Path) -> None:
    path = made.save(tmp_path / "new" / "report.html")
    assert path.read_text(encoding="utf-8") == made.html
    path.write_text("old")
    assert made.save(path) == path
    assert path.read_text(encoding="utf-8") == made.html
    with pytest.raises(IsADirectoryError, match="name a file in it"):
        made.save(tmp_path)


def test_the_frame_in_a_notebook_holds_the_page(made: Report) -> None:
    frame = parse(made._repr_html_()).one("iframe")
    assert frame.attributes["srcdoc"] == made.html
    assert frame.attributes["sandbox"] == "allow-scripts allow-downloads"
    assert not re.search(r"&amp;(amp|lt|gt|quot|#\d+);", made.html)  # the page, not escaped twice
    assert "lambda &lt; 1 &amp; more" in made.html


def test_a_page_made_by_a_command_goes_on_in_commands(
    made: Report, runs: tuple[pd.DataFrame, pd.Series]
) -> None:
    page = report(made.search, *runs, made_with={"command": "skhoid report run*.csv"})
    steps = section(parse(page.html), "next").text
    assert "skhoid diagnose --save" in steps
    assert "search." not in steps
    assert "fit(X, y)" not in steps
