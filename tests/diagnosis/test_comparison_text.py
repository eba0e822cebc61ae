"""A comparison as a piece of HTML."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
from support.page import parse

from skhoid.diagnosis.comparison_text import _runs, figures, html
from skhoid.recordings.recording import Finding


def made(**changed):
    """What the text reads of a comparison."""
    by_run = {"data": "validation", "run": [1], "target": [1], "vaf": 80.1234, "p": 0.5}
    found = {
        "model_name": "ARXRegressor",
        "output": "u",
        "unit": "deg",
        "vaf": 80.0,
        "vaf_about_mean": 80.0,
        "mean_share": 0.0,
        "mean_dominates": False,
        "leak": None,
        "one_step_vaf": np.nan,
        "rmse": 0.1,
        "noise_ceiling": np.nan,
        "ceiling_note": "none: one run",
        "overfit": None,
        "by_run": pd.DataFrame(by_run),
        "findings": [Finding("bias", "An offset", "p < 1e-6", "A trim", "Subtract it", "")],
        "notes": ["one row is left out"],
    }
    return SimpleNamespace(**{**found, **changed})


def test_html_holds_figures_findings_runs_and_notes():
    c = made()
    page = html(c)
    assert page.startswith("<p><b>ARXRegressor against measured u</b></p>")
    for name, value in figures(c):
        assert f"{name}</th><td style='text-align:left'>{value}</td>" in page
    assert "<b>An offset</b><br>p &lt; 1e-6<br>A trim<br><i>Subtract it</i>" in page
    assert "<summary>By run</summary><table" in page
    assert "80.123" in page
    assert "target" not in page
    assert page.rstrip().endswith("<p>one row is left out.</p>")


def test_names_in_the_data_are_text():
    evil = "<script>alert('x')</script> & more"
    c = made(output=evil, notes=[evil], by_run=made().by_run.assign(run=evil))
    c.findings = [Finding("bias", evil, evil, evil, evil, "")]
    assert "<script" not in html(c)
    assert parse(html(c)).text.count(evil) == 7


def test_of_many_runs_those_of_lowest_vaf_are_listed():
    n = 40
    vaf = np.random.default_rng(0).permutation(n).astype(float)
    table = pd.DataFrame({"data": "validation", "run": [f"r{k}" for k in range(n)], "vaf": vaf})
    table = table.assign(one_step_vaf=90.0, rmse=1.0, ratio=1.0, exceeds=False)
    title, listed = _runs(made(by_run=table))
    assert title == "Runs, the 12 with the lowest VAF of 40"
    assert [float(line.split()[2]) for line in listed.splitlines()[1:]] == list(range(12))
    title, listed = _runs(made(by_run=table[:12]))
    assert title == "Runs"
    assert [line.split()[1] for line in listed.splitlines()[1:]] == [f"r{k}" for k in range(12)]
