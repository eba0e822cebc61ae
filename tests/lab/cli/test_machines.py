"""Recordings of machines through whole commands: pages, time limits, words."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skhoid.lab.cli import main

N = 900
RNG = np.random.default_rng(0)
MOVING = np.convolve(RNG.standard_normal(N), np.ones(15) / 4, "same")
WITH_FINDINGS = {  # what the check of a recording speaks of
    "held input": np.repeat(RNG.uniform(-1, 1, N // 25), 25),
    "saturated": np.clip(MOVING, -0.3, 0.3),
    "square": np.sign(np.sin(np.arange(N) / 30)),
    "one step": np.where(np.arange(N) > N // 2, 2.0, 0.0),
    "spikes": np.where(np.arange(N) % 100 == 7, 50.0, MOVING),
}


def written(e, name="r.csv"):
    """A file of a machine of first order."""
    y = lfilter([0, 0.2], [1, -0.8], e) + 0.02 * np.random.default_rng(1).standard_normal(len(e))
    table = pd.DataFrame({"time": np.arange(len(e)) * 0.1, "u": e, "y": y})
    table.to_csv(name, index=False)
    return [name, "--input", "u", "--output", "y"]


@pytest.mark.parametrize("kind", WITH_FINDINGS)
@pytest.mark.parametrize("words", [["report"], ["diagnose", "--no-pictures", "--report", "p.html"]])
def test_a_page_is_written_where_the_check_finds_something(tmp_path, kind, words):
    given = written(WITH_FINDINGS[kind])
    core = ["--core", "arx", "--nk", "1", "--effects", "bias"]
    assert main([words[0], *given, *core, *words[1:]]) == 0
    page = (tmp_path / ("report.html" if words[0] == "report" else "p.html")).read_text()
    if kind == "held input":
        assert "What to check in the recording" in page


def test_a_time_limit_is_kept_and_what_was_not_tried_is_listed(capsys):
    given = written(MOVING)
    core = ["--core", "arx", "--nk", "1", "--no-pictures", "--time-limit", "0.001"]
    assert main(["diagnose", *given, *core, "--effects", "bias", "saturation"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "Nothing found before the time limit" in out
    assert "Not tried: bias and saturation" in out
    assert "--time-limit SECONDS" in out
