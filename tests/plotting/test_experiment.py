import matplotlib as mpl

mpl.use("Agg")
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from support.plot_checks import GREY, ORANGE, covers_nothing

from skhoid.lab.experiment import analyse_experiment, simulate_experiment
from skhoid.plotting import ROLES, EnsembleDisplay

pytestmark = pytest.mark.slow  # simulates an experiment

ARX = ["a1", "a2", "b0", "b1"]


@pytest.fixture(scope="module")
def result():
    X, y = simulate_experiment(3, "C4", runs=5, random_state=0)
    return analyse_experiment(X, y, transition_time={"C4": 41.92})


def made_up(n=100, subjects=("A",), runs=(1, 2), **columns):
    """Tables as the constructor takes them."""
    time = np.linspace(0.0, 10.0, n)
    labels = [(s, r) for s in subjects for r in (*runs, "mean")]
    paths = pd.concat(
        [
            pd.DataFrame({"subject": s, "run": r, "time": time, "b0": np.sin(time)} | columns)
            for s, r in labels
        ]
    )
    batch = pd.DataFrame(
        [
            {"subject": s, "form": form, "start": start, "stop": start + 3, "b0": level}
            for s in subjects
            for form, start, level in (("ini", 0, 0.2), ("fin", 7, np.nan))
        ]
    )
    return {"paths": paths, "batch": batch}


def result_of(tables):
    """What an analysis gives, as far as it is drawn; the other parameters are as the first."""
    marks = {"condition": "all", "form": "lambda"}
    paths = tables["paths"].assign(**marks)
    batch = tables["batch"].assign(condition="all", run="mean")
    paths, batch = (t.assign(a1=t["b0"], a2=t["b0"], b1=t["b0"]) for t in (paths, batch))
    known = {"conditions": ["all"], "memory_horizon": 256.0, "transition_times": {}}
    return SimpleNamespace(paths=paths, batch=batch, **known)


def legend_of(display):
    (legend,) = display.figure_.legends
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("form", [pytest.param("lambda"), "Lambda"])
@pytest.mark.parametrize("parameters", [pytest.param("arx"), "operator"])
def test_lines_are_those_of_the_tables(result, form, parameters):
    display = result.plot("C4", form, parameters)
    assert display.columns_ == ["S1", "S2", "S3"]
    assert display.axes_.shape == (len(display.names_), 3)
    paths = result.paths[result.paths["form"] == form]
    for row, name in enumerate(display.names_):
        for column, subject in enumerate(display.columns_):
            here = paths[paths["subject"] == subject]
            mean = display.lines_[name, subject]
            assert mean.axes is display.axes_[row, column]
            np.testing.assert_array_equal(mean.get_ydata(), here.loc[here["run"] == "mean", name])
            thin = display.singles_[name, subject]
            assert list(thin) == [1, 2, 3, 4, 5]
            for run, line in thin.items():
                np.testing.assert_array_equal(line.get_ydata(), here.loc[here["run"] == run, name])
                assert line.get_linewidth() < mean.get_linewidth()
            assert len({line.get_color() for line in thin.values()}) == 5
            assert mean.get_color() == ROLES["measured"].colour
    covers_nothing(display)
    display.figure_.set_size_inches(10, 8)
    covers_nothing(display)


def test_batch_models_and_the_change(result):
    display = result.plot()
    batch = result.batch[(result.batch["run"] == "mean") & (result.batch["subject"] == "S2")]
    for level in batch.to_dict("records"):
        line = display.batch_["b1", "S2", level["form"]]
        np.testing.assert_array_equal(line.get_xdata(), [level["start"], level["stop"]])
        np.testing.assert_array_equal(line.get_ydata(), [level["b1"]] * 2)
        assert line.get_color() == ORANGE
    for panel in display.axes_.flat:
        (marked,) = [line for line in panel.lines if line.get_color() == GREY]
        assert list(marked.get_xdata()) == [41.92, 41.92]
    runs = [f"run {run}" for run in range(1, 6)]
    assert legend_of(display) == [
        *runs,
        "mean of the runs",
        "batch, first and last part",
        "$t_M$, the change",
    ]
    assert display.figure_.get_suptitle() == "C4: λ, $N_0$ = 256"
    assert [panel.get_title() for panel in display.axes_[0]] == ["S1", "S2", "S3"]
    assert [panel.get_ylabel() for panel in display.axes_[:, 0]] == [
        f"${name[0]}_{{{name[1]}}}$" for name in ARX
    ]


def test_rows_share_limits_and_count_what_is_outside():
    tables = made_up(200, ("A", "B"))
    paths = tables["paths"]
    wild = (paths["subject"] == "B") & (paths["run"] == 1) & (paths["time"] < 0.2)
    tables["paths"] = paths.assign(b0=paths["b0"].where(~wild, 1e3))
    display = EnsembleDisplay.from_result(result_of(tables))
    low, high = display.axes_[2, 0].get_ylim()
    assert display.axes_[2, 1].get_ylim() == (low, high)
    assert -2 < low < -0.99
    assert 0.99 < high < 2
    assert list(display.notes_)[2] == ("b0", "B")
    assert display.notes_["b0", "B"].get_text() == f"{int(wild.sum())} of 600 outside"


def test_refusals(result):
    with pytest.raises(ValueError, match="condition must be one of 'C4'; got 'C1'"):
        result.plot("C1")
    with pytest.raises(ValueError, match="form must be one of 'lambda', 'Lambda'; got 'ini'"):
        result.plot(form="ini")
    with pytest.raises(ValueError, match="parameters must be one of 'arx', 'operator'"):
        result.plot(parameters="human")
