"""The same study on a cluster: dask.distributed through joblib."""

import os
import signal
import threading
import time

import pandas as pd
import pytest
from joblib import parallel_config

from skhoid import MonteCarloStudy

distributed = pytest.importorskip("distributed")

CELLS = {"condition": ["C1", "C4"], "remnant_intensity": [0.0, 0.1]}


def study(marker=None, rest=0.0):
    def spread(data):
        time.sleep(rest)
        if marker is not None:
            (marker / f"{data.seed[0]}-{data.replication}").touch()
        return {"u": data.y.std(), "own": data.random_state}

    options = {"simulation": {"duration": 5.12, "run_in": 2.0}, "random_state": 5}
    return MonteCarloStudy(spread, CELLS, 12, block_size=3, **options)


@pytest.fixture(scope="module")
def table():
    return study().run()


@pytest.fixture
def cluster():
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=50,
        ) as cluster,
        distributed.Client(cluster) as client,
        parallel_config(backend="dask"),
    ):
        yield client


def processes(client):
    return sorted(set(client.run(os.getpid).values()))


def same(one, two):
    pd.testing.assert_frame_equal(one, two, check_exact=True)


@pytest.mark.slow
def test_a_cluster_gives_the_same_table(cluster, table, tmp_path):
    """Also when a worker is killed in the middle, and when the study goes on elsewhere."""
    same(study().run(tmp_path / "whole"), table)
    seen = tmp_path / "seen"
    seen.mkdir()
    victim = processes(cluster)[0]

    def kill():
        while len(list(seen.iterdir())) < 15:
            time.sleep(0.01)
        os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    found = study(seen, rest=0.02).run(tmp_path / "study")
    killer.join()
    same(found, table)
    assert victim not in processes(cluster)
    for block in sorted((tmp_path / "whole" / "blocks").iterdir())[::2]:
        block.unlink()
    with parallel_config(backend="sequential"):
        same(study().run(tmp_path / "whole"), table)
