"""The command ``skhoid identify``."""

import json
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import cont2discrete, lfilter
from support.person_in_loop import pursued

from skhoid import ARXRegressor, RecursiveARX, load_human_tracking, make_tracking_runs, vaf_score
from skhoid.lab.cli import main


def identify(run_json, *words):
    return run_json("identify", *words, "--no-pictures")


def test_main_job_finds_the_delay_of_the_bundled_recording(capsys, tmp_path):
    assert main(["identify", "--out", str(tmp_path / "pictures")]) == 0
    printed = capsys.readouterr().out
    for expected in (
        "difficulty 80",
        "60 Hz",
        "lowest one-step error",
        "held out",
        "px",
        "What to do next",
    ):
        assert expected in printed
    names = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert names == {"simulation.png", "delay.png", "delay-vaf.png", "orders.png"}


def test_json_holds_what_the_api_gives(run_json):
    found = identify(run_json)
    X, y = load_human_tracking("difficulty 80")
    half = (len(X) + 1) // 2
    nk = found["delay"]["one_step"]["nk"]
    assert 0.10 <= found["delay"]["one_step"]["seconds"] <= 0.134
    model = ARXRegressor(nk=nk, fit_intercept=True).fit(X[:half], y[:half])
    with_delay = found["models"][1]
    assert with_delay["nk"] == [nk]
    free_run = model.predict(X)
    expected = vaf_score(y[half:], free_run[half:], centered=True)
    assert with_delay["vaf_validation"] == pytest.approx(expected, abs=1e-9)
    assert expected >= 93.0
    assert found["models"][0]["vaf_validation"] < with_delay["vaf_validation"]
    values = [p["value"] for p in with_delay["parameters"]]
    np.testing.assert_allclose(values, model.coef_, rtol=1e-9)
    assert with_delay["verdict"] == "no overfit"


def test_own_files_are_validated_on_a_held_out_run(run_json, run_files):
    words = [*run_files, "--input", "target", "--output", "cursor", "--time", "t"]
    found = identify(run_json, *words, "--run-in", "2", "--decimate", "2")
    assert found["n_runs"] == 3
    assert found["validation"] == "run 'phase-size-2d'"
    assert found["units"] == {"target": "px", "cursor": "px"}
    assert found["models"][-1]["vaf_validation"] > 80
    found = identify(run_json, *words, "--validate", "phase-size-2b", "--keep-means")
    assert found["validation"] == "run 'phase-size-2b'"
    assert not found["centered"]
    assert all(p["name"] != "intercept" for p in found["models"][-1]["parameters"])


def test_asked_inputs_are_the_inputs(run_json, tmp_path):
    """The default, the column named e, must not win over what was asked for."""
    X, y = load_human_tracking("phase-size 2b", channels=("f_t", "e"))
    table = X.assign(cursor=y).droplevel("run").reset_index()
    table["e"] = np.roll(table["e"], 30)  # e = f_t - x itself would be linearly dependent
    table.to_csv(tmp_path / "run.csv", index=False)
    words = [str(tmp_path / "run.csv"), "--output", "cursor", "--time", "time"]
    found = identify(run_json, *words, "--input", "f_t", "e")
    assert found["inputs"] == ["f_t", "e"]


def test_notes_are_shown_once_and_gaps_counted(capsys, run_files, tmp_path):
    table = pd.read_csv(run_files[0])
    table = table.drop(index=range(2000, 2100))
    table.loc[500:505, "cursor [px]"] = np.nan
    table.to_csv(tmp_path / "holed.csv", index=False)
    words = [str(tmp_path / "holed.csv"), "--input", "target", "--output", "cursor", "--time", "t"]
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["identify", *words, "--no-pictures", "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["n_gaps"] == 1
    notes = printed.err.splitlines()
    assert any("6 rows of 'cursor' are NaN" in note for note in notes)
    assert len(notes) == len(set(notes))


# Given orders, instrumental variables, models that follow changes


def test_instrumental_variables_need_and_use_the_target(capsys, run_json, tmp_path):
    X, y = make_tracking_runs(
        "C1", 2, remnant_intensity=0.2, random_state=0, channels=["e", "f_t"], sampling_rate=50
    )
    X.rename(columns={"f_t": "multisine"}).assign(u=y).to_csv(tmp_path / "runs.csv")
    words = ["runs.csv", "--time", "time", "--run", "run", "--keep-means", "--nk", "15"]
    words += ["--na", "2", "--method", "iv"]
    (model,) = identify(run_json, *words, "--instruments", "multisine")["models"]
    fit = X[X.index.get_level_values("run") == 0], y[y.index.get_level_values("run") == 0]
    expected = ARXRegressor(nk=15, inputs=["e"], method="iv", instruments=["f_t"]).fit(*fit)
    np.testing.assert_allclose([p["value"] for p in model["parameters"]], expected.coef_)
    assert main(["identify", *words]) == 2
    assert "--method iv takes 'f_t' as its instrument" in capsys.readouterr().err
    (open_loop,) = identify(run_json, *words, "--instruments", "e")["models"]
    expected = ARXRegressor(nk=15, inputs=["e"], method="iv", instruments=["e"]).fit(*fit)
    np.testing.assert_allclose([p["value"] for p in open_loop["parameters"]], expected.coef_)


def test_a_model_can_follow_changes(capsys, run_json):
    words = ["identify", "--na", "2", "--nk", "7", "--out", "out", "--tables", "tables"]
    assert main([*words, "--memory-time", "10"]) == 0
    assert "following changes" in capsys.readouterr().out
    assert {path.name for path in Path("out").iterdir()} == {
        "parameters.png",
        "simulation.png",
    }
    X, y = load_human_tracking("difficulty 80")
    half = (len(X) + 1) // 2
    expected = RecursiveARX(nk=7, fit_intercept=True, memory_time=10).fit(X[:half], y[:half])
    path = pd.read_csv("tables/parameter_path.tsv", sep="\t")
    np.testing.assert_allclose(path.drop(columns="time"), expected.coef_path_)
    np.testing.assert_allclose(path["time"], expected.time_path_)


def test_every_table_is_written(run_json):
    found = identify(run_json, "--tables", "new/tables")
    names = ["models", "parameters", "predictions", "delays", "orders"]
    assert found["tables"] == [f"new/tables/{name}.tsv" for name in names]
    tables = {name: pd.read_csv(f"new/tables/{name}.tsv", sep="\t") for name in names}
    delays = tables["delays"]
    best = {c: delays["nk"][delays[f"{c}_loss"].idxmin()] for c in ("one_step", "vaf")}
    assert best == {c: one["nk"] for c, one in found["delay"].items()}
    assert tables["models"]["vaf_validation"].tolist() == [
        pytest.approx(m["vaf_validation"]) for m in found["models"]
    ]
    assert len(tables["orders"]) == 16
    last = tables["parameters"].groupby("model")["value"].apply(list)["with delay and orders"]
    np.testing.assert_allclose(last, [p["value"] for p in found["models"][-1]["parameters"]])
    held_out = tables["predictions"].query("held_out")
    assert vaf_score(
        held_out["measured"], held_out["with_delay_and_orders"], centered=True
    ) == pytest.approx(found["models"][-1]["vaf_validation"])


# Lost control, leaks


@pytest.fixture
def lost_file(tmp_path):
    X, y = make_tracking_runs(
        n_runs=3,
        channels=["e", "x", "f_t"],
        duration=30.0,
        sampling_rate=40,
        remnant_intensity=0.05,
        random_state=3,
    )
    run, time = (X.index.get_level_values(level) for level in ("run", "time"))
    rows = (run == 1) & (time >= 10) & (time < 22)
    X, y = X.copy(), y.copy()
    X.loc[rows, "e"] = 15 * np.cos(1.5 * (time[rows] - 10))
    y[rows] = 0.35 * np.sign(X.loc[rows, "e"])
    X["x"] = X["f_t"] - X["e"]
    path = tmp_path / "lost.csv"
    X.assign(u=y).reset_index().to_csv(path, index=False)
    return [str(path), "--time", "time", "--run", "run"]


def test_lost_control_is_left_out_unless_it_is_to_be_kept(capsys, run_json, lost_file, tmp_path):
    words = ["--nk", "11", "--na", "2", "--no-pictures"]
    found = identify(run_json, *lost_file, *words)
    assert [row["run"] for row in found["left_out"]] == ["1"]
    kept = identify(run_json, *lost_file, *words, "--lost-control", "keep")
    assert kept["left_out"] == []
    assert found["models"][0]["vaf_validation"] > kept["models"][0]["vaf_validation"]
    assert main(["identify", *lost_file, *words, "--tables", str(tmp_path / "tables")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Run 1 from 9" in printed
    assert "On the command line: --lost-control." in printed
    table = pd.read_csv(tmp_path / "tables" / "left_out.tsv", sep="\t")
    assert table.columns.tolist() == ["run", "from", "to", "times", "reason"]


def test_a_model_that_rebuilds_the_output_is_refused(capsys, run_json, tmp_path):
    X, y, _ = pursued("1/(s(s+1))", 3, feedforward=0.6, early=0.1, n_runs=3)
    path = tmp_path / "pursuit.csv"
    X.rename(columns={"x": "cursor", "f_t": "wanted"}).assign(u=y).reset_index().to_csv(
        path, index=False
    )
    words = [str(path), "--time", "time", "--run", "run", "--input", "e", "wanted", "--nk", "6"]
    words += ["--na", "2", "--nb", "3", "--target", "wanted", "--no-pictures"]
    (model,) = identify(run_json, *words)["models"]
    assert model["leaks"] is True
    assert model["verdict"] == "rebuilds the output from the controlled element's response"
    assert main(["identify", *words]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "The model 'as given' is no answer" in printed
    assert "within 0.1 s" in printed
    assert "Give a least delay that is longer than 0.1 s, or other inputs" in printed


def test_channels_of_the_leak_test_are_no_inputs(run_json, lost_file):
    words = ["--nk", "11", "--na", "2", "--no-pictures", "--x", "x", "--target", "f_t"]
    found = identify(run_json, *lost_file, *words)
    assert found["inputs"] == ["e"]
    assert found["models"][0]["leak_reason"].startswith("Leaks cannot be tested")
    alone = identify(run_json, *lost_file, *words[:-4], "--input", "e")
    assert alone["models"][0]["leak_reason"] is None
    (model,) = identify(run_json, *lost_file, *words, "--method", "iv")["models"]
    assert model["nk"] == [11]


def test_noise_on_the_output_of_an_element_does_not_move_its_delay(run_json, tmp_path):
    """The one-step error is two samples late with 10 % of noise."""
    rng = np.random.default_rng(3)
    u = lfilter([0.3], [1, -0.7], rng.standard_normal(2000))
    b, a, _ = cont2discrete(([100.0], [1.0, 10.0, 100.0]), 0.02)
    y = lfilter(np.r_[np.zeros(12), b.ravel()], a, u)
    y += 0.1 * y.std() * rng.standard_normal(2000)
    frame = pd.DataFrame({"time": 0.02 * np.arange(2000), "u": u, "y": y})
    frame.to_csv(tmp_path / "plant.csv", index=False)
    words = ["plant.csv", "--input", "u", "--output", "y", "--domain", "machine", "--na", "2"]
    found = identify(run_json, *words)
    assert found["delay"]["impulse"]["nk"] == 13
    assert found["models"][-1]["nk"] == [13]
