"""The same study and experiment on a cluster: dask.distributed through joblib."""

import os
import signal
import threading
import time

import pandas as pd
import pytest
from joblib import parallel_config

from skhoid import (
    EffectSearchCV,
    GroupEffectSearch,
    MonteCarloStudy,
    OperatorRegressor,
    identify_people,
    simulate_experiment,
)

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
    with parallel_config(backend="loky", n_jobs=2):
        same(study().run(), table)
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


@pytest.mark.slow
def test_a_cluster_gives_the_same_experiment_as_processes_here(cluster):
    setup = {"runs": 2, "duration": 15.0, "run_in": 2.0, "sampling_rate": 50.0}
    X, y = simulate_experiment(3, "C1", random_state=1, **setup)
    y += 0.1 * (y.index.get_level_values("subject") != "S1")
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"])

    def experiment():
        group = GroupEffectSearch(search).fit(X, y)
        return group, identify_people(OperatorRegressor(effects="bias"), X, y)

    on_cluster = experiment()
    with parallel_config(backend="loky", n_jobs=2):
        here = experiment()
    for name in ("evidence_", "prevalence_", "members_", "parameters_", "people_"):
        same(getattr(on_cluster[0], name), getattr(here[0], name))
    for name in ("table", "groups", "runs", "outlying"):
        same(getattr(on_cluster[1], name), getattr(here[1], name))
