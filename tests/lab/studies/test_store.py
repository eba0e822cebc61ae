"""The folder of a study: what is kept, what is refused, what is computed again."""

import json
import shutil

import pandas as pd
import pytest

from skhoid import MonteCarloStudy
from skhoid.exceptions import StudyFolderError, StudyWarning
from skhoid.lab.studies import monte_carlo as study_module

SHORT = {"duration": 5.12, "run_in": 2.0, "remnant_gain": 0.02}
CELLS = {"condition": ["C1", "C3"]}


def spread(data, scale=1.0):
    return {"u": scale * data.y.std(), "name": "x", "late": data.replication > 2}


def other(data, scale=1.0):
    return {"u": scale * data.y.var(), "name": "x", "late": data.replication > 2}


def study(function=spread, conditions=CELLS, n=6, **options):
    options = {"simulation": SHORT, "random_state": 3, "block_size": 2} | options
    return MonteCarloStudy(function, conditions, n, **options)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "finished"
    return folder, study().run(folder)


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished[0], tmp_path / "study")


@pytest.fixture
def computed(monkeypatch):
    """Blocks that are computed, by cell and first replication."""
    seen = []

    def counting(job):
        seen.append((job.labels["condition"], job.replications[0]))
        return compute(job)

    compute = study_module.compute
    monkeypatch.setattr(study_module, "compute", counting)
    return seen


def block(folder, number):
    (found,) = (folder / "blocks").glob(f"block-{number:06d}-*.json")
    return found


def test_the_folder_changes_nothing(finished, computed):
    folder, table = finished
    pd.testing.assert_frame_equal(study().run(), table, check_exact=True)
    assert len(computed) == 6
    del computed[:]
    pd.testing.assert_frame_equal(study().run(folder), table, check_exact=True)
    assert computed == []
    assert sorted(path.name for path in folder.iterdir()) == ["blocks", "study.json"]
    one = json.loads(block(folder, 1).read_text())
    assert one["replication"] == ["int64", [2, 3]]


def truncate(path):
    path.write_bytes(path.read_bytes()[:-30])


def wipe(path):
    contents = bytearray(path.read_bytes())
    contents[20:60] = bytes(40)
    path.write_bytes(contents)


def empty(path):
    path.write_bytes(b"")


@pytest.mark.parametrize("damage", [truncate, wipe, empty])
def test_damaged_blocks_are_computed_again(finished, folder, computed, damage):
    damage(block(folder, 1))
    with pytest.warns(StudyWarning, match=r"block-000001-\w+\.json is damaged"):
        table = study().run(folder)
    pd.testing.assert_frame_equal(table, finished[1], check_exact=True)
    assert computed == [("C1", 2)]


def test_blocks_that_are_gone_or_left_over(finished, folder, computed):
    block(folder, 0).unlink()
    block(folder, 5).rename(folder / "blocks" / ".block-000005.77.tmp")
    (folder / "blocks" / "notes.txt").write_text("mine")
    table = study().run(folder)
    pd.testing.assert_frame_equal(table, finished[1], check_exact=True)
    assert computed == [("C1", 0), ("C3", 4)]
    left = {path.name for path in (folder / "blocks").iterdir()}
    assert left == {"notes.txt"} | {block(folder, i).name for i in range(6)}


def test_exchanged_blocks_and_blocks_of_another_study(finished, folder, tmp_path):
    one, two = block(folder, 1), block(folder, 2)
    aside = one.rename(tmp_path / "aside")
    two.rename(one)
    aside.rename(two)
    study(random_state=4).run(tmp_path / "other")
    block(folder, 4).unlink()
    shutil.copy(block(tmp_path / "other", 4), folder / "blocks")
    with pytest.warns(StudyWarning, match="or not the block of this study") as caught:
        table = study().run(folder)
    assert len(caught) == 3
    pd.testing.assert_frame_equal(table, finished[1], check_exact=True)


def test_a_study_that_stops_goes_on(finished, tmp_path, monkeypatch, computed):
    write = study_module.Store.write

    def stop(self, number, table):
        if number == 3:
            raise KeyboardInterrupt
        write(self, number, table)

    with monkeypatch.context() as patch:
        patch.setattr(study_module.Store, "write", stop)
        with pytest.raises(KeyboardInterrupt):
            study().run(tmp_path / "study")
    assert len(list((tmp_path / "study" / "blocks").iterdir())) == 3
    del computed[:]
    table = study().run(tmp_path / "study")
    pd.testing.assert_frame_equal(table, finished[1], check_exact=True)
    assert len(computed) == 3


DIFFERENT = {
    "function": ({"function": other}, "function"),
    "seed": ({"random_state": 4}, 'entropy: "3" there, "4" here'),
    "cells": ({"conditions": {"condition": ["C1", "C2"]}}, r'cells\[1\].condition: "C3" there'),
    "replications": ({"n": 7}, "n_replications: 6 there, 7 here"),
    "simulation": ({"simulation": SHORT | {"remnant_order": 3}}, "simulation.remnant_order"),
    "validation": ({"n_validation_runs": 1}, "n_validation_runs"),
}


@pytest.mark.parametrize("name", DIFFERENT)
def test_the_folder_of_a_different_study(folder, computed, name):
    change, message = DIFFERENT[name]
    with pytest.raises(StudyFolderError, match=f"belongs to a different study.*{message}"):
        study(**change).run(folder)
    assert computed == []
    assert len(list((folder / "blocks").iterdir())) == 6


@pytest.mark.parametrize(("contents", "random_state"), [("{", 3), ("\xff", None)])
def test_a_damaged_description(folder, contents, random_state):
    (folder / "study.json").write_text(contents, encoding="latin-1")
    with pytest.raises(StudyFolderError, match=r"study\.json"):
        study(random_state=random_state).run(folder)


def test_folders_that_are_no_studies(tmp_path, computed):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(StudyFolderError, match=r"not belong to a study.*thesis\.tex"):
        study().run(tmp_path)
    with pytest.raises(StudyFolderError, match="is a file"):
        study().run(tmp_path / "thesis.tex")
    assert computed == []
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_drawn_seed_is_that_of_the_folder(tmp_path):
    first = study(random_state=None)
    table = first.run(tmp_path)
    again = study(random_state=None)
    assert again.entropy != first.entropy
    block(tmp_path, 2).unlink()
    pd.testing.assert_frame_equal(again.run(tmp_path), table, check_exact=True)
    assert again.entropy == first.entropy
    third = study(other, random_state=None)
    drawn = third.entropy
    with pytest.raises(StudyFolderError, match="function"):
        third.run(tmp_path)
    assert third.entropy == drawn
