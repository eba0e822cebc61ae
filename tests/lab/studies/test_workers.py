"""Workers: how many and of what kind changes nothing, nor does losing them."""

import io
import os
import runpy
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from joblib import Parallel, delayed, parallel_config
from joblib.parallel import LokyBackend
from threadpoolctl import threadpool_info, threadpool_limits

from skhoid import MonteCarloStudy
from skhoid.exceptions import WorkersLostError
from skhoid.lab.studies.workers import progress_bar, yield_results

SHORT = {"duration": 5.12, "run_in": 2.0}
CELLS = {"condition": ["C1", "C4"], "remnant_intensity": [0.0, 0.1]}
N, SIZE = 6, 3  # replications, of a block


def make_spread(scale=1.0):
    def spread(data):
        return {"u": scale * data.y.std(), "own": data.random_state}

    return spread


def study(function=None, n=N, **options):
    options = {"simulation": SHORT, "random_state": 5, "block_size": SIZE} | options
    return MonteCarloStudy(function or make_spread(), CELLS, n, **options)


@pytest.fixture(scope="module")
def table():
    return study().run()


def same(one, two):
    pd.testing.assert_frame_equal(one, two, check_exact=True)


def test_threads_give_the_same_table(table, tmp_path):
    with parallel_config(backend="threading", n_jobs=2):
        same(study().run(tmp_path), table)


def test_threads_for_batched_functions(table):
    def spread(block):
        u = [data.y.std() for data in block.data_sets()]
        return {"replication": block.replications, "u": u, "process": os.getpid()}

    found = study(spread, batched=True).run(n_jobs=2)
    assert set(found["process"]) == {os.getpid()}
    np.testing.assert_array_equal(found["u"], table["u"])


@threadpool_limits.wrap(limits=2)  # conftest.py has set one
def test_linear_algebra_does_not_share_out_the_machine_twice():
    def threads(data):
        inner = Parallel()(delayed(os.getpid)() for _ in range(2))
        pools = [pool["num_threads"] for pool in threadpool_info()]
        return {"most": max(pools), "inside": set(inner) == {os.getpid()}}

    before = [pool["num_threads"] for pool in threadpool_info()]
    for n_jobs in (1, 2):
        with parallel_config(backend="threading"):
            found = study(threads).run(n_jobs=n_jobs)
        assert set(found["most"]) == {1}
        assert found["inside"].all()
    assert [pool["num_threads"] for pool in threadpool_info()] == before


@pytest.mark.slow
def test_a_block_that_kills_its_worker(table, tmp_path):
    """It is named, everything else is done, and what is done is what one process finds."""
    deadly = tmp_path / "deadly"
    deadly.touch()

    def function(data):
        of_first_block = data.task.remnant is None and data.task.is_constant
        if deadly.exists() and of_first_block and data.replication == 0:
            os._exit(1)
        return {"u": data.y.std(), "own": data.random_state}

    message = r"died repeatedly.*: replications 0 to 2 of condition=C1, remnant_intensity=0\.0\. "
    with pytest.raises(WorkersLostError, match=message):
        study(function).run(tmp_path / "study", n_jobs=2)
    assert len(list((tmp_path / "study" / "blocks").iterdir())) == len(table) / SIZE - 1
    deadly.unlink()
    same(study(function).run(tmp_path / "study"), table)


@pytest.mark.slow
def test_workers_that_all_die():
    with pytest.raises(WorkersLostError, match="Of 40 blocks, 37 more are left"):
        list(yield_results(dict.fromkeys(range(40)), lambda job: os._exit(1), n_jobs=2))


@pytest.mark.slow
def test_stopping_while_results_wait():
    """No warning of joblib's that they were not used, which would hide the reason."""
    jobs = dict.fromkeys(range(20))
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        for _ in yield_results(jobs, lambda job: job, n_jobs=2):
            time.sleep(0.5)  # more are there by then
            raise KeyboardInterrupt
    assert len(list(yield_results(jobs, lambda job: job, n_jobs=2))) == 20


SCRIPT = """
import sys, time
from skhoid import MonteCarloStudy

def slow(data):
    time.sleep(0.03)
    return {"u": data.y.std(), "own": data.random_state}

study = MonteCarloStudy(
    slow, {"condition": ["C1", "C4"], "remnant_intensity": [0.0, 0.1]}, 6,
    simulation={"duration": 5.12, "run_in": 2.0}, random_state=5, block_size=3,
)
if __name__ == "__main__":
    study.run(sys.argv[1])
"""


@pytest.mark.slow
def test_a_study_that_is_killed_goes_on(table, tmp_path):
    """SIGKILL leaves no time for anything."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    with subprocess.Popen([sys.executable, str(script), str(tmp_path / "study")]) as process:
        while not list(tmp_path.glob("study/blocks/block*")):
            assert process.poll() is None
            time.sleep(0.002)
        process.kill()
    assert 1 <= len(list(tmp_path.glob("study/blocks/block*"))) < len(table) / SIZE
    same(runpy.run_path(str(script))["study"].run(tmp_path / "study"), table)


@pytest.mark.slow
def test_rounds_for_backends_without_generators(monkeypatch):
    """ray and spark, by their joblib backends."""
    monkeypatch.setattr(LokyBackend, "supports_return_generator", False)
    found = dict(yield_results({i: i for i in range(70)}, lambda job: job**2, n_jobs=2))
    assert found == {i: i**2 for i in range(70)}


def test_progress_is_a_bar_in_a_terminal_and_lines_in_a_log(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    def shown(stream, progress):
        monkeypatch.setattr(sys, "stderr", stream)
        with progress_bar(progress, 4, 1, "study") as advance:
            advance("block")
            time.sleep(0.15)
        return stream.getvalue()

    assert shown(io.StringIO(), None) == ""
    assert shown(Terminal(), False) == ""
    assert shown(io.StringIO(), True) == "study: block, 2 of 4 done, 0 min left\n"
    text = shown(Terminal(), None)
    assert "study" in text
    assert "2/4" in text
