"""The server: who is let in, what each address answers, what pages are told, how it ends."""

import asyncio
import errno
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from http.cookiejar import CookieJar
from pathlib import Path

import pytest
from support.workbench import OWN, PORT, until

from skhoid.lab.workbench import server as server_module
from skhoid.lab.workbench.bench import News
from skhoid.lab.workbench.columns import Choices
from skhoid.lab.workbench.server import FOLDER, opened_session, serve
from skhoid.lab.workbench.session import BrokenSession, SessionFolder, SessionInUse

# Who is let in.


@pytest.fixture
def stranger(begun):
    """A client without a cookie, and the token."""
    page = begun()
    page.client.cookies.clear()
    return page.client, page.keys


def test_the_token_becomes_a_cookie_and_leaves_the_address(stranger):
    client, keys = stranger
    reply = client.get("/", params={"token": keys.token}, follow_redirects=False)
    assert (reply.status_code, reply.headers["location"]) == (303, "/")
    cookie = reply.headers["set-cookie"]
    assert keys.token not in cookie
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert "<title>skhoid workbench</title>" in client.get("/").text


def test_nothing_without_the_token(stranger):
    client, keys = stranger
    for path in ("/", "/api/opening", "/static/start.js", "/api/events", "/nothing"):
        reply = client.get(path)
        assert reply.status_code == 403
        assert "token" in reply.json()["message"]
    for token in ("", "wrong", "\N{BLACK STAR}"):
        assert client.get("/", params={"token": token}).status_code == 403
        assert client.get(f"/?token={token}&token={keys.token}").status_code == 403
    assert client.get("/api/opening", params={"token": keys.token}).status_code == 403
    for text in (f"skhoid-{PORT}=wrong", f"skhoid-{PORT + 1}={keys.cookie}", "\x7f;=;="):
        assert client.get("/", headers={"cookie": text}).status_code == 403
    assert client.get("/api/opening", headers={"authorization": "Bearer no"}).status_code == 403
    own = {"authorization": f"Bearer {keys.token}"}  # as a program sends it
    assert client.get("/api/opening", headers=own).status_code == 200


def test_this_machine_has_two_names_and_each_is_an_origin(begun):
    page = begun()
    for host in ("evil.example", f"evil.example:{PORT}", "127.0.0.1", f"127.0.0.1:{PORT + 1}"):
        assert page.client.get("/", headers={"host": host}).status_code == 421
    own = {"authorization": f"Bearer {page.keys.token}", "host": f"localhost:{PORT}"}
    assert page.client.get("/", headers=own).status_code == 200
    mixed = own | {"origin": OWN}
    assert page.client.post("/api/state", json={}, headers=mixed).status_code == 403


@pytest.mark.parametrize(
    "origin", ["null", "http://evil.example", f"https://127.0.0.1:{PORT}", "http://127.0.0.1", ""]
)
def test_other_origins_are_refused(begun, origin):
    page = begun()
    for method in ("GET", "POST"):
        reply = page.client.request(method, "/api/opening", headers={"origin": origin})
        assert reply.status_code == 403


def test_a_post_must_come_from_the_page(begun):
    client = begun().client
    for site in (None, "cross-site", "same-site", "none"):
        headers = {} if site is None else {"sec-fetch-site": site}
        assert client.post("/api/back", json={}, headers=headers).status_code == 403
    for headers in ({"origin": OWN}, {"sec-fetch-site": "same-origin"}):
        reply = client.post("/api/state", json={}, headers=headers)
        assert reply.status_code == 400
        assert "No model is fitted" in reply.json()["message"]
    for site in ("cross-site", "same-site"):
        for path in ("/static/start.js", "/api/opening", "/api/script.py"):
            assert client.get(path, headers={"sec-fetch-site": site}).status_code == 403


def test_every_reply_forbids_what_the_page_does_not_need(begun):
    client = begun().client
    for path in ("/", "/static/start.js", "/api/opening", "/nothing"):
        for reply in (client.get(path), client.get(path, headers={"host": "evil.example"})):
            assert "default-src 'none'" in reply.headers["content-security-policy"]
            assert reply.headers["x-content-type-options"] == "nosniff"
            assert reply.headers["cache-control"] == "no-store"
    html = client.get("/").text
    assert html.count("<script") == html.count("<script src=")
    for part in ("<style", " style=", " onclick"):
        assert part not in html


def test_websockets_are_refused(begun):
    from starlette.websockets import WebSocketDisconnect

    with pytest.raises(WebSocketDisconnect), begun().client.websocket_connect("/api/events"):
        pass


# What each address answers.


def test_the_files_of_the_page(begun):
    client = begun().client
    for name, words in (
        ("start.js", '"use strict"'),
        ("start.css", "--ink"),
        ("bench.js", "mount"),
    ):
        assert words in client.get(f"/static/{name}").text
    for name in ("start.py", "..%2Fserver.py", "index.html.j2", "%2e%2e/%2e%2e/etc/passwd"):
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
    assert page.upload("my runs.csv", b"x").json()["name"] == "my_runs-2.csv"
    refused = page.upload("run.exe", b"MZ")
    assert refused.status_code == 400
    assert "cannot be read" in refused.json()["message"]


def test_no_path_of_a_client_is_opened(begun, tmp_path):
    page = begun()
    secret = tmp_path / "secret.csv"
    secret.write_text("t,e,u\n0,1,2\n")
    for files in ([str(secret)], ["../../secret.csv"], [], None, "0", [0], [{}], ["0"]):
        reply = page.post("open", files=files)
        assert reply.status_code == 400
        assert "at least one file" in reply.json()["message"]
    assert page.opening()["files"] == []


def full(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "session.json")


def test_an_upload_that_finds_no_room_leaves_nothing(begun, monkeypatch):
    page = begun()
    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", full)
        reply = page.upload("run.csv", b"x")
    assert reply.status_code == 507
    assert "was not taken: session.json: No space left" in reply.json()["message"]
    monkeypatch.setattr(server_module, "MOST_BYTES", 1000)
    for content in (b"x" * 1001, iter([b"x" * 100] * 20)):  # the second without a length
        reply = page.upload("run.csv", content)
        assert reply.status_code == 413
        assert "Name it on the command line" in reply.json()["message"]
    assert os.listdir(page.bench.folder.uploads) == []


def test_what_is_not_possible_is_said_and_changes_nothing(fitted, monkeypatch):
    before = fitted.bench.exploration.memory()
    for name in ("__init__", "memory", "lock", "nothing", "take_search"):
        reply = fitted.post(name)
        assert reply.status_code == 400
        assert "There is no action" in reply.json()["message"]
    for name, args in [
        ("add", {"effect": "no_such"}),
        ("add", {}),
        ("remove", {"effect": "bias"}),
        ("drag", {"name": "bias__level", "value": 1}),
        ("release", {"name": "x", "value": "fast"}),
        ("trace", {"run": 99}),
        ("use", {"runs": [0, 1, 2], "use": "out"}),
    ]:
        reply = fitted.post(name, **{"run": 0, **args})
        assert reply.status_code == 400
        assert len(reply.json()["message"]) > 5
    assert fitted.bench.exploration.memory() == before
    monkeypatch.setattr(fitted.bench.exploration, "act", lambda *_: 1 // 0)
    reply = fitted.post("trace", run=0)
    assert reply.status_code == 500
    assert "ZeroDivisionError" in reply.json()["message"]


def test_the_component_is_told_all_it_asks(fitted):
    view = fitted.call("view")["view"]
    assert [run["n"] for run in view["runs"]] == [1024] * 3
    trace = fitted.call("trace", run=1)
    assert trace["measured"].size == trace["simulated"].size == 1024
    added = fitted.call("add", effect="bias")
    assert added["state"]["stair"][1]["vaf"] > added["state"]["stair"][0]["vaf"]
    text = fitted.client.get("/api/script.py").text
    assert "Bias()" in text
    assert "read_runs" in text
    compile(text, "script.py", "exec")


def test_a_full_disk_at_a_step_is_said_until_there_is_room(fitted, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(SessionFolder, "save", full)
        fitted.call("add", effect="bias")  # it goes on
        (note,) = fitted.opening()["notes"]
        assert "The session was not saved" in note
        assert "No space left on device" in note
    fitted.call("undo")
    assert fitted.opening()["notes"] == []


# What pages are told without asking.


def told(text):
    assert text.endswith("\n\n")
    return json.loads(text.removeprefix("data: "))


def test_every_page_is_told_and_one_that_comes_later_hears_how_things_are():
    news = News()

    async def listening():
        pages = [news.stream(), news.stream()]
        first = [told(await anext(page)) for page in pages]
        threading.Thread(target=news.tell, args=("state",), kwargs={"by": "one"}).start()
        second = [told(await anext(page)) for page in pages]
        later = news.stream()
        third = told(await anext(later))
        news.close()
        rest = [[text async for text in page] for page in (*pages, later, news.stream())]
        return first, second, third, rest

    first, second, third, rest = asyncio.run(listening())
    assert first == [{"state": 0, "opening": 0}] * 2
    assert second == [{"state": 1, "opening": 0, "by": "one"}] * 2
    assert third == {"state": 1, "opening": 0}
    assert rest == [[]] * 4
    news.tell("state")  # to pages whose loop has ended


# Which session, and how the server ends.


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def kept(session, path, choices):
    session.save({"files": [{"path": str(path)}], "asked": choices.as_dict()})
    session.give_back()


def test_a_session_is_gone_on_with_or_begun_beside(own_folder, tmp_path):
    one, other = tmp_path / "one.csv", tmp_path / "other.csv"
    session, found = opened_session(None, [one], Choices())
    assert session.path == tmp_path / FOLDER
    assert found is None
    kept(session, one, Choices())
    for paths in ([one], []):
        session, found = opened_session(None, paths, Choices())
        assert session.path == tmp_path / FOLDER
        assert found["files"] == [{"path": str(one)}]
        session.give_back()
    for paths, choices in (([other], Choices()), ([one], Choices(core="arx"))):
        session, found = opened_session(None, paths, choices)
        assert session.path == tmp_path / f"{FOLDER}-2"
        assert found is None
        session.give_back()


def test_a_session_that_cannot_be_had_is_refused(own_folder, tmp_path):
    session, _ = opened_session("mine", [tmp_path / "one.csv"], Choices())
    with pytest.raises(SessionInUse):
        opened_session("mine", [], Choices())
    kept(session, tmp_path / "one.csv", Choices())
    with pytest.raises(ValueError, match="is about other files"):
        opened_session("mine", [tmp_path / "other.csv"], Choices())
    (session.path / "session.json").write_text("{")
    for _ in range(2):
        with pytest.raises(BrokenSession):
            opened_session("mine", [], Choices())


def test_a_port_that_is_taken_is_said(own_folder):
    session, found = opened_session("mine", [], Choices())
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=f"Port {port} cannot be used"):
            serve(session, found, [], Choices(), port=port, browser=False)


@pytest.mark.slow  # a process that imports all
def test_it_serves_until_it_is_told_to_end(own_folder, runs_file, tmp_path):
    words = [str(runs_file), "--no-browser", "--session", "mine"]
    server = subprocess.Popen(
        [sys.executable, "-m", "skhoid", "workbench", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        address = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", server.stdout.readline())[0]
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
        assert b"skhoid workbench" in opener.open(address).read()
        with opener.open(address.partition("?")[0] + "api/events") as events:
            assert events.readline().startswith(b"data: ")
            until(lambda: (tmp_path / "mine" / "session.json").exists())
            server.send_signal(signal.SIGINT)
            out, err = server.communicate(timeout=20)
    finally:
        server.kill()
        server.communicate()
    assert (server.returncode, err) == (0, "")
    assert out.endswith(f"skhoid workbench --session {tmp_path / 'mine'}\n")
    session, found = opened_session("mine", [], Choices())
    assert found["files"][0]["path"] == str(runs_file)
    session.give_back()
