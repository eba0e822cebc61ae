"""The commands ``demo``, ``diagnose`` and ``report``."""

import importlib.util
import json
import os
import re
import sys
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

import skhoid
from skhoid import make_tracking_runs, write_runs
from skhoid.effects import DeadZone, catalogue, effect
from skhoid.lab.cli import main
from skhoid.testing import check_effect

FEW = ["--effects", "bias", "drift"]
IN_TEXT = "--no-pictures"


@pytest.fixture
def reports(monkeypatch):
    """What reports are made of, in place of their pages."""
    made = []

    class Page:
        comparison = None

        def save(self, path):
            path.parent.mkdir(parents=True, exist_ok=True)
            return path.write_text("<html>")

    def report(model, X, y, **options):
        made.append({"model": model, "rows": len(X), **options})
        return Page()

    monkeypatch.setattr("skhoid.report", report)
    return made


# Demo.


@pytest.mark.parametrize("name", catalogue().index)
def test_every_effect_of_the_catalogue_can_be_chosen(capsys, monkeypatch, name):
    """It is hidden in a person, who does something else then; or one line says why it cannot be."""
    simulated = []

    def few(condition, n_runs, **options):
        return make_tracking_runs(condition, 1, **{**options, "duration": 20.48})

    def show_search(options, estimator, X, y, source, truth):
        simulated.append((y, truth))
        raise KeyboardInterrupt

    monkeypatch.setattr(skhoid, "make_tracking_runs", few, raising=False)
    monkeypatch.setattr("skhoid.lab.cli.diagnose.show_search", show_search)
    code = main(["demo", "--effect", name])
    if code == 2:
        assert f"person cannot have {name}: " in capsys.readouterr().err
        kind = effect(name)
        assert "human" not in kind.domains or kind.noise or not kind.hidden
        return
    assert code == 130
    assert main(["demo", "--effect", "none"]) == 130
    (y, truth), (without, _) = simulated
    assert any(key.startswith(f"{name}__") for key in truth)
    assert (y != without).mean() > 0.1


@pytest.mark.slow
def test_demo_finds_what_it_hides_and_says_the_truth(capsys, run_json, reports, tmp_path):
    words = ["demo", "--runs", "2", "--effect", "bias", *FEW]
    found = run_json(*words, "--no-pictures", "--no-report")
    assert found["hidden"] == found["best_effects"] == ["bias"]
    vaf = [step["vaf"] for step in found["error_path"]]
    assert vaf[1] - vaf[0] > 5
    assert vaf[1] == pytest.approx(found["truth_vaf"], abs=1.0)
    assert main([*words, "--out", "here", "--no-pictures"]) == 0
    printed = capsys.readouterr().out
    for expected in ("Verdict: ", "The truth: hidden bias", "here/report.html"):
        assert expected in printed
    assert re.search(r"bias: level +0\.05 +0\.0", printed)
    assert "What to do next" in printed.split("\n\n")[-1]
    assert max(map(len, printed.splitlines())) <= 80
    assert reports[0]["made_with"]["seed"] == "0"
    assert reports[0]["model"].error_path_["vaf"].tolist() == pytest.approx(vaf)  # the same seed


@pytest.mark.slow
def test_demo_with_nothing_hidden_says_so(run_json):
    words = ["--runs", "2", "--effect", "none", "--effects", "bias", "saturation"]
    found = run_json("demo", *words, "--no-pictures", "--no-report")
    assert (found["verdict"], found["best_effects"]) == ("nothing is missing", [])


# Diagnose.


@pytest.fixture(scope="module")
def everything(biased_runs, tmp_path_factory):
    """What a search of files leaves: its output as JSON, and its folder."""
    folder = tmp_path_factory.mktemp("everything")
    before = os.getcwd()
    os.chdir(folder)
    try:
        Path("pictures").mkdir()
        for name in ("drift.png", "mine.png"):  # of an earlier search, and of somebody else
            metadata = {"Software": "skhoid diagnose"} if name == "drift.png" else None
            Figure().savefig(f"pictures/{name}", metadata=metadata)
        X, y = biased_runs
        write_runs(X.rename(columns={"e": "e [deg]", "x": "angle"}), y.rename("stick"), "a.csv")
        words = ["diagnose", "a.csv", "--input", "e [deg]", "--x", "angle", "--target", "f_t"]
        words += ["--output", "stick", "--time", "time", "--run", "run", *FEW]
        words += ["--tables", "tables", "--out", "pictures", "--report", "new/page.html"]
        with open("out.json", "w") as out, pytest.MonkeyPatch.context() as patched:
            patched.setattr(sys, "stdout", out)
            assert main([*words, "--json"]) == 0
        return json.loads(Path("out.json").read_text()), folder
    finally:
        os.chdir(before)


@pytest.mark.slow
def test_own_files_are_searched(everything):
    found, _ = everything
    assert found["best_effects"] == ["bias"]
    assert (found["inputs"], found["output"], found["n_runs"]) == (["e"], "stick", 3)
    level = next(p for p in found["parameters"] if p["parameter"] == "bias__level")
    assert level["value"] == pytest.approx(0.1, abs=0.02)
    assert found["comparison"]["noise_ceiling"] > 90  # of the target, by its role


@pytest.mark.slow
def test_tables_hold_what_was_found(everything):
    found, folder = everything
    tables = {Path(n).stem: pd.read_csv(folder / n, sep="\t") for n in found["tables"]}
    assert list(tables["error_path"]["effect"]) == ["baseline", "bias"]
    vaf = [step["vaf"] for step in found["error_path"]]
    assert tables["error_path"]["vaf"].tolist() == pytest.approx(vaf)
    assert len(tables["ranking"]) == len(found["ranking"])
    assert len(tables["predictions"]) == found["n_rows"]
    assert list(tables["findings"]["name"]) == found["comparison"]["findings"]
    of_comparison = {"by_run", "by_time", "by_frequency", "by_operating_point", "tests"}
    assert of_comparison < set(tables)


@pytest.mark.slow
def test_pictures_and_a_page_are_drawn(everything):
    found, folder = everything
    drawn = {Path(name).name for name in found["pictures"]}
    assert drawn >= {"comparison.png", "ranking-1.png", "error-path.png", "bias.png"}
    assert {path.name for path in (folder / "pictures").iterdir()} == drawn | {"mine.png"}
    page = (folder / found["report"]).read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert "skhoid diagnose a.csv" in page  # how it was made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "baseline"),
    [
        (["--core", "arx", "--nk", "15", "--nb", "3"], {"a1", "a2", "b0", "b1", "b2"}),
        (
            ["--delay", "0.28", "--display", "pursuit", "--controlled-element", "90", "6"],
            {"K_e", "K_edot", "T_L", "tau_e", "omega_nm", "zeta_nm"},
        ),
    ],
    ids=["arx", "operator"],
)
def test_the_model_is_what_was_asked_for(run_json, biased_file, words, baseline):
    found = run_json("diagnose", *biased_file, *FEW, *words, "--run-in", "1", IN_TEXT)
    values = {p["parameter"]: p["value"] for p in found["baseline"]}
    assert set(values) == baseline
    assert values.get("tau_e", 0.28) == 0.28
    assert found["ranking"]


@pytest.mark.slow
def test_bundled_recordings_are_diagnosed(run_json):
    found = run_json("diagnose", "--effects", "dead_zone", "bias", IN_TEXT)
    assert (found["n_runs"], found["inputs"], found["units"]["x"]) == (4, ["f_t"], "px")
    assert found["error_path"][0]["vaf"] > 90


@pytest.mark.slow
def test_what_has_no_name_is_told_drawn_and_written_as_an_effect(capsys):
    X, y = make_tracking_runs(
        "C1",
        n_runs=3,
        duration=40.96,
        sampling_rate=50,
        remnant_intensity=0.05,
        effects=DeadZone(width=0.6),
        random_state=0,
    )
    write_runs(X, y, "runs.csv")
    words = ["diagnose", "runs.csv", "--effects", "bias", "--tables", "tables"]
    assert main([*words, "--out", "pictures", "--sketch", "small_errors.py"]) == 0
    printed = capsys.readouterr().out
    assert "Curve of what has no name" in printed
    assert "Effect of your own: small_errors.py" in printed
    assert "--sketch" not in printed.split("What to do next")[1]  # it is done
    assert Path("pictures/shape.png").is_file()
    curve = pd.read_csv("tables/shape.tsv", sep="\t")
    assert list(curve) == ["e", "value", "low", "high"]
    spec = importlib.util.spec_from_file_location("small_errors", "small_errors.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["small_errors"] = module
    spec.loader.exec_module(module)
    check_effect(module.SmallErrors())


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("mine.txt", "--sketch writes a Python file, such as my_effect.py; got mine.txt."),
        ("dead_zone.py", "'dead_zone' is in the catalogue of skhoid already"),
        ("my effect.py", "use a word of letters, digits and single underscores"),
        ("there/is/none.py", "The folder there/is of there/is/none.py does not exist."),
        ("kept.py", "kept.py exists; choose another name, or --overwrite."),
    ],
)
def test_a_sketch_that_cannot_be_written_is_refused_before_the_search(capsys, file, message):
    Path("kept.py").write_text("precious")
    assert main(["diagnose", "no-such-file.csv", "--sketch", file]) == 2
    assert message in capsys.readouterr().err
    assert Path("kept.py").read_text() == "precious"


# Report.


@pytest.mark.slow
def test_a_report_has_the_search_that_is_printed(capsys, reports, biased_file):
    assert main(["report", *biased_file, *FEW, "--title", "Monday", "--out", "new/a.html"]) == 0
    printed = capsys.readouterr().out
    assert "Missing: bias; with it" in printed
    assert "Report: new/a.html (one file; open it in a browser)" in printed
    (made,) = reports
    assert made["model"].best_effects_ == ["bias"]
    assert (made["rows"], made["title"], made["source"]) == (3072, "Monday", biased_file[0])
    assert made["made_with"]["command"].startswith(f"skhoid report {biased_file[0]}")


@pytest.mark.slow
def test_a_report_without_a_search(run_json, biased_file):
    words = ["report", *biased_file, "--effects", "none", "--tables", "tables"]
    found = run_json(*words)
    assert found["comparison"]["vaf"] == found["vaf"] > 50
    assert "tables/findings.tsv" in found["tables"]
    assert Path("report.html").stat().st_size > 20_000
    predictions = pd.read_csv("tables/predictions.tsv", sep="\t")
    assert list(predictions) == ["run", "time", "measured", "free_run"]
    assert predictions.corr(numeric_only=True).loc["measured", "free_run"] > 0.7


def test_a_report_without_a_search_in_words(capsys, reports, biased_file):
    assert main(["report", *biased_file, "--effects", "none"]) == 0
    assert reports[0]["effects"] is None
    printed = capsys.readouterr().out
    assert re.search(r"VAF \d+\.\d % of the simulated output", printed)
    assert "\n  K_e  " in printed


@pytest.mark.parametrize(
    "words", [["report", "--out", "mine.html"], ["diagnose", "--report", "mine.html"]]
)
def test_a_file_is_kept_unless_overwritten(capsys, words):
    Path("mine.html").write_text("precious")
    assert main(words) == 2
    assert "mine.html exists; choose another name, or --overwrite.\n" in capsys.readouterr().err
    assert Path("mine.html").read_text() == "precious"
    assert main([*words, "--overwrite", "--na", "2"]) == 2  # it goes on
    assert "--na needs --core arx" in capsys.readouterr().err
