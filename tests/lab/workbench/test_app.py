"""What each address answers."""

import errno
import os
from pathlib import Path

import pytest
from support.workbench import OWN

from skhoid.lab.workbench import server as app_module
from skhoid.lab.workbench.session import SessionFolder

pytestmark = pytest.mark.slow  # a model is fitted for each


def test_the_files_of_the_page(begun):
    client = begun().client
    for name, words in (
        ("start.js", '"use strict"'),
        ("start.css", "--ink"),
        ("bench.js", "mount"),
    ):
        assert words in client.get(f"/static/{name}").text
    for name in ("start.py", "..%2Fapp.py", "index.html.j2", "%2e%2e/%2e%2e/etc/passwd"):
        assert client.get(f"/static/{name}").status_code == 404


def test_a_file_is_uploaded_and_opened(begun, runs_file):
    page = begun()
    assert page.opening()["phase"] == "empty"
    reply = page.upload("../my runs.csv", runs_file.read_bytes()).json()
    path = page.bench.folder.uploads / "my_runs.csv"
    assert path.read_bytes() == runs_file.read_bytes()
    assert reply["name"] == "my_runs.csv"
    page.post("open", files=[reply["id"]])
    found = page.wait("columns")
    assert [column["kind"] for column in found["columns"]] == ["run", "time", "e", "x", "f_t", "u"]
    assert found["recorded"].startswith("3 runs, 3072 rows")
    again = page.upload("my runs.csv", b"x").json()
    assert again["name"] == "my_runs-2.csv"


def test_no_path_of_a_client_is_opened(begun, tmp_path):
    page = begun()
    secret = tmp_path / "secret.csv"
    secret.write_text("t,e,u\n0,1,2\n")
    for files in ([str(secret)], ["../../secret.csv"], [], None, "0", [0], [{}], ["0"]):
        reply = page.post("open", files=files)
        assert reply.status_code == 400
        assert "at least one file" in reply.json()["message"]
    assert page.opening()["files"] == []


def test_files_of_other_kinds_are_refused(begun):
    reply = begun().upload("run.exe", b"MZ")
    assert reply.status_code == 400
    assert "cannot be read" in reply.json()["message"]


def test_a_file_that_is_too_large_is_refused_in_words(begun, monkeypatch):
    monkeypatch.setattr(app_module, "MOST_BYTES", 1000)
    page = begun()

    def parts():  # without a content-length
        for _ in range(20):
            yield b"x" * 100

    for content in (b"x" * 1001, parts()):
        reply = page.upload("run.csv", content)
        assert reply.status_code == 413
        assert "Name it on the command line" in reply.json()["message"]
    assert os.listdir(page.bench.folder.uploads) == []


def test_a_full_disk_at_an_upload(begun, monkeypatch):
    page = begun()

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", full)
        reply = page.upload("run.csv", b"x")
    assert reply.status_code == 507
    assert "was not taken" in reply.json()["message"]
    assert "No space left" in reply.json()["message"]
    assert os.listdir(page.bench.folder.uploads) == []


@pytest.mark.parametrize("body", [b"{", b"[]", b"3", b"\xff", b"[" * 100_000])
def test_requests_that_make_no_sense(begun, body):
    reply = begun().client.post("/api/state", content=body, headers={"origin": OWN})
    assert reply.status_code == 400
    assert "request" in reply.json()["message"]


def test_requests_that_are_too_long(begun):
    reply = begun().client.post("/api/state", content=b" " * 1_000_001, headers={"origin": OWN})
    assert reply.status_code == 413


def test_actions_that_there_are_not(fitted):
    for name in ("__init__", "memory", "lock", "nothing", "take_search"):
        reply = fitted.post(name)
        assert reply.status_code == 400
        assert "There is no action" in reply.json()["message"]


@pytest.mark.parametrize(
    ("name", "args"),
    [
        ("add", {"effect": "no_such"}),
        ("add", {}),
        ("remove", {"effect": "bias"}),
        ("drag", {"name": "bias__level", "value": 1}),
        ("release", {"name": "x", "value": "fast"}),
        ("trace", {"run": 99}),
        ("use", {"runs": [0, 1, 2], "use": "out"}),
    ],
)
def test_what_is_not_possible_is_said(fitted, name, args):
    before = fitted.bench.exploration.memory()
    reply = fitted.post(name, **{"run": 0, **args})
    assert reply.status_code == 400
    assert len(reply.json()["message"]) > 5
    assert fitted.bench.exploration.memory() == before


def test_the_component_is_told_all_it_asks(fitted):
    view = fitted.call("view")["view"]
    assert [run["n"] for run in view["runs"]] == [1024] * 3
    trace = fitted.call("trace", run=1)
    assert trace["measured"].size == 1024
    assert trace["simulated"].size == 1024
    added = fitted.call("add", effect="bias")
    assert added["state"]["stair"][1]["vaf"] > added["state"]["stair"][0]["vaf"]
    assert fitted.call("state")["state"]["undo"]
    text = fitted.client.get("/api/script.py").text
    assert "Bias()" in text
    assert "read_runs" in text
    compile(text, "script.py", "exec")


def test_a_full_disk_at_a_step(fitted, monkeypatch):
    def full(self, content):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path / "session.json"))

    with monkeypatch.context() as patched:
        patched.setattr(SessionFolder, "save", full)
        fitted.call("add", effect="bias")  # it goes on
        (note,) = fitted.opening()["notes"]
        assert "The session was not saved" in note
        assert "No space left on device" in note
    fitted.call("undo")
    assert fitted.opening()["notes"] == []


def test_an_unexpected_error_is_told(fitted, monkeypatch):
    def fails(*_):
        raise RuntimeError("boom")

    monkeypatch.setattr(fitted.bench.exploration, "act", fails)
    reply = fitted.post("trace", run=0)
    assert reply.status_code == 500
    assert "RuntimeError: boom" in reply.json()["message"]
