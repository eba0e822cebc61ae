"""Searches in a process of their own."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest
from support.workbench import same, until

pytestmark = pytest.mark.slow  # a process is started, imports all, and searches

BESIDE = """
import sys, time
from skhoid import EffectSearchCV, OperatorRegressor, read_runs
from skhoid.lab.workbench.jobs import SearchJob
if __name__ == "__main__":
    X, y = read_runs(sys.argv[1])
    search = EffectSearchCV(OperatorRegressor(inputs=["e"]), effects=["bias", "drift"])
    begun = []
    job = SearchJob(search, X, y, lambda *told: begun.append(told), print)
    while not begun:
        time.sleep(0.05)
    print("pid", job.pid, flush=True)
    time.sleep(600)
"""


def alive(pid):
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def children():
    """Processes of searches that run."""
    return [one.pid for one in multiprocessing.active_children() if one.name == "skhoid-search"]


def test_a_search_on_the_page_tells_how_far_it_is_and_what_it_finds(fitted):
    assert fitted.call("search")["state"]["search"]["words"]
    assert fitted.bench.folder.load()["searching"]
    fitted.call("add", effect="bias")
    dragged, shares = 0, []
    while (state := fitted.call("state")["state"])["search"] is not None:  # no reason to wait
        fitted.call("drag", name="bias__level", value=0.01 * (dragged % 100))
        shares.append(state["search"]["share"])
        dragged += 1
    assert dragged > 10
    assert shares == sorted(shares)
    assert shares[-1] < 1.0
    until(lambda: not children() and not fitted.bench.folder.load()["searching"])
    assert fitted.call("state")["state"]["verdict_kind"] == "found"
    assert "bias" in state["verdict"]


def test_a_search_is_stopped_or_killed(fitted):
    fitted.call("search")
    (pid,) = children()
    fitted.call("search")  # in another tab: there is one
    assert children() == [pid]
    begun = time.monotonic()
    assert fitted.call("stop")["state"]["search"] is None
    assert time.monotonic() - begun < 2.0
    assert not alive(pid)
    assert not fitted.bench.folder.load()["searching"]
    fitted.call("search")
    os.kill(children()[0], signal.SIGKILL)
    (note,) = until(lambda: fitted.opening()["notes"])
    assert "ended from outside (SIGKILL)" in note
    assert "memory does not suffice" in note
    assert fitted.call("state")["state"]["search"] is None


def end_badly(*_):
    print("first", file=sys.stderr)
    print("the disk is full", file=sys.stderr, flush=True)
    os._exit(3)


def test_a_search_that_ends_without_a_result_says_its_last_line(fitted, monkeypatch):
    monkeypatch.setattr("skhoid.lab.workbench.jobs._searching", end_badly)
    fitted.call("search")
    (note,) = until(lambda: fitted.opening()["notes"])
    assert note.endswith("(exit code 3): the disk is full")


def test_a_server_killed_in_a_search_says_so_later(fitted, begun):
    fitted.call("search")
    before = fitted.state()
    fitted.bench.folder.give_back()  # as the system does when a process is killed
    assert fitted.bench.folder.load()["searching"]
    fitted.bench.stop()
    page = begun()
    (note,) = page.wait("bench")["notes"]
    assert note.startswith("The search was not finished when the workbench ended")
    assert same(page.state(), before)


def test_a_server_that_is_killed_leaves_no_search(runs_file, tmp_path):
    script = tmp_path / "beside.py"
    script.write_text(BESIDE)
    command = [sys.executable, str(script), str(runs_file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        line = next(line for line in server.stdout if line.startswith("pid "))
        pid = int(line.split()[1])
        assert alive(pid)
        server.kill()
    until(lambda: not alive(pid), 5)
