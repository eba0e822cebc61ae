"""The script of an exploration: run on its own, it prints the exploration's numbers."""

import re

import numpy as np
import pandas as pd
import pytest

from skhoid import ControlledElement, OperatorRegressor, SimulatedARX
from skhoid.effects import Bias, DeadZone
from skhoid.lab.explore import Exploration

pytestmark = pytest.mark.slow  # fits again what the script fits


def printed(script, X, y, capsys):
    """What the script, which uses public names alone, prints as VAF, by runs."""
    assert set(re.findall(r"\bskhoid[\w.]*", script)) <= {"skhoid", "skhoid.effects"}
    capsys.readouterr()
    exec(compile(script, "script", "exec"), {"X": X, "y": y})
    lines = capsys.readouterr().out.splitlines()
    vaf = [line.rpartition(": ") for line in lines if line.startswith("VAF")]
    return {head.removeprefix("VAF, runs "): float(number) for head, _, number in vaf}


WAYS = {
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
    exploration = Exploration(search.estimator, *runs, search=search)
    for name, args in WAYS[way]:
        exploration.act(name, {**args, "run": 0})
    vaf = exploration.state()["vaf"]
    found = printed(exploration.act("script", {})["text"], *runs, capsys)
    assert found.pop("fitted") == vaf["train"]
    assert found == ({} if vaf["hold"] is None else {"held out": vaf["hold"]})


def test_names_of_what_the_model_was_given_are_imported(runs, capsys):
    model = OperatorRegressor(controlled_element=ControlledElement(1.0, 1.0))
    script = Exploration(model, *runs).script()
    assert script.startswith("from skhoid import ControlledElement, OperatorRegressor, VAFScorer\n")
    printed(script, *runs, capsys)


def test_reads_as_people_write(runs, search):
    exploration = Exploration(search.estimator, *runs, search=search)
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
        SimulatedARX(nk=15, na=3, effects=DeadZone(width=0.25) + Bias()),
    ],
    ids=["options", "arx with effects"],
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
    expected = {"fitted": vaf["train"], "held out": vaf["hold"]}
    assert found == pytest.approx(expected, rel=1e-13)  # sums of copied rows round otherwise


def test_rows_in_which_control_was_lost_are_left_out(runs, capsys):
    X, y = (part.copy() for part in runs)
    X.iloc[1100:1250, X.columns.get_loc("e")] *= 40  # s of an error far beyond any other
    exploration = Exploration(OperatorRegressor(), X, y)
    assert exploration.runs.lost
    assert "in which control was lost" in exploration.view()["note"]
    script = exploration.script()
    assert "y.iloc[" in script
    assert printed(script, X, y, capsys) == {"fitted": exploration.state()["vaf"]["train"]}
