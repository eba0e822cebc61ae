"""The folder of a session."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from skhoid.lab.workbench.session import BrokenSession, SessionFolder, SessionInUse, digest_of


@pytest.fixture
def folder(tmp_path):
    folder = SessionFolder(tmp_path / "session")
    folder.take()
    yield folder
    folder.give_back()


def test_it_keeps_what_it_is_given(folder):
    assert folder.load() is None
    content = {"files": [], "exploration": {"value": 0.1 + 0.2, "name": "µ \N{BLACK STAR}"}}
    folder.save(content)
    found = folder.load()
    assert found["version"] == 1
    assert found["exploration"] == content["exploration"]
    assert sorted(os.listdir(folder.path)) == ["lock", "session.json"]


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"version": "1"}', '{"version": 99}', "\x00", '{"files": []}']
)
def test_a_broken_one_is_said_and_left_as_it_is(folder, text):
    path = folder.path / "session.json"
    path.write_text(text)
    with pytest.raises(BrokenSession, match=r"session\.json cannot be read: .*left as it is"):
        folder.load()
    assert path.read_text() == text


def test_bytes_that_are_no_text_are_broken(folder):
    (folder.path / "session.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BrokenSession):
        folder.load()


def test_two_servers_cannot_have_it(folder):
    other = SessionFolder(folder.path)
    with pytest.raises(SessionInUse, match=f"process {os.getpid()}.*--session"):
        other.take()
    folder.give_back()
    other.take()
    other.give_back()


@pytest.mark.slow  # another process imports all
def test_a_lock_whose_server_is_gone_is_taken_over(tmp_path):
    code = (
        "import os, sys; from skhoid.lab.workbench.session import SessionFolder; "
        "SessionFolder(sys.argv[1]).take(); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert (tmp_path / "lock").read_text().strip().isdecimal()
    folder = SessionFolder(tmp_path)
    folder.take()
    assert (tmp_path / "lock").read_text() == f"{os.getpid()}\n"
    folder.give_back()


def test_a_file_is_no_folder(tmp_path):
    path = tmp_path / "session"
    path.write_text("")
    with pytest.raises(ValueError, match="is a file; name a folder by --session"):
        SessionFolder(path).take()


@pytest.mark.skipif(os.geteuid() != 0, reason="/proc cannot be written into, even by root")
def test_a_folder_that_cannot_be_made_is_said():
    with pytest.raises(OSError, match="another folder by --session"):
        SessionFolder("/proc/skhoid").take()


def test_a_full_disk_leaves_the_old_one(folder, monkeypatch):
    folder.save({"step": 1})

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_text", full)
        with pytest.raises(OSError, match="No space left") as error:
            folder.save({"step": 2})
    assert error.value.filename == str(folder.path / "session.json")
    assert folder.load()["step"] == 1
    assert sorted(os.listdir(folder.path)) == ["lock", "session.json"]


@pytest.mark.parametrize(
    "name",
    [
        "../session.json",
        "session.json",
        "lock",
        "..",
        "",
        "report",
        "report.html/",
        "report-9.html",
    ],
)
def test_only_reports_of_the_session_are_given_out(folder, name):
    folder.save({})
    (folder.path / "report.html").write_text("page")
    assert folder.report("report.html") == folder.path / "report.html"
    assert folder.report(name) is None


def test_a_link_is_no_report(folder, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("secret")
    (folder.path / "report.html").symlink_to(secret)
    assert folder.report("report.html") is None


def test_files_are_known_by_what_they_hold(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"abc")
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # FIPS 180-4, B.1
    assert digest_of(path) == {"size": 3, "sha256": known}
