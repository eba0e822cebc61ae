"""The command ``skhoid report``, and the reports of others."""

import argparse
import sys
from pathlib import Path

import pandas as pd
import pytest

from skhoid.lab.cli import main
from skhoid.lab.cli.output import shows_progress

FEW = ["--effects", "bias", "drift"]


@pytest.fixture
def calls(monkeypatch):
    """What the reports of a test are made of, quickly; their comparison is that of one."""
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


@pytest.mark.slow
def test_report_is_written_by_default_beside_the_story(capsys, biased_file, biased_runs):
    assert main(["report", *biased_file, "--effects", "bias", "--title", "Monday"]) == 0
    printed = capsys.readouterr().out
    assert "Missing: bias; with it" in printed
    assert "Report: report.html (one file; open it in a browser)" in printed
    page = Path("report.html").read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert "<title>Monday</title>" in page
    assert "skhoid report" in page  # how it was made


@pytest.mark.slow
def test_report_takes_the_fitted_search(run_json, calls, biased_file):
    found = run_json("report", *biased_file, *FEW, "--out", "new/monday.html")
    (made,) = calls
    assert made["model"].best_effects_ == found["best_effects"] == ["bias"]
    assert made["rows"] == found["n_rows"]
    assert made["source"] == found["source"] == biased_file[0]
    assert made["made_with"]["command"].startswith(f"skhoid report {biased_file[0]}")
    assert (found["report"], found["pictures"], found["tables"]) == ("new/monday.html", [], [])


def test_report_without_a_search(capsys, run_json, calls, biased_file):
    words = ["report", *biased_file, "--effects", "none", "--tables", "tables"]
    found = run_json(*words)
    assert calls[0]["effects"] is None
    assert calls[0]["model"].parameters_.loc["K_e", "value"] == pytest.approx(
        found["parameters"][0]["value"]
    )
    assert found["tables"] == ["tables/parameters.tsv", "tables/predictions.tsv"]
    predictions = pd.read_csv("tables/predictions.tsv", sep="\t")
    assert list(predictions) == ["run", "time", "measured", "free_run"]
    lost = ((predictions["measured"] - predictions["free_run"]) ** 2).sum()
    vaf = 100 * (1 - lost / (predictions["measured"] ** 2).sum())
    assert found["vaf"] == pytest.approx(vaf)
    assert main([*words, "--overwrite"]) == 0
    printed = capsys.readouterr().out
    assert f"VAF {vaf:.1f} % of the simulated output" in printed
    assert "\n  K_e  " in printed


@pytest.mark.slow
def test_a_real_report_without_a_search(run_json, biased_file):
    found = run_json("report", *biased_file, "--effects", "none", "--tables", "tables")
    assert found["comparison"]["vaf"] == found["vaf"] > 50
    assert "tables/findings.tsv" in found["tables"]
    assert Path("report.html").stat().st_size > 20_000


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [["report", "--out", "mine.html"], ["diagnose", "--report", "mine.html"]]
)
def test_a_file_is_kept_unless_overwritten(capsys, calls, biased_file, words):
    Path("mine.html").write_text("precious")
    words = [*words, *biased_file, *FEW]
    assert main(words) == 2
    assert capsys.readouterr().err == (
        "skhoid: error: mine.html exists; choose another name, or --overwrite.\n"
    )
    assert Path("mine.html").read_text() == "precious"
    extra = ["--no-pictures"] if words[0] == "diagnose" else []
    assert main([*words, *extra, "--overwrite"]) == 0
    assert Path("mine.html").read_text() == "<html>"
    assert main(["report", "--out", "."]) == 2
    assert ". is a folder; name a file in it." in capsys.readouterr().err


@pytest.mark.slow
def test_demo_leaves_a_report_with_its_seed(capsys, calls):
    words = ["demo", "--runs", "2", "--effect", "bias", "--effects", "bias", "--no-pictures"]
    assert main([*words, "--out", "here"]) == 0
    printed = capsys.readouterr().out
    assert "Report: here/report.html" in printed
    assert "What to do next" in printed
    assert calls[0]["made_with"]["seed"] == "0"
    assert main([*words, "--out", "here"]) == 0  # its own folder: replaced
    assert main([*words, "--out", "there", "--no-report"]) == 2
    assert "--no-pictures and --no-report leave nothing there" in capsys.readouterr().err
    assert not Path("there").exists()


@pytest.mark.slow
def test_tables_of_the_story(run_json, biased_file):
    words = ["diagnose", *biased_file, *FEW, "--no-pictures"]
    found = run_json(*words, "--tables", "one")
    assert found["report"] is None
    tables = {Path(name).stem: pd.read_csv(name, sep="\t") for name in found["tables"]}
    assert list(tables["error_path"]["effect"]) == ["baseline", "bias"]
    assert tables["error_path"]["vaf"].tolist() == pytest.approx(
        [step["vaf"] for step in found["error_path"]]
    )
    assert len(tables["ranking"]) == len(found["ranking"])
    assert list(tables["predictions"])[:4] == ["run", "time", "measured", "baseline"]
    assert len(tables["predictions"]) == found["n_rows"]
    assert list(tables["findings"]["name"]) == found["comparison"]["findings"]
    level = tables["parameters"].set_index("parameter").loc["bias__level"]
    assert level["value"] == pytest.approx(0.1, abs=0.01)
    of_comparison = {"by_run", "by_time", "by_frequency", "by_operating_point", "tests"}
    assert of_comparison < set(tables)
    again = run_json(*words, "--tables", "two", "--table-format", "parquet")
    for name in again["tables"]:
        text = Path("one", f"{Path(name).stem}.tsv").read_text()
        assert pd.read_parquet(name).to_csv(sep="\t", index=False) == text


def test_tables_are_checked_before_the_work(capsys, monkeypatch, biased_file):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    words = ["--tables", "tables", "--table-format", "parquet"]
    for command in ("demo", "diagnose", "report", "identify"):
        assert main([command, *words]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert 'pip install "skhoid[io]"' in said.err


@pytest.mark.parametrize(
    ("terminals", "json", "shown"),
    [
        (("stdout", "stderr"), False, True),
        (("stderr",), False, False),
        (("stdout",), False, False),
        (("stdout", "stderr"), True, False),
    ],
)
def test_a_search_shows_its_progress_where_somebody_looks(monkeypatch, terminals, json, shown):
    for stream in terminals:
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: True)
    assert shows_progress(argparse.Namespace(json=json)) == shown


@pytest.mark.slow
def test_the_search_of_a_report_has_its_progress(monkeypatch, calls, biased_file):
    monkeypatch.setattr("skhoid.lab.cli.diagnose.shows_progress", lambda options: True)
    begun = []
    monkeypatch.setattr(
        "sklearn.callback.ProgressBar.setup",
        lambda self, estimator, context: begun.append(type(estimator).__name__),
    )
    for event in ("teardown", "on_fit_task_begin", "on_fit_task_end"):
        monkeypatch.setattr(f"sklearn.callback.ProgressBar.{event}", lambda *args, **kwargs: None)
    assert main(["report", *biased_file, *FEW]) == 0
    assert begun == ["EffectSearchCV"]
