"""What is open, how it is kept and comes back, and its reports."""

import json
import os
import re
import shutil
import threading
from html.parser import HTMLParser

import pandas as pd
import pytest
from support.workbench import same, until

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    OperatorRegressor,
    SimulatedARX,
    VAFScorer,
    select_runs,
)
from skhoid.lab.workbench.columns import Choices


def reopened(page, begun):
    """The same session, in another server, after this one was killed."""
    page.bench.folder.give_back()
    return begun(choices=Choices())


@pytest.mark.parametrize("judged", [True])
def test_from_a_file_to_a_model(begun, runs_file):
    page = begun(runs_file)
    found = page.wait("columns")
    assert found["guess"].startswith('Columns: time "time", run "run", error e "error"')
    assert found["findings"] == found["problems"] == []
    sent = {f"{what}s": {c["name"]: c[what] for c in found["columns"]} for what in ("kind", "unit")}
    recorded = page.bench.recorded
    assert page.post("fit", **sent, core="operator", display="pursuit").status_code == 200
    page.wait("bench")
    assert page.bench.recorded is recorded  # unchanged columns are not read again
    assert page.bench.exploration.search_for()[0].display == "pursuit"
    assert page.call("view")["view"]["title"] == "runs.csv"
    until(lambda: not page.call("state")["state"]["ceiling_pending"])  # it arrives by itself


def test_columns_are_corrected_and_read_again(begun, runs_file):
    page = begun(runs_file)
    page.wait("columns")
    page.post("columns", kinds={"target": "u"})
    assert "are both called output u" in page.wait("columns")["problems"][0]["text"]
    for _ in range(3):  # the newest counts, whatever is still under way
        page.post("columns", kinds={"target": "f_t"}, units={})
        page.post("columns", kinds={"target": ""}, units={"stick": "N"})
    found = page.wait("columns")
    sent = {f"{what}s": {c["name"]: c[what] for c in found["columns"]} for what in ("kind", "unit")}
    page.post("fit", **sent)
    page.wait("bench")
    assert list(page.bench.recorded.X.columns) == ["error", "pitch"]
    assert page.bench.recorded.y.attrs["units"] == {"stick": "N"}


def test_what_is_wrong_with_a_file_is_said_before_the_fit(begun, runs, tmp_path):
    X, y = runs
    table = X.assign(stick=y).reset_index()
    table["pitch"] *= -1.0
    table.to_csv(tmp_path / "wrong.csv", index=False)
    (finding,) = begun(tmp_path / "wrong.csv").wait("columns")["findings"]
    assert finding["title"].startswith("e is not f_t - x")
    assert finding["next_step"]
    (tmp_path / "empty.csv").write_text("")
    found = begun(tmp_path / "empty.csv", name="two").wait("empty")
    assert str(tmp_path / "empty.csv") in found["message"]
    page = begun(tmp_path / "wrong.csv", choices=Choices(subject="A"), name="three")
    assert "which column is the subject" in page.wait("columns")["message"]


def test_a_session_comes_back_to_the_last_digit(fitted, begun):
    path = fitted.bench.folder.path / "session.json"
    for name, args in [
        ("add", {"effect": "dead_zone"}),
        ("release", {"name": "dead_zone__width", "value": 0.3}),
        ("use", {"runs": [1], "use": "hold"}),
        ("undo", {}),
    ]:
        kept = path.read_text()
        fitted.call(name, **args)
        assert path.read_text() != kept  # every step is kept at once
    memory = json.loads(json.dumps(fitted.bench.exploration.memory()))
    kept = json.loads(path.read_text())["exploration"]
    assert {name: kept[name] for name in memory} == memory
    before, trace = fitted.state(), fitted.call("trace", run=2)
    page = reopened(fitted, begun)
    page.wait("bench")
    assert same(page.state(), before)
    assert same(page.call("trace", run=2), trace)
    assert page.call("redo")["state"]["uses"] == ["train", "hold", "train"]
    for _ in range(3):
        page.call("undo")
    assert page.state()["effects"] == []


def test_a_drag_is_no_step(fitted):
    fitted.call("add", effect="bias")
    path = fitted.bench.folder.path / "session.json"
    kept, state = path.read_text(), fitted.state()
    moved = fitted.call("drag", name="bias__level", value=0.2)
    assert moved["stair"] != state["stair"]
    assert path.read_text() == kept
    assert same(fitted.state(), state)


def test_a_file_that_has_changed_is_said_and_nothing_is_overwritten(begun, runs_file, tmp_path):
    path = tmp_path / "runs.csv"
    shutil.copy(runs_file, path)
    page = begun(path)
    page.wait("columns")
    page.post("fit")
    page.wait("bench")
    session = page.bench.folder.path / "session.json"
    kept, text = session.read_text(), path.read_text()
    path.write_text("\n".join(text.splitlines()[:-1]))
    page = reopened(page, begun)
    message = page.wait("columns")["message"]
    assert f"{path} has changed since this session was kept" in message
    assert session.read_text() == kept
    path.write_text(text)
    page = reopened(page, begun)
    page.wait("bench")
    path.unlink()
    page = reopened(page, begun)
    assert f"{path} is not there any more" in page.wait("empty")["message"]
    assert session.read_text() == kept


def test_an_uploaded_file_comes_back(begun, runs_file):
    page = begun()
    name = page.upload("runs.csv", runs_file.read_bytes()).json()["id"]
    page.post("open", files=[name])
    page.wait("columns")
    page = reopened(page, begun)  # before anything was fitted
    page.wait("columns")
    page.post("fit")
    page.wait("bench")
    before = page.state()
    page = reopened(page, begun)
    page.wait("bench")
    assert same(page.state(), before)


def test_back_to_the_columns_and_on(fitted):
    fitted.call("add", effect="bias")
    assert fitted.post("fit").status_code == 400  # as another tab might ask
    fitted.post("back")
    assert fitted.opening()["phase"] == "columns"
    assert "given up, maybe in another tab" in fitted.post("trace", run=0).json()["message"]
    fitted.post("fit", remove_means=True)
    fitted.wait("bench")
    assert fitted.state()["effects"] == []
    assert "X - X.mean()" in fitted.client.get("/api/script.py").text


def test_pages_that_act_at_once_do_not_corrupt_each_other(fitted):
    fitted.call("add", effect="bias")
    wrong = []

    def act(k):
        for n in range(3):
            args = {"name": "bias__level", "run": k}
            for name, more in (("release", {"value": 0.1 + 0.01 * n + 0.001 * k}), ("undo", {})):
                try:
                    fitted.bench.act(name, {**args, **more})
                except ValueError:  # there is nothing to undo any more
                    continue
                except Exception as error:
                    wrong.append(error)

    threads = [threading.Thread(target=act, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    kept = json.loads((fitted.bench.folder.path / "session.json").read_text())["exploration"]
    assert kept["history"] == json.loads(json.dumps(fitted.bench.exploration.memory()))["history"]


class Told(HTMLParser):
    """What a report says: its text, cell by cell, without what is only drawn."""

    def __init__(self, page):
        super().__init__()
        self.texts, self.drawn = [], 0
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.drawn += tag in ("svg", "script", "style")

    def handle_endtag(self, tag):
        self.drawn -= tag in ("svg", "script", "style")

    def handle_data(self, data):
        if not self.drawn and data.strip():
            self.texts.append(" ".join(data.split()))


def report_of(page):
    """What the report says, without its date."""
    texts = Told(page.client.get(page.call("report")["href"]).text).texts
    del texts[texts.index("Date") + 1]
    return texts


@pytest.mark.slow  # a search, and three reports
def test_a_search_comes_back_with_its_report(fitted, begun):
    fitted.call("keep")
    fitted.call("search")
    until(lambda: fitted.call("state")["state"]["search"] is None)
    fitted.call("add", effect=["bias", "dead_zone"])
    fitted.call("release", name="dead_zone__width", value=0.25)
    before, told = fitted.state(), report_of(fitted)
    assert "Ranking, with reasons" in told
    page = reopened(fitted, begun)
    page.wait("bench")
    assert same(page.state(), before)
    again = report_of(page)
    assert again == told
    row = told.index("dead_zone__width")  # of the present model, as it was moved
    assert told[row + 1] == "0.25"
    models = told[told.index("The VAF of each is that on the same runs.") :]
    assert models[2:4] == ["this model: bias and dead zone, moved by hand", "1: baseline"]
    vaf = [f"{model['vaf']['train']:.1f}" for model in before["models"]]
    assert models[models.index("VAF, runs fitted") + 1 :][:2] == vaf
    page.call("use", runs=[0], use="out")  # the search is of other runs
    other = report_of(page)
    assert "Ranking, with reasons" not in other
    assert any("The search was on other runs" in text for text in other)


@pytest.mark.slow  # a report is drawn
def test_reports_are_of_the_fitted_runs_and_beside_each_other(fitted):
    fitted.call("use", runs=[0], use="hold")
    (fitted.bench.folder.path / "report.html").mkdir()
    failed = fitted.bench.folder
    reply = fitted.call("report")
    assert reply["name"] == "report-2.html"
    assert str(fitted.bench.folder.path) in reply["text"]
    page = fitted.client.get(reply["href"])
    assert page.text.startswith("<!DOCTYPE html>")
    assert "attachment" in page.headers["content-disposition"]
    held = fitted.call("state")["state"]["vaf"]["hold"]
    assert re.search(rf"held out</dt> <dd class=\"value\">{held:.1f} %</dd>", page.text)
    assert "2 runs, 2048 rows" in page.text
    for name in ("session.json", "..%2fsession.json", "../lock", "report-3.html", "lock"):
        assert fitted.client.get(f"/api/report/{name}").status_code in (404, 405)
    assert "report-2.html" in os.listdir(failed.path)


@pytest.fixture(scope="module")
def people_file(runs, tmp_path_factory):
    """One run as of two people, of whom one is rested and tired: only the gain differs."""
    parts = []
    for subject, condition, gain in (
        ("A", "rested", 1.0),
        ("A", "tired", 0.5),
        ("B", "rested", 2.0),
    ):
        X, y = (one.loc[[0]] for one in runs)
        table = X.assign(stick=gain * y, subject=subject, condition=condition)
        parts.append(table.reset_index())
    path = tmp_path_factory.mktemp("people") / "people.csv"
    pd.concat(parts).to_csv(path, index=False)
    return path


def test_each_person_in_each_condition_is_fitted_alone(begun, people_file):
    page = begun(people_file)
    page.wait("columns")
    page.post("fit")
    page.wait("bench")
    view = page.call("view")["view"]
    assert page.call("state")["state"]["uses"] == ["train", "out", "out"]
    names = [one["name"] for one in view["people"]]
    assert names == ["A, rested", "A, tired", "B, rested"]
    assert page.call("people")["people"] == []
    page.call("fit_people")
    until(lambda: not page.call("state")["state"]["people"]["running"])
    rows = page.call("people")["people"]
    assert [row["name"] for row in rows] == names
    gains = [{p["name"]: p["value"] for p in row["parameters"]}["K_e"] for row in rows]
    assert gains[1] / gains[0] == pytest.approx(0.5, rel=1e-3)
    assert gains[2] / gains[0] == pytest.approx(2.0, rel=1e-3)
    vaf = page.call("state")["state"]["vaf"]["train"]
    assert rows[0]["vaf"] == vaf  # the page shows this person now
    page.call("add", effect="bias")
    assert page.call("state")["state"]["people"]["changed"]


ORDERS = {"core": "arx", "na": 4, "nb": 4, "nk": 9}


def test_structures_are_steps_of_one_session(fitted, begun, capsys):
    X, y = fitted.bench.prepared.X, fitted.bench.prepared.y
    about = {"settling": 3.0, "effects": "bias"}  # all are scored on the same rows
    scorer = VAFScorer(run_in=3.0)
    of_operator, of_arx = (
        scorer(model.fit(X, y), X, y)
        for model in (OperatorRegressor(**about), SimulatedARX(4, 4, 9, **about))
    )
    fitted.call("add", effect="bias")
    before = fitted.call("keep")["state"]["vaf"]["train"]
    assert before == pytest.approx(of_operator, abs=1e-9)
    state = fitted.call("structure", **ORDERS)["state"]
    assert state["vaf"]["train"] == pytest.approx(of_arx, abs=1e-9)
    assert state["preparation"] == "ARX 4, 4, 9"
    told = [(model["title"], model["vaf"]["train"]) for model in state["models"]]
    assert told == [
        ("ARX 4, 4, 9, bias", state["vaf"]["train"]),
        ("operator, bias", before),
    ]
    exec(compile(fitted.bench.script(), "script", "exec"), {})
    printed = re.search(r"VAF, runs fitted: (\S+)", capsys.readouterr().out)[1]
    assert float(printed) == state["vaf"]["train"]
    reply = fitted.post("structure", run=0, **ORDERS)
    assert "The model is this already: ARX 4, 4, 9" in reply.text
    shown, trace = fitted.state(), fitted.call("trace", run=1)
    page = reopened(fitted, begun)
    page.wait("bench")
    assert same(page.state(), shown)
    assert same(page.call("trace", run=1), trace)
    assert page.call("undo")["state"]["vaf"]["train"] == before
    assert page.state()["undo"] == "Add bias"


def test_a_search_is_of_one_structure(fitted):
    fitted.call("search")
    state = until(lambda: (found := fitted.state())["verdict"] and found)
    assert state["verdict"].startswith("Missing: ")
    state = fitted.call("structure", **ORDERS)["state"]
    assert state["verdict"].startswith("The search was of the operator. There: Missing: ")
    assert state["to_add"] == []
    assert "another structure than is fitted now" in state["cards_of"]
    assert {card["status"] for card in state["cards"]} & {"found"} == set()


def test_the_delay_of_a_structure_is_found_and_not_given_twice(begun, runs_file):
    page = begun(runs_file)
    page.wait("columns")
    page.post("fit", core="arx", shift="0.1")
    page.wait("bench")
    reply = page.post("structure", run=0, core="operator")
    assert "The input is shifted by 0.1 s already" in reply.text
    assert page.call("structure", core="arx", na=3)["state"]["preparation"].endswith("ARX 3, 2, 0")
    assert page.call("structure", core="arx")["state"]["preparation"].endswith("ARX 2, 2, 0")
    assert page.bench.exploration.here.structure == {}  # the first one again


def test_an_unsaid_nk_is_found_on_the_fitted_runs(fitted):
    X, y = fitted.bench.prepared.X, fitted.bench.prepared.y
    fitted.call("use", runs=[0], use="hold")
    model = ARXRegressor(na=3)
    found = DelaySearchCV(model).fit(*select_runs(X, y, runs=[1, 2])).best_nk_
    told = fitted.call("structure", core="arx", na=3)["state"]["structure"]
    assert told["name"] == f"ARX 3, 2, {found}"
