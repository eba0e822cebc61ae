"""The command ``skhoid compare``."""

import re
from pathlib import Path

import joblib
import numpy as np
import pandas as pd
import pytest

from skhoid import ARXRegressor, compare, make_tracking_runs, select_runs, write_runs
from skhoid.diagnosis import Comparison
from skhoid.lab.cli import main


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A model that knows only e, and runs of all channels."""
    folder = tmp_path_factory.mktemp("compare")
    X, y = make_tracking_runs(
        "C1",
        n_runs=3,
        duration=40.96,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        random_state=1,
    )
    model = ARXRegressor(nk=15).fit(*select_runs(X[["e"]], y, runs=[0]))
    joblib.dump(model, folder / "model.joblib")
    write_runs(*select_runs(X, y, runs=[1, 2]), folder / "new.csv")
    write_runs(*select_runs(X, y, runs=[0]), folder / "old.csv")
    joblib.dump({"no": "model"}, folder / "other.joblib")
    (folder / "text.joblib").write_text("nothing")
    return folder, model, X, y


def words(files, *more, model="model.joblib"):
    folder = files[0]
    return [
        *("compare", str(folder / model), str(folder / "new.csv")),
        *("--time", "time", "--run", "run", *more),
    ]


def test_figures_are_those_of_compare(files, run_json):
    _, model, X, y = files
    found = run_json(*words(files, "--run-in", "2", "--input", "e"))
    held_out = select_runs(X, y, runs=[1, 2])
    twin = compare(model, held_out[0][["e"]], held_out[1], run_in=2)
    np.testing.assert_allclose(found["vaf"], twin.vaf, rtol=1e-4)
    assert found["ceiling_note"] == twin.ceiling.note.text
    assert found["domain"] == "machine"  # e alone is no loop
    assert found["leak"] is None


@pytest.mark.slow
def test_channels_that_the_model_does_not_have_are_compared_with(files, run_json, tmp_path):
    folder = files[0]
    more = ["--x", "x", "--target", "f_t", "--estimation", str(folder / "old.csv")]
    found = run_json(*words(files, *more, "--tables", "out"))
    assert found["domain"] == "human"
    assert found["ceiling_route"] == "repeats"
    assert found["leak"]["leaks"] is None  # no disturbance: it cannot tell, and says so
    assert found["overfit"] in (True, False)
    assert Path("out/tests.tsv").exists()


def test_text_names_what_each_vaf_is(files, capsys):
    assert main(words(files, "--domain", "machine")) == 0
    printed = capsys.readouterr().out
    assert "VAF, free run" in printed
    assert "VAF compares with zero, not with the mean" in printed


@pytest.mark.slow
def test_picture_and_page_are_written(files, capsys):
    assert main(words(files, "--out", "page.png")) == 0
    assert Path("page.png").stat().st_size > 0
    assert main(words(files, "--out", "page.html")) == 0
    assert Path("page.html").read_text().startswith("<!DOCTYPE html>")
    assert "page.html" in capsys.readouterr().out
    assert main(words(files, "--out", "page.html")) == 2


@pytest.mark.parametrize(
    ("model", "more", "said"),
    [
        ("nothing.joblib", [], "is no file. First name what `skhoid identify --save FILE`"),
        ("other.joblib", [], "predicts nothing"),
        ("text.joblib", [], "holds no model"),
        ("model.joblib", ["--input", "e", "x"], "fitted on the columns e"),
        ("model.joblib", ["--x", "e"], "channel 'e' has two roles, 'e' and 'x'"),
        ("model.joblib", ["--x", "x", "--target", "x"], "'x' has two roles, 'x' and 'f_t'"),
        ("model.joblib", ["--out", "page.txt"], "no image file"),
    ],
)
def test_what_is_wrong_is_said(files, capsys, model, more, said):
    assert main(words(files, *more, model=model)) == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_without_recordings_there_is_nothing_to_compare(files, capsys):
    assert main(["compare", str(files[0] / "model.joblib")]) == 2
    assert "recordings" in capsys.readouterr().err


KEPT = ["--no-pictures", "--save"]
PYTHON = re.compile(r"\w\(|\bNaN\b|\bFalse\b|Regressor|CV\b")


def test_a_linear_model_that_was_kept_is_compared(files, run_json, capsys):
    folder = files[0]
    old, new = str(folder / "old.csv"), str(folder / "new.csv")
    given = ["identify", new, "--nk", "15", "--na", "2", *KEPT]
    assert run_json(*given, "one.joblib")["model"] == "one.joblib"
    assert main([*given, "one.joblib"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main(["identify", new, "--nk", "9", "--na", "2", *KEPT, "two.joblib"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "take it only from people you trust" in printed
    assert f"skhoid compare two.joblib {new}" in printed
    assert Path("two.joblib").stat().st_size < 8 * len(files[2]) / 3  # no channel of a run is in it
    alone = run_json("compare", "one.joblib", old)
    found = run_json("compare", "two.joblib", "one.joblib", old)["models"]
    assert [one["model"] for one in found] == ["one.joblib", "two.joblib"]  # the better one first
    assert found[0]["vaf"] == alone["vaf"] > found[1]["vaf"]
    assert main(["compare", "one.joblib", "two.joblib", old]) == 0
    printed = capsys.readouterr().out
    assert "2 models against measured u" in printed
    assert not PYTHON.search(printed)


@pytest.mark.slow
def test_a_model_with_effects_that_was_kept_is_compared(files, run_json, capsys):
    folder = files[0]
    old, new = str(folder / "old.csv"), str(folder / "new.csv")
    assert main(["diagnose", new, "--effects", "bias", "--exhaustive", *KEPT, "model.joblib"]) == 0
    assert f"skhoid compare model.joblib {new}" in capsys.readouterr().out
    assert Path("model.joblib").stat().st_size < 16 * len(files[2]) / 3
    X, y = select_runs(*files[2:], runs=[0])
    model = joblib.load("model.joblib")
    twin = compare(model, X[list(model.feature_names_in_)], y)
    np.testing.assert_allclose(run_json("compare", "model.joblib", old)["vaf"], twin.vaf, rtol=1e-4)


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_a_model_is_kept_in_a_file_that_compare_knows(files, capsys, command):
    assert main([command, str(files[0] / "new.csv"), "--save", "model.csv"]) == 2
    assert "such as model.joblib; got model.csv" in capsys.readouterr().err


def test_runs_that_a_kept_model_was_fitted_on_are_marked(
    files, run_json, capsys, tmp_path, monkeypatch
):
    shown, document = [], Comparison.document
    monkeypatch.setattr(Comparison, "document", lambda c: shown.append(c) or document(c))
    folder, _, X, y = files
    write_runs(X, y, tmp_path / "all.csv")
    write_runs(X.iloc[2048:] * 1.1, y.iloc[2048:] * 1.1, tmp_path / "same_names.csv")
    fixed = ["--nk", "15", "--na", "2", *KEPT]
    marks = {}
    run_json("identify", str(tmp_path / "all.csv"), *fixed, "two.joblib")
    for name in ("all.csv", "same_names.csv"):
        run_json("compare", "two.joblib", str(tmp_path / name), "--tables", name[:4])
        runs = pd.read_csv(Path(name[:4]) / "by_run.tsv", sep="\t")
        marks[name] = runs["data"].tolist()
    assert marks["all.csv"] == ["fitted", "fitted", "validation"]
    assert marks["same_names.csv"] == ["validation"] * 2  # other recordings
    run_json("identify", str(folder / "old.csv"), *fixed, "half.joblib")
    assert main(["compare", "half.joblib", str(folder / "old.csv"), "--out", "half.png"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "partly fitted" in printed
    assert "fitted on 1 of 1 run here" in printed
    assert "fitted runs" in {note.kind for note in shown[-1].notes}
    assert main(["compare", str(folder / "model.joblib"), str(folder / "old.csv")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "not known" in printed
    assert "does not say on which recordings it was fitted" in printed
