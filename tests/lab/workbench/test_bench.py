"""What is open, and how it is kept and comes back."""

import json
import shutil
import threading

import pytest
from support.workbench import same, until

from skhoid.lab.workbench.bench import words_of
from skhoid.lab.workbench.columns import Choices

pytestmark = pytest.mark.slow  # a server's model for each


def reopened(page, begun, paths=()):
    """The same session, in another server, after this one was killed."""
    page.bench.folder.give_back()
    return begun(*paths, choices=Choices())


def test_from_a_file_to_a_model(begun, runs_file):
    page = begun(runs_file)
    found = page.wait("columns")
    assert found["guess"].startswith('Columns: time "time", run "run", error e "error"')
    assert found["findings"] == []
    assert found["problems"] == []
    assert page.post("fit", search=False).status_code == 200
    page.wait("bench")
    assert page.call("view")["view"]["title"] == "runs.csv"


def test_the_page_says_what_it_shows(begun, runs_file):
    page = begun(runs_file)
    found = page.wait("columns")
    sent = {f"{what}s": {c["name"]: c[what] for c in found["columns"]} for what in ("kind", "unit")}
    recorded = page.bench.recorded
    page.post("fit", **sent, core="operator", display="pursuit")
    page.wait("bench")
    assert page.bench.recorded is recorded  # unchanged columns are not read again
    assert page.bench.exploration.search_for()[0].display == "pursuit"


def test_what_was_corrected_stays_so(begun, runs_file):
    page = begun(runs_file)
    page.wait("columns")
    page.post("columns", kinds={"target": ""}, units={"stick": "N"})
    found = page.wait("columns")
    sent = {f"{what}s": {c["name"]: c[what] for c in found["columns"]} for what in ("kind", "unit")}
    page.post("fit", **sent)
    page.wait("bench")
    assert list(page.bench.recorded.X.columns) == ["e", "x"]
    assert page.bench.recorded.y.attrs["units"] == {"u": "N"}


def test_columns_are_corrected_and_read_again(begun, runs_file):
    page = begun(runs_file)
    page.wait("columns")
    page.post("columns", kinds={"target": ""}, units={"stick": "N"})
    page.wait("columns")
    assert list(page.bench.recorded.X.columns) == ["e", "x"]
    page.post("columns", kinds={"stick": "", "target": ""})
    found = page.wait("columns")
    assert "No column is called the output u" in found["problems"][0]["text"]
    page.post("fit", kinds={"stick": "u", "target": ""})
    page.wait("bench")
    assert list(page.bench.recorded.X.columns) == ["e", "x"]


def test_a_wrong_unit_is_found_before_the_fit(begun, runs, tmp_path):
    X, y = runs
    table = X.assign(stick=y).reset_index()
    table["pitch"] *= -1.0
    path = tmp_path / "wrong.csv"
    table.to_csv(path, index=False)
    page = begun(path)
    (finding,) = page.wait("columns")["findings"]
    assert finding["title"].startswith("e is not f_t - x")
    assert finding["next_step"]


def test_a_file_that_cannot_be_read_is_said(begun, tmp_path):
    path = tmp_path / "empty.csv"
    path.write_text("")
    found = begun(path).wait("empty")
    assert str(path) in found["message"]


def test_what_is_not_clear_is_said_and_can_be_settled(begun, runs, tmp_path):
    X, y = runs
    path = tmp_path / "unclear.csv"
    X.assign(abc=y, xyz=1.5 * y + 1.0).reset_index().to_csv(path, index=False)
    page = begun(path)
    (problem,) = page.wait("columns")["problems"]
    offer = problem["offers"][0]
    page.post("fit", kinds={offer["column"]: offer["kind"]})
    page.wait("bench")
    assert page.bench.recorded.y.name == "u"


def test_a_model_that_cannot_be_fitted_is_said(begun, runs_file):
    page = begun(runs_file, choices=Choices(subject="A"))
    found = page.wait("columns")
    assert "which column is the subject" in found["message"]


@pytest.mark.slow  # models are fitted several times
def test_a_session_comes_back_to_the_last_digit(fitted, begun):
    fitted.call("add", effect="dead_zone")
    fitted.call("release", name="dead_zone__width", value=0.3)
    fitted.call("add", effect="bias")
    fitted.call("use", runs=[1], use="hold")
    fitted.call("undo")
    before, trace = fitted.state(), fitted.call("trace", run=2)
    page = reopened(fitted, begun)
    page.wait("bench")
    assert same(page.state(), before)
    assert same(page.call("trace", run=2), trace)
    redone = page.call("redo")["state"]
    assert redone["uses"] == ["train", "hold", "train"]
    for _ in range(4):
        page.call("undo")
    assert page.state()["effects"] == []


def test_every_step_is_kept_at_once(fitted):
    path = fitted.bench.folder.path / "session.json"
    for name, args in (("add", {"effect": "bias"}), ("undo", {}), ("redo", {})):
        before = path.read_text()
        fitted.call(name, **args)
        assert path.read_text() != before
    kept = json.loads(path.read_text())
    assert kept["exploration"] == json.loads(json.dumps(fitted.bench.exploration.memory()))


def test_a_drag_is_no_step(fitted):
    fitted.call("add", effect="bias")
    path = fitted.bench.folder.path / "session.json"
    before, state = path.read_text(), fitted.state()
    moved = fitted.call("drag", name="bias__level", value=0.2)
    assert moved["stair"] != state["stair"]
    assert path.read_text() == before
    assert same(fitted.state(), state)


@pytest.mark.slow  # models are fitted several times
def test_a_file_that_has_changed_is_said_and_nothing_is_overwritten(begun, runs_file, tmp_path):
    path = tmp_path / "runs.csv"
    shutil.copy(runs_file, path)
    page = begun(path)
    page.wait("columns")
    page.post("fit")
    page.wait("bench")
    page.call("add", effect="bias")
    session = page.bench.folder.path / "session.json"
    # The noise ceilings of both models are kept too, when they are found.
    until(lambda: len(json.loads(session.read_text())["exploration"]["judged"]) == 2)
    kept = session.read_text()
    text = path.read_text()
    path.write_text("\n".join(text.splitlines()[:-1]))
    page = reopened(page, begun)
    found = page.wait("columns")
    assert f"{path} has changed since this session was kept" in found["message"]
    assert session.read_text() == kept
    path.write_text(text)
    page = reopened(page, begun)
    page.wait("bench")
    assert page.state()["undo"]
    path.unlink()
    page = reopened(page, begun)
    assert f"{path} is not there any more" in page.wait("empty")["message"]
    assert (page.bench.folder.path / "session.json").exists()


@pytest.mark.slow  # models are fitted several times
def test_an_uploaded_file_comes_back(begun, runs_file):
    page = begun()
    name = page.upload("runs.csv", runs_file.read_bytes()).json()["id"]
    page.post("open", files=[name])
    page.wait("columns")
    page = reopened(page, begun)  # before anything was fitted
    page.wait("columns")
    page.post("fit")
    page.wait("bench")
    page.call("add", effect="bias")
    before = page.state()
    page = reopened(page, begun)
    page.wait("bench")
    assert same(page.state(), before)


def test_back_to_the_columns_and_on(fitted):
    fitted.call("add", effect="bias")
    assert fitted.post("fit").status_code == 400  # as another tab might ask
    fitted.post("back")
    assert fitted.opening()["phase"] == "columns"
    reply = fitted.post("trace", run=0)
    assert "given up, maybe in another tab" in reply.json()["message"]
    fitted.post("fit", remove_means=True)
    fitted.wait("bench")
    assert fitted.state()["effects"] == []
    assert "X - X.mean()" in fitted.client.get("/api/script.py").text


def test_two_pages_see_the_same(fitted, monkeypatch):
    news = fitted.bench.news
    before, told, tell = news.counts["state"], [], news.tell

    def overheard(*changed, **more):
        told.append(more)
        tell(*changed, **more)

    monkeypatch.setattr(news, "tell", overheard)
    headers = {"origin": "http://127.0.0.1:8765", "x-page": "one"}
    fitted.client.post("/api/add", json={"effect": "bias", "run": 0}, headers=headers)
    assert news.counts["state"] > before
    assert told[0]["by"] == "one"
    assert [effect["name"] for effect in fitted.state()["effects"]] == ["bias"]


@pytest.mark.slow  # models are fitted several times
def test_pages_that_act_at_once_do_not_corrupt_each_other(fitted):
    fitted.call("add", effect="bias")
    wrong = []

    def act(k):
        try:
            for n in range(4):
                value = 0.1 + 0.01 * n + 0.001 * k
                fitted.bench.act("release", {"name": "bias__level", "value": value, "run": k})
                fitted.bench.act("drag", {"name": "bias__level", "value": 0.0, "run": k})
                fitted.bench.act("undo", {"run": k})
        except Exception as error:
            wrong.append(error)

    threads = [threading.Thread(target=act, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wrong = [error for error in wrong if not isinstance(error, ValueError)]
    assert wrong == []
    kept = json.loads((fitted.bench.folder.path / "session.json").read_text())
    assert kept["exploration"] == json.loads(json.dumps(fitted.bench.exploration.memory()))
    assert fitted.state()["undo"] is not None


def test_the_ceiling_arrives_by_itself(fitted):
    until(lambda: not fitted.call("state")["state"]["ceiling_pending"])


def test_an_action_does_not_outlive_other_files(begun, runs_file):
    page = begun(runs_file)
    page.wait("columns")
    for _ in range(3):  # the newest counts, whatever is still under way
        page.post("columns", kinds={"target": ""})
        page.post("columns", kinds={"target": "f_t"})
    page.wait("columns")
    assert "f_t" in page.bench.recorded.X


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "memory does not suffice"),
        (KeyError("no such effect"), "no such effect"),
        (OSError(28, "No space left on device", "a.csv"), "a.csv: No space left on device."),
        (ValueError(""), "ValueError"),
    ],
)
def test_errors_are_sentences(error, words):
    assert words in words_of(error)
