"""Recordings as machines and labs give them, through whole commands: done, or one line says why.

Staircases, spikes, constants; outputs that saturate, integrate, are quantised, clipped or follow a
relay; tiny and huge amplitudes; 400 Hz and short records; with effects and orders as they come.
"""

import contextlib
import io
import json
import os
import re
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from hypothesis import strategies as st
from scipy.signal import lfilter
from support.fuzzing import RAW, fuzz

from skhoid import ARXRegressor, OperatorRegressor
from skhoid.effects import catalogue
from skhoid.lab.cli import main
from skhoid.lab.explore import Exploration

pytestmark = pytest.mark.whole  # commands on drawn recordings: minutes; docs/contributing.md

EFFECTS = list(catalogue().index)
N = st.sampled_from([40, 150, 400, 900])
RATES = [1.0, 10.0, 50.0, 100.0, 400.0]


def moving(rng, n):
    return np.convolve(rng.standard_normal(n + 40), np.ones(15) / 4, "same")[:n]


INPUTS = {
    "moving": moving,
    "noise": lambda rng, n: rng.standard_normal(n),
    "stairs": lambda rng, n: np.repeat(rng.uniform(-1, 1, n // 25 + 1), 25)[:n],
    "one step": lambda rng, n: (np.arange(n) > n // 3) * 1.0,
    "spikes": lambda rng, n: (rng.uniform(size=n) > 0.97) * 5.0,
    "constant": lambda rng, n: np.full(n, 2.0),
    "ramp": lambda rng, n: np.arange(n) / n,
    "square": lambda rng, n: np.sign(np.sin(np.arange(n) / 9)),
}
OUTPUTS = {
    "linear": lambda e, y: y,
    "integral": lambda e, y: np.cumsum(e) / 50,
    "saturated": lambda e, y: np.clip(y, -0.2, 0.2),
    "quantised": lambda e, y: np.round(y / 0.3) * 0.3,
    "levels": lambda e, y: np.sign(y),
    "relay": lambda e, y: np.where(np.abs(e) > 0.3, np.sign(e), 0.0),
    "clipped below": lambda e, y: np.maximum(y, 0.0),
    "spikes": lambda e, y: np.where(np.arange(len(y)) % 37 == 5, 9.0, y),
    "constant": lambda e, y: np.full(len(y), 3.0),
    "unrelated": lambda e, y: np.roll(y[::-1], 7),
    "wrapped": lambda e, y: np.mod(np.cumsum(y), 6.28),
    "unstable": lambda e, y: np.exp(np.minimum(np.arange(len(y)) / 30, 30)) + y,
    "copy": lambda e, y: e,
    "missing": lambda e, y: np.where(np.arange(len(y)) % 50 < 5, np.nan, y),
}
SCALES = [1.0, 1.0, 1.0, 1e-9, 1e9, 1e-150, 1e100]


@st.composite
def tables(draw):
    """A recording, one run or several."""
    rng = np.random.default_rng(draw(st.integers(0, 2**16)))
    n, rate = draw(N), draw(st.sampled_from(RATES))
    e = INPUTS[draw(st.sampled_from(sorted(INPUTS)))](rng, n)
    y = lfilter([0, 0.2], [1, -0.8], e) + draw(st.sampled_from([0, 0.02])) * rng.standard_normal(n)
    y = OUTPUTS[draw(st.sampled_from(sorted(OUTPUTS)))](e, y)
    table = pd.DataFrame({"time": np.arange(n) / rate, "e": e * draw(st.sampled_from(SCALES))})
    table["u"] = y * draw(st.sampled_from(SCALES))
    if draw(st.booleans()):
        table["x"] = np.cumsum(y) / rate
    if draw(st.integers(0, 2)) == 0:
        table["run"] = np.arange(n) // (n // 2 + 1)
    return table


@st.composite
def words(draw):
    """A command that identifies or searches, with effects, orders and a core."""
    command = draw(st.sampled_from(["diagnose", "diagnose", "report", "identify", "experiment"]))
    given = ["r.csv"]
    if command != "identify":
        few = draw(st.lists(st.sampled_from(EFFECTS), min_size=1, max_size=2, unique=True))
        none = command in ("report", "experiment") and not draw(st.integers(0, 4))
        given += ["--effects", *(["none"] if none else few)]
        if not none and draw(st.booleans()):
            given += ["--time-limit", draw(st.sampled_from(["0.1", "2"]))]
    if command == "diagnose":
        given += ["--report", "r.html"] if draw(st.booleans()) else []
    if command == "identify" or (command != "experiment" and draw(st.booleans())):
        given += [] if command == "identify" else ["--core", "arx"]
        orders = draw(st.sampled_from(["", "1", "2", "5", "12"]))
        given += ["--na", orders] if orders else []
        given += ["--nk", draw(st.sampled_from(["0", "1", "7"]))] if draw(st.booleans()) else []
    if command in ("diagnose", "identify"):
        given += ["--no-pictures"] if draw(st.integers(0, 3)) else []
        given += ["--domain", "machine"] if draw(st.booleans()) else []
    if command in ("diagnose", "report"):
        given += ["--remove-means"] if draw(st.booleans()) else []
    given += ["--json"] if draw(st.booleans()) else []
    return [command, *given]


def run(given):
    """Exit code, stdout and stderr of a command."""
    out, err = io.StringIO(), io.StringIO()
    streams = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with streams[0], streams[1], warnings.catch_warnings():
        warnings.simplefilter("default")
        try:
            code = main(given)
        except SystemExit as stop:
            code = stop.code
    return code, out.getvalue(), err.getvalue()


@fuzz(batch=2, table=tables(), given=words())
def test_commands(table, given):
    here = os.getcwd()
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            table.to_csv("r.csv", index=False)
            code, out, err = run(given)
            written = {path.name for path in Path(folder).iterdir()}
        finally:
            os.chdir(here)
    assert code in (0, 2), err
    assert "Traceback" not in err
    assert not RAW.search(err), err
    if code == 2:
        assert sum(": error:" in line for line in err.splitlines()) == 1, err
        return
    if "--json" in given:
        json.loads(out)
    else:
        assert not re.search(r"\bnan\b|\binf\b", out), out
    if "--report" in given or given[0] == "report":
        assert written & {"r.html", "report.html"}


@fuzz(
    batch=2,
    table=tables(),
    core=st.sampled_from([OperatorRegressor(), ARXRegressor(2, 2, 1), ARXRegressor(1, 1, 0)]),
    added=st.lists(st.sampled_from(EFFECTS), max_size=2, unique=True),
)
def test_exploring_by_hand(table, core, added):
    """What the workbench does: a model, effects added, judged, written as a script."""
    runs = table.get("run", pd.Series(0, index=table.index))
    index = pd.MultiIndex.from_arrays([runs, table["time"]], names=["run", "time"])
    channels = table.drop(columns=["time", "u", "run"], errors="ignore").set_axis(index)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            exploration = Exploration(
                core, channels, pd.Series(table["u"].to_numpy(), index, name="u")
            )
            for effect in added:
                exploration.act("add", {"effect": effect, "run": 0})
        except ValueError as error:
            if RAW.search(str(error)):
                raise
            return
        exploration.judge()
        json.dumps(exploration.state(), default=str)
        assert "import" in exploration.script()
