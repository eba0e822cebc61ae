"""A small tournament as a user meets it: its table, what it says, shows and keeps, and advice."""

import joblib
import pandas as pd
import pytest

from skhoid import CompensatoryTask, HumanOperator, Ramp, Remnant
from skhoid.lab.studies import (
    TournamentCell,
    recommend_method,
    run_tournament,
    tournament_cells,
)

pytestmark = pytest.mark.slow  # compiles, and follows many runs

METHODS = ["rls", "rls_smooth", "arx"]
CELLS = tournament_cells("small", conditions=["C1", "C4"])
FEW = {"size": "small", "n_replications": 2, "n_validation": 1, "progress": False}
C1, C4 = (cell.name for cell in CELLS)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The result, and its folder."""
    folder = tmp_path_factory.mktemp("tournament")
    return run_tournament(METHODS, CELLS, **FEW, out=folder), folder


@pytest.fixture(scope="module")
def result(kept):
    return kept[0]


def test_every_method_sees_the_same_runs(result):
    per_run = result.table.drop_duplicates(["cell", "replication", "method"])
    assert per_run.groupby(["cell", "replication"]).size().eq(3).all()
    one = run_tournament(["arx"], CELLS, **FEW)
    own = result.table[result.table["method"] == "arx"].reset_index(drop=True)
    pd.testing.assert_frame_equal(
        own.dropna(axis=1, how="all"), one.table.dropna(axis=1, how="all"), check_exact=True
    )


def test_a_folder_is_read_again_and_workers_change_nothing(kept):
    result, folder = kept
    made = sorted(path.name for path in (folder / "evaluation").iterdir())
    assert made == sorted(METHODS)
    next((folder / "evaluation" / "rls" / "blocks").iterdir()).unlink()
    with joblib.parallel_config(backend="threading", n_jobs=2):
        again = run_tournament(METHODS, CELLS, **FEW, out=folder)
    pd.testing.assert_frame_equal(again.table, result.table, check_exact=True)
    with pytest.raises(ValueError, match="belongs to a different study"):
        run_tournament(["arx"], CELLS, **FEW, out=folder, random_state=1)


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


def test_a_cell_that_cannot_be_simulated_is_rows_with_an_error():
    cells = [CELLS[0], TournamentCell("impossible", "C2", 0.3, 4, kind="constant")]
    with pytest.warns(UserWarning, match="data sets failed"):
        found = run_tournament(["arx"], cells, **FEW)
    failed = found.table[found.table["error"].notna()]
    assert set(failed["cell"]) == {"impossible"}
    assert (failed["method"] == "arx").all()
    assert "could not be simulated" in str(found)
    assert list(found.winners().index) == [CELLS[0].name]


def test_tournaments_that_make_no_sense():
    with pytest.raises(ValueError, match=r"Two cells have the name 'C1, P_n 0.15'"):
        run_tournament(["arx"], [CELLS[0], CELLS[0]])
    with pytest.raises(ValueError, match="The 'size' parameter of run_tournament must be"):
        run_tournament(size="huge")
    with pytest.raises(ValueError, match="The 'delay' parameter of run_tournament must be"):
        run_tournament(["arx"], delay="guessed")


def test_an_oracle_is_shown_and_not_ranked():
    found = run_tournament(["lpv", "arx"], CELLS[1:], **FEW)
    assert found.ranking().index.tolist() == ["arx"]
    assert "lpv" in str(found)
    rmse = found.by_method()["rmse"]
    assert rmse["lpv", "K_edot"] < 0.3 * rmse["arx", "K_edot"]
    with pytest.raises(ValueError, match="could be ranked"):
        found.ranking(causal=True)


def test_words(result):
    text = str(result)
    assert text.startswith("3 methods on 2 conditions, 4 simulated runs")
    assert "- Causal, to follow K_edot over time: rls" in text
    assert "- Offline, to predict the output: rls_smooth" in text
    assert max(map(len, text.splitlines())) <= 88
    html = result._repr_html_()
    assert "<table>" in html
    assert "Causal methods: K_edot over time" in html
    assert repr(result) == text


def test_summary_is_of_the_table(result):
    table = result.table
    rows = table[(table["method"] == "rls") & (table["parameter"] == "K_edot")]
    rows = rows[rows["cell"] == "C4, P_n 0.15"]
    found = result.by_cell().loc[("C4, P_n 0.15", "rls", "K_edot")]
    assert found["bias"] == pytest.approx(rows["bias_all"].mean())
    assert found["rmse"] == pytest.approx(rows["rmse_all"].median())
    assert found["sd"] ** 2 + found["bias"] ** 2 == pytest.approx((rows["rmse_all"] ** 2).mean())
    summary = result.by_method()
    of_cells = result.by_cell().xs(("rls", "K_edot"), level=("method", "parameter"))
    assert summary.loc[("rls", "K_edot"), "bias"] == pytest.approx(of_cells["bias"].abs().median())


def test_rankings(result):
    assert result.best("follow", causal=False) == "rls_smooth"
    ranking = result.ranking("follow")
    assert ranking["won"].sum() == pytest.approx(100.0)
    assert ranking["loss"].is_monotonic_increasing
    assert list(result.ranking(causal=True).index.sort_values()) == ["rls"]
    with pytest.raises(ValueError, match="No data set answers the question 'delay'"):
        result.ranking("delay")


def test_saved(result, tmp_path):
    files = {path.name: path for path in result.save(tmp_path)}
    assert {"winners.png", "bias.png", "settling.png", "summary.csv"} <= set(files)
    assert len(pd.read_csv(files["table.csv.gz"])) == len(result.table)


def test_advice():
    advice = recommend_method("C4", 0.15, methods=METHODS, n_replications=2, n_validation=1)
    assert advice.method in ("rls", "rls_smooth")
    assert "arx" not in advice.close
    assert advice.ranking["difference"].iloc[0] == 0
    assert (advice.ranking["loss"].diff().dropna() >= 0).all()
    text = str(advice)
    assert text.startswith(f"To follow K_edot over time: {advice.method} (recursive least squares")
    assert repr(advice.estimator) in text
    assert advice.estimator.nk == 29
    assert advice.method in advice._repr_html_()


def test_a_task_of_ones_own():
    task = CompensatoryTask(
        operator=HumanOperator(T_L=Ramp(0.4, 0.9, 15, 22)),
        duration=40.96,
        sampling_rate=50.0,
        run_in=20.0,
        remnant=Remnant(gain=0.01),
    )
    few = {"methods": ["rls", "arx"], "n_replications": 2, "n_validation": 1}
    advice = recommend_method(task, question="detect", **few)
    assert advice.result.cells["group"].tolist() == [
        "changing, own remnant",
        "constant, own remnant",
    ]
    assert advice.ranking["n"].eq(2).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "Give remnant_intensity"),
        ({"remnant_intensity": [0.1, 0.0]}, "above 0"),
        ({"remnant_intensity": 0.1, "question": "detect", "task": "C1"}, "Nothing changes"),
        ({"remnant_intensity": 0.1, "question": "why"}, "The 'question' parameter"),
        (
            {"remnant_intensity": 0.1, "question": "delay", "methods": ["rls"]},
            "estimates the delay",
        ),
        ({"remnant_intensity": 0.1, "methods": ["rsl"]}, "Unknown method 'rsl'"),
        (
            {"remnant_intensity": 0.1, "parameter": "K_x", "methods": ["arx"]},
            "parameter must be one",
        ),
    ],
)
def test_advice_that_cannot_be_given(options, message):
    options = {"task": "C4"} | options
    with pytest.raises(ValueError, match=message):
        recommend_method(options.pop("task"), options.pop("remnant_intensity", None), **options)
