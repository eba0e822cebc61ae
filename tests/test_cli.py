"""The command line, from words to files."""

import json
import warnings

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    ARXRegressor,
    load_human_tracking,
    make_tracking_runs,
    read_runs,
    vaf_score,
)
from skhoid.cli import main


@pytest.fixture
def run_files(tmp_path):
    """Three CSV files of real tracking runs, with units in their headers."""
    X, y = load_human_tracking(["phase-size 2b", "phase-size 2c", "phase-size 2d"])
    paths = []
    for label, part in X.groupby(level="run"):
        table = part.droplevel("run").reset_index()
        table["cursor [px]"] = y.loc[[label]].to_numpy()
        path = tmp_path / f"{label.replace(' ', '-')}.csv"
        table.rename(columns={"time": "t [s]", "f_t": "target [px]"}).to_csv(path, index=False)
        paths.append(str(path))
    return paths


def run_json(capsys, *words):
    assert main(["identify", *words, "--json", "--no-pictures"]) == 0
    return json.loads(capsys.readouterr().out)


def test_main_job_finds_the_delay_of_the_bundled_recording(capsys, tmp_path):
    assert main(["identify", "--out", str(tmp_path / "pictures")]) == 0
    printed = capsys.readouterr().out
    for expected in ("difficulty 80", "60 Hz", "lowest one-step error", "VAF held out, %", "px"):
        assert expected in printed
    names = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert names == {"simulation.png", "delay.png", "delay-vaf.png", "orders.png"}


def test_json_holds_what_the_api_gives(capsys):
    found = run_json(capsys)
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
    assert expected >= 93.5
    assert found["models"][0]["vaf_validation"] < with_delay["vaf_validation"]
    values = [p["value"] for p in with_delay["parameters"]]
    np.testing.assert_allclose(values, model.coef_, rtol=1e-9)
    assert with_delay["verdict"] == "no overfit"


def test_own_files_are_validated_on_a_held_out_run(capsys, run_files):
    words = [*run_files, "--input", "target", "--output", "cursor", "--time", "t"]
    found = run_json(capsys, *words, "--run-in", "2", "--decimate", "2")
    assert found["n_runs"] == 3
    assert found["validation"] == "run 'phase-size-2d'"
    assert found["units"] == {"target": "px", "cursor": "px"}
    assert found["model_dt_s"] == pytest.approx(2 / 60)
    assert found["models"][-1]["vaf_validation"] > 80
    found = run_json(capsys, *words, "--validate", "phase-size-2b", "--keep-means")
    assert found["validation"] == "run 'phase-size-2b'"
    assert not found["centered"]
    assert all(p["name"] != "intercept" for p in found["models"][-1]["parameters"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing-here.csv", "--time", "t"], "nothing-here.csv"),
        (["run.csv"], "--time NAME, or --dt SECONDS"),
        (["run.csv", "--dt", "0.01", "--unit", "deg"], "--unit takes NAME=UNIT"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(capsys, words, message):
    assert main(["identify", *words]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("skhoid: error: ")
    assert message in printed.err


def test_errors_of_the_data_are_shown(capsys, run_files):
    words = ["identify", *run_files, "--output", "cursor", "--time", "t", "--input"]
    assert main([*words, "target", "--validate", "monday"]) == 2
    assert "There is no run 'monday' to validate on" in capsys.readouterr().err
    assert main([*words, "tarket"]) == 2
    assert "target" in capsys.readouterr().err  # the close match is named


def test_debug_shows_the_traceback(run_files):
    words = ["--input", "target", "--output", "cursor", "--time", "t", "--validate", "monday"]
    with pytest.raises(ValueError, match="monday"):
        main(["identify", *run_files, *words, "--debug"])


def test_help_has_examples(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["identify", "--help"])
    assert stop.value.code == 0
    assert "skhoid identify run*.csv --input e --output u --time t" in capsys.readouterr().out


def test_asked_inputs_are_the_inputs(capsys, tmp_path):
    """The default, the column named e, must not win over what was asked for."""
    X, y = load_human_tracking("phase-size 2b", channels=("f_t", "e"))
    table = X.assign(cursor=y).droplevel("run").reset_index()
    table["e"] = np.roll(table["e"], 30)  # e = f_t - x itself would be linearly dependent
    table.to_csv(tmp_path / "run.csv", index=False)
    words = [str(tmp_path / "run.csv"), "--output", "cursor", "--time", "time"]
    found = run_json(capsys, *words, "--input", "f_t", "e")
    assert found["inputs"] == ["f_t", "e"]


def test_bad_factor_is_refused(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["identify", "--decimate", "0"])
    assert stop.value.code == 2
    assert "must be a whole number, at least 1; got '0'" in capsys.readouterr().err


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


@pytest.mark.parametrize("extension", ["csv", "parquet", "mat"])
def test_simulated_runs_can_be_identified(capsys, tmp_path, extension):
    path = str(tmp_path / f"runs.{extension}")
    words = ["--condition", "c1", "--runs", "2", "--remnant", "0.05", "--remnant-order", "nm"]
    assert main(["simulate", *words, "--seed", "3", "--out", path]) == 0
    printed = capsys.readouterr().out
    assert "2 runs of C1, 16384 rows at 100 Hz" in printed
    assert "wanted 0.05" in printed
    next_words = printed.split("next: skhoid ")[1].split()
    assert main([*next_words, "--json", "--no-pictures"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["n_rows"] == 16384
    assert abs(found["delay"]["one_step"]["nk"] - 29) <= 1
    X, _ = make_tracking_runs(
        "C1", n_runs=2, remnant_intensity=0.05, remnant_order="nm", random_state=3
    )
    again, _ = read_runs(
        path, inputs="e", output="u", time="time", run=None if extension == "mat" else "run"
    )
    np.testing.assert_array_equal(again["e"], X["e"])


def test_simulate_draws(capsys, tmp_path):
    picture = tmp_path / "runs.png"
    out = str(tmp_path / "runs.csv")
    assert main(["simulate", "--runs", "1", "--out", out, "--picture", str(picture)]) == 0
    assert f"picture: {picture}" in capsys.readouterr().out
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--condition", "C9"], "known are C1, C2, C3, C4, C5, C6"),
        (["--remnant", "15"], "15 percent is 0.15"),
        (["--condition", "C2", "--remnant", "0.9"], "No gain gives P_n = 0.9"),
        (["--rate", "10"], "too slow for the neuromuscular mode"),
        (["--remnant", "0.1", "--remnant-order", "5"], "order is 1, 2, 3, 4 or 'nm'"),
        (["--channels", "q"], "channels is a list of some of"),
    ],
)
def test_simulate_says_what_is_wrong(capsys, tmp_path, words, message):
    out = tmp_path / "runs.csv"
    assert main(["simulate", *words, "--out", str(out)]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_simulate_keeps_files(capsys, tmp_path):
    out = tmp_path / "runs.csv"
    out.write_text("precious")
    assert main(["simulate", "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert out.read_text() == "precious"
