"""The folder of a call: resumed without loss, refused for other data."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from support.small_experiment import NK, made

from skhoid import ARXRegressor
from skhoid.exceptions import StudyFolderError, StudyWarning
from skhoid.lab.experiment import identify, identify_people

ARX = ARXRegressor(nk=NK)


@pytest.fixture
def data():
    return made(subjects=2, conditions=("A", "B"), runs=2)


@pytest.fixture
def fitted(monkeypatch):
    """Groups that are computed."""
    seen = []

    def counting(job):
        seen.append(str(job.group))
        return fit_group(job)

    fit_group = identify.fit_group
    monkeypatch.setattr(identify, "fit_group", counting)
    return seen


def same(one, two):
    for name in ("table", "groups", "runs", "failures", "outlying", "found"):
        pd.testing.assert_frame_equal(getattr(one, name), getattr(two, name), check_exact=True)
    assert one.summary() == two.summary()
    assert one.models.keys() == two.models.keys()
    for key, model in one.models.items():
        assert model.coef_.tolist() == two.models[key].coef_.tolist()


@pytest.mark.slow
def test_finished_groups_are_read_and_others_are_computed(data, tmp_path, fitted):
    folder = tmp_path / "people"
    whole = identify_people(ARX, *data, ceiling=False)
    fitted.clear()
    same(identify_people(ARX, *data, ceiling=False, folder=folder), whole)
    assert fitted == ["P1 A", "P1 B", "P2 A", "P2 B"]
    same(identify_people(ARX, *data, ceiling=False, folder=folder), whole)
    assert len(fitted) == 4
    (folder / "blocks" / "block-000001.parquet").unlink()
    (folder / "models" / "model-000002.joblib").write_bytes(b"something else")
    (folder / "models" / ".0123456789abcdef.tmp.joblib").write_bytes(b"half")
    damaged = folder / "blocks" / "block-000003.parquet"
    damaged.write_bytes(damaged.read_bytes()[:-50])
    with pytest.warns(StudyWarning, match="damaged"):
        same(identify_people(ARX, *data, ceiling=False, folder=folder), whole)
    assert fitted[4:] == ["P1 B", "P2 A", "P2 B"]
    assert not list((folder / "models").glob(".*"))


@pytest.mark.slow
def test_models_are_computed_again_where_they_were_not_kept(data, tmp_path, fitted):
    without = identify_people(
        ARX, *data, ceiling=False, folder=tmp_path / "people", keep_models=False
    )
    assert without.models is None
    both = identify_people(ARX, *data, ceiling=False, folder=tmp_path / "people")
    assert len(fitted) == 8
    assert len(both.models) == 4
    pd.testing.assert_frame_equal(both.table, without.table, check_exact=True)


def test_another_estimator_or_other_data_are_refused(data, tmp_path):
    X, y = data
    identify_people(ARX, X, y, folder=tmp_path, ceiling=False)
    with pytest.raises(StudyFolderError, match=r"estimator\[1\].nk: 15 there, 16 here"):
        identify_people(ARXRegressor(nk=16), X, y, folder=tmp_path, ceiling=False)
    changed = y.copy()
    changed.iloc[-1] += 1e-9
    with pytest.raises(StudyFolderError, match=r"data.P2 B\[2\]"):
        identify_people(ARX, X, changed, folder=tmp_path, ceiling=False)
    with pytest.raises(StudyFolderError, match="ceiling: false there, true here"):
        identify_people(ARX, X, y, folder=tmp_path)


SCRIPT = """
import pickle, sys
from skhoid import OperatorRegressor
from skhoid.lab.experiment import identify_people
X, y = pickle.load(open(sys.argv[1], "rb"))
identify_people(OperatorRegressor(delay=0.28), X, y, folder=sys.argv[2])
"""


@pytest.mark.slow
def test_a_killed_call_goes_on_where_it_was(tmp_path):
    from skhoid import OperatorRegressor

    X, y = made(subjects=8, conditions=("A",), runs=2, n=1500)
    with open(tmp_path / "data.pkl", "wb") as file:
        pickle.dump((X, y), file)
    folder = tmp_path / "people"
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / "data.pkl"), str(folder)]
    process = subprocess.Popen(command)
    blocks = Path(folder / "blocks")
    until = time.monotonic() + 120
    while not (blocks.is_dir() and len(list(blocks.glob("block-*"))) >= 2):
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.002)
    os.kill(process.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
    process.wait()
    n_before = len(list(blocks.glob("block-*")))
    assert 2 <= n_before < 8
    before = {path: path.stat().st_mtime_ns for path in blocks.glob("block-*")}
    resumed = identify_people(OperatorRegressor(delay=0.28), X, y, folder=folder)
    assert all(path.stat().st_mtime_ns == when for path, when in before.items())
    whole = identify_people(OperatorRegressor(delay=0.28), X, y)
    for name in ("table", "groups", "runs", "outlying"):
        pd.testing.assert_frame_equal(
            getattr(resumed, name), getattr(whole, name), check_exact=True
        )
    for key, model in whole.models.items():
        assert model.parameters_.equals(resumed.models[key].parameters_)
