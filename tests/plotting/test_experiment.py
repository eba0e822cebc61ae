import matplotlib as mpl

mpl.use("Agg")
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from support.plot_checks import covers_nothing

from skhoid.lab.experiment import analyse_experiment, simulate_experiment
from skhoid.plotting._roles import GREY, ORANGE, foreground
from skhoid.plotting.experiment import ExperimentDisplay

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
    return {"paths": paths, "batch": batch, "names": ["b0"]}


def legend_of(display):
    (legend,) = display.figure_.legends
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("form", [pytest.param("lambda"), "Lambda"])
@pytest.mark.parametrize("parameters", [pytest.param("arx"), "operator"])
def test_lines_are_those_of_the_tables(result, form, parameters):
    display = result.plot("C4", form, parameters)
    assert display.subjects_ == ["S1", "S2", "S3"]
    assert display.ax_.shape == (len(display.names_), 3)
    paths = result.paths[result.paths["form"] == form]
    for row, name in enumerate(display.names_):
        for column, subject in enumerate(display.subjects_):
            here = paths[paths["subject"] == subject]
            mean = display.lines_[subject, name]
            assert mean.axes is display.ax_[row, column]
            np.testing.assert_array_equal(mean.get_ydata(), here.loc[here["run"] == "mean", name])
            thin = display.run_lines_[subject, name]
            assert list(thin) == [1, 2, 3, 4, 5]
            for run, line in thin.items():
                np.testing.assert_array_equal(line.get_ydata(), here.loc[here["run"] == run, name])
                assert line.get_linewidth() < mean.get_linewidth()
            assert len({line.get_color() for line in thin.values()}) == 5
            assert mean.get_color() == foreground()
    covers_nothing(display)
    display.figure_.set_size_inches(10, 8)
    covers_nothing(display)


def test_batch_models_and_the_change(result):
    display = result.plot()
    batch = result.batch[(result.batch["run"] == "mean") & (result.batch["subject"] == "S2")]
    for level in batch.to_dict("records"):
        line = display.batch_["S2", "b1", level["form"]]
        np.testing.assert_array_equal(line.get_xdata(), [level["start"], level["stop"]])
        np.testing.assert_array_equal(line.get_ydata(), [level["b1"]] * 2)
        assert line.get_color() == ORANGE
    for panel in display.ax_.flat:
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
    assert [panel.get_title() for panel in display.ax_[0]] == ["S1", "S2", "S3"]
    assert [panel.get_ylabel() for panel in display.ax_[:, 0]] == [
        f"${name[0]}_{{{name[1]}}}$" for name in ARX
    ]


def test_subjects_of_ones_choice(result):
    assert result.plot(subjects=["S3", "S1"]).subjects_ == ["S3", "S1"]
    assert result.plot(subjects="S2").ax_.shape == (4, 1)


def test_rows_share_limits_and_count_what_is_outside():
    tables = made_up(200, ("A", "B"))
    paths = tables["paths"]
    wild = (paths["subject"] == "B") & (paths["run"] == 1) & (paths["time"] < 0.2)
    tables["paths"] = paths.assign(b0=paths["b0"].where(~wild, 1e3))
    display = ExperimentDisplay(**tables).plot()
    low, high = display.ax_[0, 0].get_ylim()
    assert display.ax_[0, 1].get_ylim() == (low, high)
    assert -2 < low < -0.99
    assert 0.99 < high < 2
    assert list(display.notes_) == [("B", "b0")]
    assert display.notes_["B", "b0"].get_text() == f"{int(wild.sum())} of 600 outside"


def test_stretches_and_levels_without_estimates():
    tables = made_up()
    paths = tables["paths"]
    tables["paths"] = paths.assign(b0=paths["b0"].where(paths["time"] > 5))
    display = ExperimentDisplay(**tables).plot()
    assert list(display.batch_) == [("A", "b0", "ini")]
    covers_nothing(display)
    tables["paths"] = paths.assign(b0=np.nan)
    tables["batch"] = tables["batch"].assign(b0=np.nan)
    covers_nothing(ExperimentDisplay(**tables).plot())


def test_many_runs_share_a_name():
    display = ExperimentDisplay(**made_up(runs=range(12))).plot()
    assert legend_of(display)[0] == "single runs"
    assert len(display.run_lines_["A", "b0"]) == 12


def test_given_axes(result):
    axes = Figure().subplots(4, 3)
    display = ExperimentDisplay.from_result(result, ax=axes)
    assert display.ax_.tolist() == axes.tolist()
    assert axes[0, 0].get_legend() is not None
    assert not display.figure_.legends
    with pytest.raises(ValueError, match="needs 12: 4 parameters of 3 subjects, row by row"):
        ExperimentDisplay.from_result(result, ax=axes[0])


def test_refusals(result):
    with pytest.raises(ValueError, match="condition is one of C4; got 'C1'"):
        result.plot("C1")
    with pytest.raises(ValueError, match="form is 'lambda' or 'Lambda'; got 'ini'"):
        result.plot(form="ini")
    with pytest.raises(ValueError, match="parameters is 'arx' or 'operator'"):
        result.plot(parameters="human")
    with pytest.raises(ValueError, match="subjects are some of S1, S2, S3"):
        result.plot(subjects=["S4"])
