"""The commands ``demo``, ``diagnose`` and ``report``."""

import importlib.util
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


SHORT = {"duration": 20.48, "sampling_rate": 50.0}


@pytest.fixture(scope="module")
def without():
    """Output of the person of the demo in whom nothing is hidden."""
    return make_tracking_runs("C1", 1, remnant_intensity=0.1, random_state=0, **SHORT)[1]


@pytest.mark.parametrize("name", catalogue().index[::5])
def test_every_effect_of_the_catalogue_can_be_chosen(capsys, monkeypatch, name, without):
    """It is hidden in a person, who does something else then; or one line says why it cannot be."""
    simulated = []

    def few(condition, n_runs, **options):
        return make_tracking_runs(condition, 1, **{**options, **SHORT})

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
    ((y, truth),) = simulated
    assert any(key.startswith(f"{name}__") for key in truth)
    assert (y != without).mean() > 0.1


@pytest.mark.slow
def test_demo_finds_what_it_hides_and_says_the_truth(capsys, monkeypatch, reports):
    def short(*given, **options):
        return make_tracking_runs(*given, **{**options, "duration": 40.96, "sampling_rate": 40})

    monkeypatch.setattr(skhoid, "make_tracking_runs", short, raising=False)
    words = ["demo", "--runs", "2", "--effect", "bias", *FEW, "--no-pictures"]
    assert main([*words, "--out", "here"]) == 0
    printed = capsys.readouterr().out
    for expected in ("Missing: bias (", "The truth: hidden bias", "here/report.html"):
        assert expected in printed
    (level,) = (line.split() for line in printed.splitlines() if line.startswith("bias: level"))
    assert float(level[2]) == 0.05
    assert float(level[3]) == pytest.approx(0.05, abs=0.02)
    assert "What to do next" in printed.split("\n\n")[-1]
    assert max(map(len, printed.splitlines())) <= 80
    assert reports[0]["made_with"]["seed"] == "0"
    assert reports[0]["model"].best_effects_ == ["bias"]


@pytest.mark.slow
def test_own_files_are_searched_drawn_and_written(run_json, biased_file):
    Path("pictures").mkdir()
    for name in ("drift.png", "mine.png"):  # of an earlier search, and of somebody else
        metadata = {"Software": "skhoid diagnose"} if name == "drift.png" else None
        Figure().savefig(f"pictures/{name}", metadata=metadata)
    words = [
        "diagnose",
        *biased_file,
        *FEW,
        "--max-effects",
        "1",
        "--tables",
        "tables",
        "--out",
        "pictures",
    ]
    found = run_json(*words, "--report", "new/page.html")
    assert found["best_effects"] == ["bias"]
    assert (found["inputs"], found["output"], found["n_runs"]) == (["e"], "stick", 3)
    level = next(p for p in found["parameters"] if p["parameter"] == "bias__level")
    assert level["value"] == pytest.approx(0.1, abs=0.02)
    assert found["comparison"]["noise_ceiling"] > 90  # of the target, by its role

    tables = {Path(name).stem: pd.read_csv(name, sep="\t") for name in found["tables"]}
    vaf = [step["vaf"] for step in found["error_path"]]
    assert tables["error_path"]["vaf"].tolist() == pytest.approx(vaf)
    assert len(tables["predictions"]) == found["n_rows"]
    findings = [finding["name"] for finding in found["comparison"]["findings"]]
    assert list(tables["findings"]["name"]) == findings
    assert {"ranking", "by_run", "by_time", "by_frequency", "by_operating_point"} < set(tables)

    drawn = {Path(name).name for name in found["pictures"]}
    assert drawn >= {"comparison.png", "ranking-1.png", "error-path.png", "bias.png"}
    assert {path.name for path in Path("pictures").iterdir()} == drawn | {"mine.png"}
    page = Path(found["report"]).read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert "skhoid diagnose runs.csv" in page  # how it was made


@pytest.mark.parametrize(
    ("words", "parameters"),
    [
        (["--core", "arx", "--nk", "12", "--nb", "3"], {"a1", "a2", "b0", "b1", "b2"}),
        (["--delay", "0.28"], {"K_e", "K_edot", "T_L", "tau_e", "omega_nm", "zeta_nm"}),
    ],
    ids=["arx", "operator"],
)
def test_the_model_is_what_was_asked_for(run_json, reports, biased_file, words, parameters):
    found = run_json("report", *biased_file, "--effects", "none", *words, "--run-in", "1")
    values = {p["parameter"]: p["value"] for p in found["parameters"]}
    assert set(values) == parameters
    assert values.get("tau_e", 0.28) == 0.28


@pytest.mark.slow
def test_what_has_no_name_is_told_drawn_and_written_as_an_effect(capsys):
    X, y = make_tracking_runs(
        "C1",
        n_runs=3,
        duration=20.48,
        sampling_rate=40,
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
        ("kept.py", "kept.py exists; choose another name, or --overwrite."),
    ],
)
def test_a_sketch_that_cannot_be_written_is_refused_before_the_search(capsys, file, message):
    Path("kept.py").write_text("precious")
    assert main(["diagnose", "no-such-file.csv", "--sketch", file]) == 2
    assert message in capsys.readouterr().err
    assert Path("kept.py").read_text() == "precious"


@pytest.mark.slow
def test_a_report_has_the_search_that_is_printed(capsys, reports, biased_file):
    words = ["--effects", "bias", "--title", "Monday", "--out", "new/a.html"]
    assert main(["report", *biased_file, *words]) == 0
    printed = capsys.readouterr().out
    assert "Missing: bias (" in printed
    assert "Report: new/a.html (one file; open it in a browser)" in printed
    (made,) = reports
    assert made["model"].best_effects_ == ["bias"]
    assert (made["title"], made["source"]) == ("Monday", "runs.csv")
    assert made["made_with"]["command"].startswith("skhoid report runs.csv")


@pytest.mark.slow
def test_a_report_without_a_search(run_json, biased_file):
    found = run_json("report", *biased_file, "--effects", "none", "--tables", "tables")
    assert found["comparison"]["vaf"] > 50
    assert "tables/findings.tsv" in found["tables"]
    assert Path("report.html").stat().st_size > 20_000
    predictions = pd.read_csv("tables/predictions.tsv", sep="\t")
    assert list(predictions) == ["run", "time", "measured", "free_run"]
    assert predictions.corr(numeric_only=True).loc["measured", "free_run"] > 0.7


@pytest.mark.parametrize(
    "words", [["report", "--out", "mine.html"], ["diagnose", "--report", "mine.html"]]
)
def test_a_file_is_kept_unless_overwritten(capsys, words):
    Path("mine.html").write_text("precious")
    assert main(words) == 2
    assert "mine.html exists; choose another name, or --overwrite.\n" in capsys.readouterr().err
    assert Path("mine.html").read_text() == "precious"
