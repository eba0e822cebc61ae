"""What ends, and how, when the process is told to."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from skhoid._machine import check_memory, ended_by_signals
from skhoid.io.writing import written_whole

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has other signals")

SEARCH = """
from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs

if __name__ == "__main__":
    data = make_tracking_runs(
        "C1", n_runs=12, channels=["e", "x", "f_t"], remnant_intensity=0.2, random_state=0
    )
    EffectSearchCV(OperatorRegressor(), n_jobs=2).fit(*data)
"""
STUDY = """
import time
from skhoid import MonteCarloStudy


def slow(data):
    time.sleep(0.2)
    return 1.0


if __name__ == "__main__":
    short = {"duration": 5.12, "run_in": 2.0, "remnant_gain": 0.02}
    study = MonteCarloStudy(slow, {"condition": ["C1"]}, 4000, simulation=short, block_size=1)
    study.run(n_jobs=2)
"""


def write_until(path, number):
    with ended_by_signals(), written_whole(path) as aside:
        aside.touch()
        os.kill(os.getpid(), number)


@pytest.mark.parametrize(("name", "code"), [("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_signal_becomes_an_exit_and_the_handler_goes(tmp_path, name, code):
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(SystemExit) as stop:
            write_until(tmp_path / "a.csv", number)
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert stop.value.code == code
    assert not list(tmp_path.iterdir())


def test_a_hangup_that_is_ignored_stays_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_handler_of_the_users_stays():
    seen = []
    before = signal.signal(signal.SIGTERM, lambda *_: seen.append(1))
    try:
        with ended_by_signals():
            os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert seen == [1]


def test_other_threads_are_left_alone():
    done = []

    def work():
        with ended_by_signals():
            done.append(1)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [1]


def test_more_than_the_machine_has_is_refused():
    check_memory(1e3, "A little")
    with pytest.raises(ValueError, match=r"Too much would take .* GiB of memory, but the machine"):
        check_memory(1e18, "Too much")


def interruptible():
    """Take SIGINT, which a shell in the background makes its children ignore, and SIGHUP."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def runs_on(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def workers_of(pid):
    """Child processes of joblib that compute."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    words = {int(child): Path(f"/proc/{child}/cmdline").read_bytes() for child in children}
    return [child for child, line in words.items() if b"popen_loky" in line]


def wait_until(true, seconds):
    until = time.monotonic() + seconds
    while not true() and time.monotonic() < until:
        time.sleep(0.05)
    assert true()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="workers are looked up in /proc")
@pytest.mark.parametrize(
    ("script", "number", "code"),
    [(STUDY, signal.SIGTERM, 143), (SEARCH, signal.SIGINT, -signal.SIGINT)],
    ids=["study", "search"],
)
def test_work_that_is_stopped_leaves_no_workers(tmp_path, script, number, code):
    file = tmp_path / "work.py"
    file.write_text(script)
    process = subprocess.Popen(
        [sys.executable, str(file)],
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=interruptible,
    )
    try:
        wait_until(lambda: len(workers_of(process.pid)) == 2, 120)
        workers = workers_of(process.pid)
        time.sleep(1.0)  # some of the work is under way
        process.send_signal(number)
        assert process.wait(30) == code
        wait_until(lambda: not any(map(runs_on, workers)), 10)
    finally:
        os.killpg(process.pid, signal.SIGKILL) if process.poll() is None else None


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_the_command_line_ends(tmp_path, number, code):
    words = [sys.executable, "-m", "skhoid", "study", "fig13", "--replications", "5000"]
    process = subprocess.Popen(
        [*words, "--out", str(tmp_path)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=interruptible,
    )
    try:
        wait_until(lambda: list(tmp_path.glob("**/study.json")), 120)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
        assert (process.returncode, said) == (code, "")
    finally:
        process.kill()
