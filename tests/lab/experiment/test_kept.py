"""The folder of a call: resumed without loss, refused for other data."""

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


def block(folder, number):
    (found,) = (folder / "blocks").glob(f"block-{number:06d}-*.json")
    return found


def same(one, two):
    for name in ("table", "groups", "runs", "failures", "outlying", "found"):
        pd.testing.assert_frame_equal(getattr(one, name), getattr(two, name), check_exact=True)
    assert one.summary() == two.summary()
    assert one.models.keys() == two.models.keys()
    for key, model in one.models.items():
        assert model.coef_.tolist() == two.models[key].coef_.tolist()


def test_finished_groups_are_read_and_others_are_computed(data, tmp_path, fitted):
    folder = tmp_path / "people"
    whole = identify_people(ARX, *data, ceiling=False)
    fitted.clear()
    same(identify_people(ARX, *data, ceiling=False, folder=folder), whole)
    assert fitted == ["P1 A", "P1 B", "P2 A", "P2 B"]
    same(identify_people(ARX, *data, ceiling=False, folder=folder), whole)
    assert len(fitted) == 4
    block(folder, 1).unlink()
    damaged = block(folder, 3)
    damaged.write_bytes(damaged.read_bytes()[:-50])
    with pytest.warns(StudyWarning, match="damaged"):
        same(identify_people(ARX, *data, ceiling=False, folder=folder), whole)
    assert fitted[4:] == ["P1 B", "P2 B"]


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
