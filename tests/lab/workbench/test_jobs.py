"""Searches in a process of their own."""

import os
import queue
import signal
import subprocess
import sys
import time

import pytest
from support.workbench import same, until

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.lab.workbench.bench import UNFINISHED
from skhoid.lab.workbench.jobs import SearchJob

pytestmark = pytest.mark.slow  # a process is started, and searches

BESIDE = """
import sys, time
from skhoid import EffectSearchCV, OperatorRegressor, read_runs
from skhoid.lab.workbench.jobs import SearchJob
if __name__ == "__main__":
    X, y = read_runs(sys.argv[1])
    search = EffectSearchCV(OperatorRegressor(inputs=["e"]), n_jobs=1)
    begun = []
    job = SearchJob(search, X, y, lambda *told: begun.append(told), print)
    while not begun:
        time.sleep(0.05)
    print("pid", job.pid, flush=True)
    time.sleep(600)
"""


@pytest.fixture
def started(runs):
    """A function that starts a search, and the queue of what it tells."""
    X, y = runs
    jobs, told = [], queue.Queue()

    def start(search):
        job = SearchJob(
            search,
            X.rename(columns={"error": "e", "pitch": "x", "target": "f_t"}),
            y,
            lambda *progress: told.put(progress),
            lambda job, found, why: told.put((job, found, why)),
        )
        jobs.append(job)
        return job

    yield start, told
    for job in jobs:
        job.stop()


def few(**more):
    return EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone"], n_jobs=1, **more)


def alive(pid):
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def ended(told):
    """What it says at the end, and the progress before."""
    progress = []
    while True:
        message = told.get(timeout=120)
        if isinstance(message[0], SearchJob):
            return message, progress
        progress.append(message)


def test_it_finds_what_a_search_here_finds(started, runs):
    start, told = started
    job = start(few())
    (who, found, why), progress = ended(told)
    assert who is job
    assert why == ""
    X, y = runs
    here = few().fit(X.rename(columns={"error": "e", "pitch": "x", "target": "f_t"}), y)
    assert found.ranking_.equals(here.ranking_)
    assert found.best_effects_ == here.best_effects_
    shares = [share for share, _ in progress]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] < 1.0
    assert progress[0][1].startswith("Searching, step 1: ")
    until(lambda: not alive(job.pid))


def test_it_is_stopped_at_once(started):
    start, told = started
    job = start(EffectSearchCV(OperatorRegressor(), n_jobs=1))
    told.get(timeout=120)  # it is under way
    begun = time.monotonic()
    job.stop()
    assert time.monotonic() - begun < 1.0
    assert not alive(job.pid)
    time.sleep(0.3)
    while not told.empty():
        assert len(told.get()) == 2  # progress, and no end


def test_an_error_comes_as_text(started):
    start, told = started
    start(few(max_effects=-1))
    (_, found, why), _ = ended(told)
    assert found is None
    assert why.startswith("The search failed: ")
    assert "max_effects" in why


def test_a_search_that_is_killed_is_said(started):
    start, told = started
    job = start(EffectSearchCV(OperatorRegressor(), n_jobs=1))
    told.get(timeout=120)
    os.kill(job.pid, signal.SIGKILL)
    (_, found, why), _ = ended(told)
    assert found is None
    assert "ended from outside (SIGKILL)" in why
    assert "memory does not suffice" in why


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


def test_a_search_on_the_page(fitted):
    assert fitted.call("search")["state"]["search"]["words"]
    assert fitted.bench.folder.load()["searching"]
    dragged = 0
    fitted.call("add", effect="bias")
    while fitted.call("state")["state"]["search"] is not None:  # which is no reason to wait
        fitted.call("drag", name="bias__level", value=0.01 * (dragged % 100))
        dragged += 1
    assert dragged > 10
    state = fitted.call("state")["state"]
    assert state["verdict_kind"] == "found"
    assert not fitted.bench.folder.load()["searching"]


def test_a_search_is_stopped_on_the_page(fitted):
    fitted.call("search")
    job = fitted.bench._job
    fitted.call("search")  # in another tab: there is one
    assert fitted.bench._job is job
    assert fitted.call("stop")["state"]["search"] is None
    assert not alive(job.pid)
    assert not fitted.bench.folder.load()["searching"]
    assert fitted.call("add", effect="bias")["state"]["effects"]


def test_a_killed_search_is_said_on_the_page(fitted):
    fitted.call("search")
    os.kill(fitted.bench._job.pid, signal.SIGKILL)
    (note,) = until(lambda: fitted.opening()["notes"])
    assert "SIGKILL" in note
    assert fitted.call("state")["state"]["search"] is None


def test_fit_and_search_at_once(begun, runs_file):
    page = begun(runs_file)
    page.wait("columns")
    page.post("fit", search=True)
    page.wait("bench")
    until(lambda: page.call("state")["state"]["verdict_kind"] == "found")
    assert "bias" in page.call("state")["state"]["verdict"]


def test_a_server_killed_in_a_search_says_so_later(fitted, begun):
    fitted.call("add", effect="bias")
    fitted.call("search")
    before = fitted.state()
    fitted.bench.folder.give_back()  # as the system does when a process is killed
    kept = fitted.bench.folder.load()
    fitted.bench.stop()
    page = begun()
    found = page.wait("bench")
    assert kept["searching"]
    assert found["notes"] == [UNFINISHED]
    assert same(page.state(), before)
