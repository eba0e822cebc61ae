"""The script of an exploration: run on its own, it prints the exploration's numbers."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from skhoid import ARXRegressor, OperatorRegressor, SimulatedARX
from skhoid.effects import Bias, DeadZone
from skhoid.lab.explore import Exploration

pytestmark = pytest.mark.slow  # fits again what the script fits


def printed(script, X, y, capsys):
    """What the script prints as VAF, by runs."""
    capsys.readouterr()
    exec(compile(script, "script", "exec"), {"X": X, "y": y})
    lines = capsys.readouterr().out.splitlines()
    vaf = [line.rpartition(": ") for line in lines if line.startswith("VAF")]
    return {head.removeprefix("VAF, runs "): float(number) for head, _, number in vaf}


WAYS = {
    "moved": [
        ("add", {"effect": "bias"}),
        ("release", {"name": "bias__level", "value": 0.0123}),
    ],
    "refitted": [
        ("add", {"effect": "bias"}),
        ("add", {"effect": "dead_zone"}),
        ("release", {"name": "bias__level", "value": 0.0123}),
        ("refit", {}),
    ],
    "held out": [
        ("add", {"effect": "bias"}),
        ("use", {"runs": [0], "use": "hold"}),
        ("use", {"runs": [2], "use": "out"}),
    ],
}


@pytest.mark.parametrize("way", WAYS)
def test_prints_the_same_numbers(runs, search, way, capsys):
    exploration = Exploration.of_search(search, *runs)
    for name, args in WAYS[way]:
        exploration.act(name, {**args, "run": 0})
    vaf = exploration.state()["vaf"]
    found = printed(exploration.act("script", {})["text"], *runs, capsys)
    assert found.pop("fitted") == vaf["train"]
    assert found == ({} if vaf["hold"] is None else {"held out": vaf["hold"]})


def test_reads_as_people_write(runs, search):
    exploration = Exploration.of_search(search, *runs)
    for name, args in WAYS["held out"]:
        exploration.act(name, {**args, "run": 0})
    vaf = exploration.state()["vaf"]
    assert exploration.script() == (
        "from skhoid import OperatorRegressor, VAFScorer, select_runs\n"
        "from skhoid.effects import Bias\n"
        "\n"
        "# X and y: the runs of this exploration, as they were given to it.\n"
        "fitted = select_runs(X, y, runs=[1])\n"
        "held_out = select_runs(X, y, runs=[0])\n"
        "model = OperatorRegressor(effects=Bias())\n"
        "model.fit(*fitted)\n"
        "\n"
        "vaf = VAFScorer(run_in=3.0)\n"
        f'print("VAF, runs fitted:", vaf(model, *fitted))  # {vaf["train"]!r}\n'
        f'print("VAF, runs held out:", vaf(model, *held_out))  # {vaf["hold"]!r}\n'
        "print(model.parameters_.to_string())\n"
    )


@pytest.mark.parametrize(
    "estimator",
    [
        OperatorRegressor(settling=1.5, roles={"e": "e"}, controlled_element="90/(s(s+6))"),
        OperatorRegressor(delay=0.3, effects=DeadZone(width=0.25) + Bias()),
        pytest.param(ARXRegressor(nk=15), marks=pytest.mark.slow),
        pytest.param(SimulatedARX(nk=15, na=3, effects=Bias()), marks=pytest.mark.slow),
    ],
    ids=["options", "with effects", "arx", "arx with effects"],
)
def test_settings_of_the_model_are_in_it(runs, estimator, capsys):
    exploration = Exploration(estimator, *runs)
    found = printed(exploration.script(), *runs, capsys)
    assert found == {"fitted": exploration.state()["vaf"]["train"]}


def test_people_and_arrays_are_taken_by_rows(runs, capsys):
    X, y = runs
    people = [pd.concat({"S1": part, "S2": part}, names=["subject"]) for part in (X, y)]
    exploration = Exploration(OperatorRegressor(), *people)
    assert "rows = np.r_[0:3072]" in exploration.script()
    found = printed(exploration.script(), *people, capsys)
    assert found == {"fitted": exploration.state()["vaf"]["train"]}
    label = np.repeat([0.0, 1.0, 2.0], 1024)
    table = np.column_stack([X["e"], label])
    exploration = Exploration(OperatorRegressor(dt=0.02, inputs=[0], run=1), table, y.to_numpy())
    exploration.act("use", {"runs": [1], "use": "hold", "run": 0})
    vaf = exploration.state()["vaf"]
    found = printed(exploration.script(), table, y.to_numpy(), capsys)
    assert found == {"fitted": vaf["train"], "held out": vaf["hold"]}


def test_rows_in_which_control_was_lost_are_left_out(runs, capsys):
    X, y = (part.copy() for part in runs)
    X.iloc[1100:1250, X.columns.get_loc("e")] *= 40  # s of an error far beyond any other
    exploration = Exploration(OperatorRegressor(), X, y)
    assert exploration.runs.lost
    assert "in which control was lost" in exploration.view()["note"]
    script = exploration.script()
    assert "y.iloc[" in script
    assert printed(script, X, y, capsys) == {"fitted": exploration.state()["vaf"]["train"]}


@pytest.mark.slow  # a process of its own, which compiles
def test_in_a_process_of_its_own(runs, search, tmp_path):
    exploration = Exploration.of_search(search, *runs)
    for name, args in WAYS["refitted"]:
        exploration.act(name, {**args, "run": 0})
    X, y = runs
    X.to_pickle(tmp_path / "X.pkl")
    y.to_pickle(tmp_path / "y.pkl")
    files = [str(tmp_path / name) for name in ("X.pkl", "y.pkl")]
    reading = f"import pandas as pd\nX, y = map(pd.read_pickle, {files!r})\n"
    (tmp_path / "script.py").write_text(reading + exploration.script(), encoding="utf-8")
    command = [sys.executable, str(tmp_path / "script.py")]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert out.splitlines()[0] == f"VAF, runs fitted: {exploration.state()['vaf']['train']!r}"
