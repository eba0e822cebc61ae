"""The server of a session: which one, where it listens, how it ends."""

import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
import warnings
from http.cookiejar import CookieJar

import pytest
from support.workbench import until

from skhoid.lab.workbench import server as serving
from skhoid.lab.workbench.columns import Choices
from skhoid.lab.workbench.server import FOLDER, opened_session
from skhoid.lab.workbench.session import BrokenSession, SessionInUse


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def kept(session, path, choices):
    session.save({"files": [{"path": str(path)}], "asked": choices.as_dict()})
    session.give_back()


def test_a_session_is_gone_on_with_or_begun_beside(tmp_path):
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
    session, found = opened_session(None, [other], Choices())
    assert session.path == tmp_path / f"{FOLDER}-2"
    assert found is None
    session.give_back()
    session, _ = opened_session(None, [one], Choices(core="arx"))
    assert session.path == tmp_path / f"{FOLDER}-2"
    session.give_back()


def test_a_named_session_of_other_files_is_refused(tmp_path):
    session, _ = opened_session("mine", [tmp_path / "one.csv"], Choices())
    kept(session, tmp_path / "one.csv", Choices())
    with pytest.raises(ValueError, match="is about other files"):
        opened_session("mine", [tmp_path / "other.csv"], Choices())
    session, _ = opened_session("mine", [], Choices())  # it was unlocked again
    session.give_back()


def test_a_session_in_use_and_a_broken_one_are_refused(tmp_path):
    session, _ = opened_session("mine", [], Choices())
    with pytest.raises(SessionInUse):
        opened_session("mine", [], Choices())
    (session.path / "session.json").write_text("{")
    session.give_back()
    for _ in range(2):
        with pytest.raises(BrokenSession):
            opened_session("mine", [], Choices())


def test_a_port_that_is_taken_is_said():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=f"Port {port} cannot be used"):
            serving._listening(port)


def test_it_listens_on_this_machine_alone():
    with serving._listening(None) as listener:
        assert listener.getsockname()[0] == "127.0.0.1"


def test_what_is_not_installed_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    with pytest.raises(ImportError, match=r'pip install "skhoid\[workbench\]"'):
        serving.check_installed()


def test_warnings_are_on_the_page(begun):
    bench = begun().bench
    seen = []
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *_: seen.append(str(message))
        with serving._warnings_on(bench):
            warnings.warn("Runs of 2 people.", UserWarning, stacklevel=1)
            warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    assert bench.opening()["notes"] == ["Runs of 2 people."]
    assert seen == ["Runs of 2 people.", "overflow"]


@pytest.mark.slow  # a process that imports all
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_told_to_end(runs_file, tmp_path, number):
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
            server.send_signal(number)
            out, err = server.communicate(timeout=20)
    finally:
        server.kill()
        server.communicate()
    assert server.returncode == (0 if number == signal.SIGINT else 143)
    assert err == ""
    if number == signal.SIGINT:
        assert out.endswith(f"skhoid workbench --session {tmp_path / 'mine'}\n")
    session, found = opened_session("mine", [], Choices())
    assert found["files"][0]["path"] == str(runs_file)
    assert os.listdir(session.path / "..") == ["mine"]
    session.give_back()
