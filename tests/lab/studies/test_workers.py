"""Workers: how many and of what kind changes nothing, nor does losing them."""

import io
import os
import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest
from joblib import Parallel, delayed, parallel_config
from threadpoolctl import threadpool_info, threadpool_limits

from skhoid import MonteCarloStudy
from skhoid.exceptions import WorkersLostError
from skhoid.lab.studies.workers import one_thread, progress_bar, results_of

SHORT = {"duration": 5.12, "run_in": 2.0}
CELLS = {"condition": ["C1", "C4"], "remnant_intensity": [0.0, 0.1]}
N, SIZE = 12, 3  # replications, of a block


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


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["loky", "threading"])
def test_any_backend_gives_the_same_table(table, tmp_path, backend):
    with parallel_config(backend=backend, n_jobs=2):
        same(study().run(tmp_path), table)


@pytest.mark.slow
def test_functions_of_all_kinds_reach_workers(table):
    functions = [lambda data: {"u": data.y.std(), "own": data.random_state}]
    functions += [partial(make_spread(1.0)), make_spread(1.0)]
    for function in functions:
        same(study(function).run(n_jobs=2), table)


def test_threads_for_batched_functions(table):
    def spread(block):
        u = [data.y.std() for data in block.data_sets()]
        return {"replication": block.replications, "u": u, "process": os.getpid()}

    found = study(spread, batched=True).run(n_jobs=2)
    assert set(found["process"]) == {os.getpid()}
    np.testing.assert_array_equal(found["u"], table["u"])


@pytest.mark.slow
@threadpool_limits.wrap(limits=2)  # conftest.py has set one
def test_linear_algebra_does_not_share_out_the_machine_twice():
    def threads(data):
        inner = Parallel()(delayed(os.getpid)() for _ in range(2))
        pools = [pool["num_threads"] for pool in threadpool_info()]
        return {"most": max(pools), "inside": set(inner) == {os.getpid()}}

    before = [pool["num_threads"] for pool in threadpool_info()]
    for n_jobs in (1, 2):
        found = study(threads).run(n_jobs=n_jobs)
        assert set(found["most"]) == {1}
        assert found["inside"].all()
    with one_thread():
        with one_thread():
            pass
        assert {pool["num_threads"] for pool in threadpool_info()} == {1}
    assert [pool["num_threads"] for pool in threadpool_info()] == before


def dying(marker, always=False, where=4):
    def function(data):
        if data.replication == where and data.task.remnant is None and data.task.is_constant:
            try:
                os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
                os._exit(1)
            except FileExistsError:
                if always:
                    os._exit(1)
        return {"u": data.y.std(), "own": data.random_state}

    return function


@pytest.mark.slow
def test_a_worker_that_dies_once(table, tmp_path):
    same(study(dying(str(tmp_path / "m"))).run(tmp_path / "study", n_jobs=2), table)
    assert (tmp_path / "m").exists()


@pytest.mark.slow
def test_a_block_that_always_kills_its_worker(table, tmp_path):
    """It is named, and everything else is done."""
    deadly = dying(str(tmp_path / "m"), always=True, where=0)
    message = r"died repeatedly.*: replications 0 to 2 of condition=C1, remnant_intensity=0\.0\. "
    with pytest.raises(WorkersLostError, match=message):
        study(deadly).run(tmp_path / "study", n_jobs=2)
    assert len(list((tmp_path / "study" / "blocks").iterdir())) == len(table) / SIZE - 1


@pytest.mark.slow
def test_workers_that_all_die():
    with pytest.raises(WorkersLostError, match="Of 40 blocks, 37 more are left"):
        list(results_of(list(range(40)), lambda job: os._exit(1), n_jobs=2))


@pytest.fixture
def interruptible():
    """A shell that starts the tests in the background tells them to ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.slow
def test_stopping_leaves_finished_blocks(table, tmp_path, interruptible):
    """As with Ctrl-C while workers are busy."""
    main, blocks = os.getpid(), tmp_path / "blocks"

    def stopping(data):
        if data.replication == 7 and data.task.remnant is None and data.task.is_constant:
            while not list(blocks.glob("block-*")):  # written in whatever time it takes
                time.sleep(0.01)
            os.kill(main, signal.SIGINT)
            time.sleep(5)
        return {"u": data.y.std(), "own": data.random_state}

    with pytest.raises(KeyboardInterrupt):
        study(stopping).run(tmp_path, n_jobs=2)
    assert 1 <= len(list(blocks.glob("block-*"))) < len(table) / SIZE
    same(study().run(n_jobs=2), table)  # with workers that were stopped


@pytest.mark.slow
def test_stopping_while_results_wait():
    """No warning of joblib's that they were not used, which would hide the reason."""
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        for _ in results_of(list(range(20)), lambda job: job, n_jobs=2):
            time.sleep(1)  # more are there by then
            raise KeyboardInterrupt
    assert len(list(results_of(list(range(20)), lambda job: job, n_jobs=2))) == 20


SCRIPT = """
import sys, time
from skhoid import MonteCarloStudy

def spread(data):
    time.sleep(0.03)
    return {"u": data.y.std(), "own": data.random_state}

study = MonteCarloStudy(
    spread, {"condition": ["C1", "C4"], "remnant_intensity": [0.0, 0.1]}, 12,
    simulation={"duration": 5.12, "run_in": 2.0}, random_state=5, block_size=3,
)
print("ready", flush=True)
study.run(sys.argv[1], n_jobs=int(sys.argv[2])).to_pickle(sys.argv[1] + ".pickle")
"""


@pytest.mark.slow
def test_killed_at_a_random_moment(table, tmp_path):
    """SIGKILL leaves no time for anything; workers notice that they are orphans."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), str(tmp_path / "study"), "2"]
    rng = np.random.default_rng(2)
    kept, kills = 0, 0
    while not (tmp_path / "study.pickle").exists():
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout.readline() == "ready\n"
            if kills < 1:
                # Some blocks after what was there, and then any moment.
                wanted = kept + int(rng.integers(0, 3))
                while len(list(tmp_path.glob("study/blocks/block*"))) < wanted:
                    assert process.poll() is None
                    time.sleep(0.002)
                time.sleep(float(rng.uniform(0, 0.04)))
                process.kill()
        kills += 1
        left = len(list(tmp_path.glob("study/blocks/block*")))
        assert left >= kept
        kept = left
    assert kills == 2
    same(pd.read_pickle(tmp_path / "study.pickle"), table)


@pytest.mark.slow
def test_rounds_for_backends_without_generators(monkeypatch):
    """ray and spark, by their joblib backends."""
    backend = type(Parallel(n_jobs=2)._backend)
    monkeypatch.setattr(backend, "supports_return_generator", False)
    found = dict(results_of(list(range(30)), lambda job: job**2, n_jobs=2))
    assert found == {i: i**2 for i in range(30)}


def test_the_bar_is_quiet_where_there_is_no_terminal(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    def shown(stream, progress):
        monkeypatch.setattr(sys, "stderr", stream)
        with progress_bar(progress, 4, 1, "study") as advance:
            advance()
            time.sleep(0.15)
        return stream.getvalue()

    assert shown(io.StringIO(), None) == ""
    assert shown(Terminal(), False) == ""
    text = shown(Terminal(), None)
    assert "study" in text
    assert "2/4" in text
    assert "left" in text
