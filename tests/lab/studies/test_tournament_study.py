"""A small tournament as a user meets it."""

import json

import joblib
import numpy as np
import pandas as pd
import pytest

from skhoid.lab.studies import TournamentCell, run_tournament, tournament_cells
from skhoid.lab.studies.tournament import groups_of, spread, watching

pytestmark = pytest.mark.slow  # compiles for many seconds

METHODS = ["rls", "rls_smooth", "arx"]
CELLS = tournament_cells("small", conditions=["C1", "C4"])
FEW = {"size": "small", "n_replications": 2, "n_validation": 1}


@pytest.fixture(scope="module")
def result():
    return run_tournament(METHODS, CELLS, **FEW)


def numbers(result):
    """What does not depend on the machine."""
    return result.table


def test_every_method_sees_the_same_runs(result):
    per_run = result.table.drop_duplicates(["cell", "replication", "method"])
    assert per_run.groupby(["cell", "replication"]).size().eq(3).all()
    one = run_tournament(["arx"], CELLS, **FEW)
    own = result.table[result.table["method"] == "arx"].reset_index(drop=True)
    pd.testing.assert_frame_equal(
        own.dropna(axis=1, how="all"), one.table.dropna(axis=1, how="all"), check_exact=True
    )


@pytest.mark.slow
def test_workers_and_folders_do_not_change_the_table(result, tmp_path):
    with joblib.parallel_config(backend="threading", n_jobs=2):
        kept = run_tournament(METHODS, CELLS, **FEW, out=tmp_path)
    pd.testing.assert_frame_equal(numbers(kept), numbers(result), check_exact=True)
    made = sorted(path.name for path in (tmp_path / "evaluation").iterdir())
    assert made == sorted(METHODS)
    block = next((tmp_path / "evaluation" / "rls" / "blocks").iterdir())
    block.unlink()
    again = run_tournament(METHODS, CELLS, **FEW, out=tmp_path)
    pd.testing.assert_frame_equal(numbers(again), numbers(result), check_exact=True)
    more = run_tournament([*METHODS, "rls_auto"], CELLS, **FEW, out=tmp_path)
    assert set(more.methods.index) == {*METHODS, "rls_auto"}


def test_a_folder_is_read_again(tmp_path):
    options = {"cells": CELLS[1:], **FEW, "out": tmp_path}
    first = run_tournament(["arx"], **options)
    pd.testing.assert_frame_equal(run_tournament(["arx"], **options).table, first.table)
    with pytest.raises(ValueError, match="belongs to a different study"):
        run_tournament(["arx"], **options, random_state=1)


def test_tuning_is_by_validation_with_equal_budgets(result):
    tuning = result.tuning
    for (_, _), part in tuning.groupby(["method", "group"]):
        assert part["chosen"].sum() == 1
        if len(part) > 1:
            assert part["vaf"].idxmax() == part["chosen"].idxmax()
    chosen = tuning[tuning["chosen"]].set_index(["method", "group"])["setting"]
    assert chosen["rls", "constant, P_n = 0.15"] == "inf"
    assert chosen["rls", "changing, P_n = 0.15"] != "inf"
    used = result.table.drop_duplicates(["method", "group"]).set_index(["method", "group"])
    assert (used["setting"] == chosen.reindex(used.index)).all()


def test_tuning_and_evaluation_have_other_seeds(tmp_path):
    run_tournament(["rls"], CELLS[1:], **FEW, out=tmp_path)
    found = {path: json.loads(path.read_text())["entropy"] for path in tmp_path.rglob("study.json")}
    of = {
        part: {entropy for path, entropy in found.items() if part in path.parts}
        for part in ("tuning", "evaluation")
    }
    assert len(of["tuning"]) == len(of["evaluation"]) == 1
    assert not of["tuning"] & of["evaluation"]


def test_data_sets_are_spread_over_a_group():
    cells = tournament_cells()
    assert len(groups_of(cells)) == 6
    some, n = spread(cells[:24], 8)
    assert (len(some), n) == (8, 1)
    assert (some[0], some[-1]) == (cells[0], cells[23])
    assert spread(cells[:3], 8)[1] == 3


def test_constant_runs_are_watched_as_changing_ones():
    settings = {CELLS[0].name: np.inf, CELLS[1].name: 5.12}
    assert watching(settings, CELLS) == {CELLS[0].name: 5.12, CELLS[1].name: 5.12}
    assert watching(settings, CELLS[:1]) == {CELLS[0].name: np.inf}


def test_physics(result):
    """Where nothing changes, a constant model is best; where something does, one that follows."""
    winners = result.winners("follow")["method"]
    assert winners[CELLS[0].name] in ("arx", "rls")  # with endless memory
    assert winners[CELLS[1].name] in ("rls", "rls_smooth")
    found = result.by_cell("all")["rmse"]
    changing = found[CELLS[1].name]
    assert changing["arx", "K_edot"] > 2 * changing["rls", "K_edot"]


def test_a_cell_that_cannot_be_simulated_is_rows_with_an_error():
    cells = [CELLS[0], TournamentCell("impossible", "C2", 0.3, 4, kind="constant")]
    with pytest.warns(UserWarning, match="data sets failed"):
        found = run_tournament(["arx"], cells, **FEW)
    failed = found.table[found.table["error"].notna()]
    assert set(failed["cell"]) == {"impossible"}
    assert (failed["method"] == "arx").all()
    assert "could not be simulated" in str(found)
    assert list(found.winners().index) == [CELLS[0].name]


def test_no_run_can_be_simulated():
    cells = [TournamentCell("impossible", "C2", 0.3, 4, kind="constant")]
    with (
        pytest.warns(UserWarning, match="data sets failed"),
        pytest.raises(ValueError, match=r"Every simulated run failed.*RemnantIntensityError"),
    ):
        run_tournament(["rls"], cells, **FEW)


@pytest.mark.slow
def test_a_searched_delay(result):
    found = run_tournament(["arx"], CELLS[:1], **FEW, delay="searched")
    own = result.table[(result.table["method"] == "arx") & (result.table["cell"] == CELLS[0].name)]
    assert not np.allclose(found.table["rmse_all"], own["rmse_all"])


@pytest.mark.slow
def test_small_with_every_method():
    found = run_tournament(size="small")
    assert (found.table["rmse_all"] <= 100).all()
    assert found.best("follow", causal=False) != "arx"


def test_errors():
    with pytest.raises(ValueError, match=r"Two cells have the name 'C1, P_n 0.15'"):
        run_tournament(["arx"], [CELLS[0], CELLS[0]])
    with pytest.raises(ValueError, match="The 'size' parameter of run_tournament must be"):
        run_tournament(size="huge")
    with pytest.raises(ValueError, match="The 'delay' parameter of run_tournament must be"):
        run_tournament(["arx"], delay="guessed")


@pytest.mark.slow
def test_an_oracle_is_shown_and_not_ranked():
    found = run_tournament(["lpv", "arx"], CELLS[1:], **FEW)
    assert found.ranking().index.tolist() == ["arx"]
    assert "lpv" in str(found)
    rmse = found.summary()["rmse"]
    assert rmse["lpv", "K_edot"] < 0.3 * rmse["arx", "K_edot"]
    with pytest.raises(ValueError, match="could be ranked"):
        found.ranking(causal=True)
