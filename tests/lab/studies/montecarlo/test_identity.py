"""What identifies a study: seeds and folders outlive the move and the rewriting of code."""

import importlib.util
import json
import pickle
import shutil
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from skhoid import MonteCarloStudy, StudyFolderError
from skhoid.effects import DeadZone
from skhoid.lab.experiment import recommend_forgetting
from skhoid.lab.studies.montecarlo import identified_as
from skhoid.lab.studies.montecarlo import study as study_module
from skhoid.lab.studies.montecarlo.declared import BEFORE
from skhoid.lab.studies.montecarlo.identity import described
from skhoid.lab.studies.thesis import delay_study, forgetting_study, path_study, response_study
from skhoid.simulation import tracking_condition

pytestmark = pytest.mark.slow  # simulates studies

# Made by the code of commit 992cbae, whose identities held names of modules: old_folder by study()
# of the users_study.py in it, old_manifests.json (study.json of each) by THESIS, run below.
DATA = Path(__file__).parent / "data"
USERS = DATA / "old_folder" / "users_study.py"
SHORT = {"duration": 5.12, "run_in": 2.0, "remnant_gain": 0.02}


def loaded(path, name):
    """A module of some name, made of a file."""
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(autouse=True)
def version(monkeypatch):
    """That of the code that made them, which is part of what a study is."""
    monkeypatch.setattr(study_module, "__version__", "0.1.0")


@pytest.fixture
def users():
    return loaded(USERS, "users_study")


@pytest.fixture
def moved(tmp_path):
    """The same module under another name, in another place."""
    return loaded(shutil.copy(USERS, tmp_path / "elsewhere.py"), "elsewhere")


@pytest.fixture
def folder(tmp_path):
    return shutil.copytree(
        DATA / "old_folder", tmp_path / "study", ignore=shutil.ignore_patterns("*.py", "__*")
    )


@pytest.fixture
def computed(monkeypatch):
    """First replications of the blocks that are computed."""
    seen = []

    def counting(job):
        seen.append(job.replications[0])
        return compute(job)

    compute = study_module.compute
    monkeypatch.setattr(study_module, "compute", counting)
    return seen


def assert_same(one, two):
    """The same labels and seeds, and the same numbers on any machine."""
    pd.testing.assert_frame_equal(one, two, check_exact=False, rtol=1e-9)
    np.testing.assert_array_equal(one["drawn"], two["drawn"])


def drawn(data, nk=29):
    return data.random_state


def test_seeds_of_numbers_text_and_dataclasses():
    """The numbers are those of commit 992cbae, but the last: dead zones have a place since."""
    cells = [
        {"condition": "C1"},
        {"condition": "C3", "remnant_order": "nm", "nk": 30},
        {"condition": tracking_condition("C4"), "perturbation": {"K_e": 0.1}},
        {"condition": "C2", "effects": DeadZone(width=0.1)},
    ]
    study = MonteCarloStudy(drawn, cells, 2, simulation=SHORT, random_state=7)
    assert [study._entropy_of(cell) for cell in range(4)] == [
        41098942111983134602174526262334881849,
        242756023573321374327621780797914664001,
        146458000074415356508861209006480239423,
        132474531439331972335643645993093662533,
    ]
    assert list(study.run()["value"]) == [
        3854802803, 792157817, 2384964344, 2460302152, 244030074, 3394935553, 4136073076,
        2104981057,
    ]  # fmt: skip


def test_a_module_that_moves_changes_neither_seeds_nor_folders(users, moved, tmp_path, computed):
    before, after = users.study(), moved.study()
    assert after.description == before.description
    assert "users_study" not in json.dumps(before.description)
    table = before.run(tmp_path / "new")
    pd.testing.assert_frame_equal(after.run(), table, check_exact=True)
    del computed[:]
    pd.testing.assert_frame_equal(after.run(tmp_path / "new"), table, check_exact=True)
    assert computed == []


MODULE = """
import enum, functools

class Shade(enum.Enum):
    DARK = 1

class Model:
    def __init__(self, nk): self.nk, self.shade = nk, Shade.DARK
    def __call__(self, data): return self.nk
    def method(self, data): return type(self).__name__

def local(data):
    class Inner: pass
    return Inner

functions = [Model(3), Model(3).method, Model, Shade.DARK, local, functools.partial(local, Model),
             lambda data: (__name__, __file__, Model)]
others = [Model(4), Model(4).method, Shade, Model, Model.method, functools.partial(local, Shade),
          lambda data: (__name__, Model)]
"""


def test_no_description_holds_a_module(tmp_path):
    modules = []
    for name in ("one", "two"):
        path = tmp_path / f"{name}.py"
        path.write_text(MODULE, encoding="utf-8")
        with pytest.MonkeyPatch.context() as patch:  # so that objects of it can be pickled
            module = loaded(path, name)
            patch.setitem(sys.modules, name, module)
            modules.append([[described(x) for x in y] for y in (module.functions, module.others)])
    assert modules[0] == modules[1]
    assert all(one != two for one, two in zip(*modules[0], strict=True))


def test_an_old_folder_is_read(users, folder, computed):
    study = users.study()
    table = study.run(folder)
    assert computed == []
    assert list(table["form"].unique()) == list(study.cells["form"])
    assert list(table["drawn"]) == [
        study.data_set(c, r).random_state for c in (0, 1) for r in (0, 1)
    ]


def test_an_old_folder_resumes_with_its_seeds(users, folder, computed):
    whole = users.study().run(folder)
    manifest = (folder / "study.json").read_bytes()
    for number in (0, 3):
        (folder / "blocks" / f"block-{number:06d}.parquet").unlink()
    drawing = users.study(random_state=None)
    assert_same(drawing.run(folder), whole)
    assert computed == [0, 1]
    assert_same(users.study().run(folder), whole)
    assert len(computed) == 2
    assert (folder / "study.json").read_bytes() == manifest


def test_a_study_that_was_in_an_old_folder_is_itself_in_a_new_one(users, folder, tmp_path):
    study, fresh = users.study(), users.study().run()
    study.run(folder)
    pd.testing.assert_frame_equal(study.run(tmp_path / "new"), fresh, check_exact=True)
    assert "identity" in json.loads((tmp_path / "new" / "study.json").read_text(encoding="utf-8"))


def test_old_folders_of_other_studies(users, moved, folder):
    study = users.study(random_state=4)
    cells = study.cells
    with pytest.raises(StudyFolderError, match=r'study: entropy: "5" there, "4" here\. Use'):
        study.run(folder)
    pd.testing.assert_frame_equal(study.cells, cells)
    with pytest.raises(StudyFolderError, match=r'"users_study\..*" there, "elsewhere\..*" here'):
        moved.study().run(folder)


CELL = {"conditions": ["C1"], "intensities": [0.15]}
HORIZONS = {"memory_horizons": [64.0, np.inf], "n_validation": 1}
THESIS = {
    "delays": partial(delay_study, 2, **CELL, orders=[2], n_validation=1),
    "forgetting": partial(forgetting_study, 2, **CELL, **HORIZONS),
    "paths": partial(path_study, 2, **CELL),
    "responses": partial(response_study, 2, **CELL),
    "recommended": partial(recommend_forgetting, "C4", 0.15, n_replications=2, **HORIZONS),
}


@pytest.mark.parametrize("name", THESIS)
def test_old_folders_of_the_thesis(name, tmp_path):
    manifest = json.loads((DATA / "old_manifests.json").read_text(encoding="utf-8"))[name]
    (tmp_path / "study.json").write_text(json.dumps(manifest), encoding="utf-8")
    found = THESIS[name](out=tmp_path).table
    assert json.loads((tmp_path / "study.json").read_text(encoding="utf-8")) == manifest
    pd.testing.assert_frame_equal(found, THESIS[name]().table, check_exact=True)


def test_all_old_names_are_tried():
    manifests = json.loads((DATA / "old_manifests.json").read_text(encoding="utf-8"))
    text = json.dumps([manifest["function"] for manifest in manifests.values()])
    assert all(json.dumps(old) in text for old in BEFORE.values())


@identified_as("spread of u", version=1)
def spread(data, scale=1.0):
    return scale * data.y.std()


@identified_as("spread of u", version=1)
def rewritten(data, scale=1.0):
    return data.y.std() * scale


@identified_as("spread of u", version=2)
def variance(data, scale=1.0):
    return scale * data.y.var()


def test_declared_identities(tmp_path, computed):
    def run(function):
        return MonteCarloStudy(
            function, {"condition": ["C1"]}, 2, simulation=SHORT, random_state=0
        ).run(tmp_path)

    table = run(spread)
    del computed[:]
    assert run(rewritten).equals(table)
    assert computed == []
    with pytest.raises(StudyFolderError, match=r'function\[1\]: "version 1" there, "version 2"'):
        run(variance)
    assert described(pickle.loads(pickle.dumps(spread))) == ["spread of u", "version 1"]
    assert described(partial(spread, scale=2.0)) != described(partial(spread, scale=3.0))


class Fit:
    pass


@pytest.mark.parametrize(
    ("name", "version", "function", "error", "message"),
    [
        ("", 1, drawn, ValueError, "non-empty text"),
        ("a", 0, drawn, ValueError, "at least 1; got 0"),
        ("a", True, drawn, ValueError, "at least 1; got True"),
        ("a", 1, partial(drawn, nk=1), TypeError, "before functools.partial"),
        ("a", 1, Fit, TypeError, "is for functions"),
    ],
)
def test_identities_that_make_no_sense(name, version, function, error, message):
    with pytest.raises(error, match=message):
        identified_as(name, version)(function)


def test_what_encloses_values_has_no_identity_of_its_own():
    def fit(data):
        return data.y.std()

    with pytest.raises(ValueError, match="defined within a function"):
        identified_as("fit")(fit)
