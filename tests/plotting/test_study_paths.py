from functools import cache

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from support.plot_checks import GREEN, ORANGE, covers_nothing

from skhoid.plotting import ROLES, EnsembleDisplay

pytestmark = pytest.mark.slow

TIME = np.arange(0, 81.92, 1.28)
ARX = ["a1", "a2", "b0", "b1"]
OPERATOR = ["K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"]
N = 8


def after(time):
    return 1 / (1 + np.exp(40.96 - time))


TRUTH = pd.DataFrame(
    {
        "a1": -1.91,
        "a2": 0.92,
        "b0": 0.05 + 0.05 * after(TIME),
        "b1": -0.05 - 0.05 * after(TIME),
        "K_e": 0.09,
        "T_L": 0.4 + 0.8 * after(TIME),
        "K_edot": 0.036,
        "omega_nm": 11.25,
        "zeta_nm": 0.35,
    },
    index=pd.Index(TIME, name="time"),
)


def paths(intensities=(0.0, 0.15, 0.3), condition="C4"):
    """A made-up study: the truth with an offset for each replication, and batch fits."""
    return made(intensities, condition).copy()


@cache
def made(intensities, condition):
    keys = ["condition", "remnant_intensity", "replication", "form"]
    cells = pd.MultiIndex.from_product(
        [[condition], intensities, range(N), ["lambda", "Lambda", "ini", "fin"]], names=keys
    ).to_frame(index=False)
    parts = []
    for _, cell in cells.iterrows():
        name = cell["form"]
        values = TRUTH.reset_index()
        if name in ("ini", "fin"):
            values = values.iloc[[0 if name == "ini" else -1]].assign(time=np.nan)
        offset = 1 + 0.1 * cell["remnant_intensity"] * (cell["replication"] - (N - 1) / 2)
        values[ARX + OPERATOR] *= offset
        parts.append(values.assign(**cell.to_dict()))
    return pd.concat(parts, ignore_index=True)[[*keys, "time", *ARX, *OPERATOR]]


def cell(table, form, P_n):
    return table[(table["form"] == form) & (table["remnant_intensity"] == P_n)]


def test_lines_and_bands_are_mean_and_deviation():
    table = paths()
    display = EnsembleDisplay.from_table(table, form="Lambda", truth=TRUTH, transition_time=40.96)
    assert (display.names_, display.columns_) == (ARX, [0.0, 0.15, 0.3])
    assert display.axes_.shape == (4, 3)
    groups = cell(table, "Lambda", 0.3).groupby("time")["b0"]
    mean, sd = groups.mean().to_numpy(), groups.std().to_numpy()
    line = display.lines_["b0", 0.3]
    np.testing.assert_allclose(line.get_xdata(), TIME)
    np.testing.assert_allclose(line.get_ydata(), mean)
    assert same_color(line.get_color(), ROLES["measured"].colour)
    corners = display.bands_["b0", 0.3].get_paths()[0].vertices
    for i in (0, 50, -1):
        there = corners[np.isclose(corners[:, 0], TIME[i]), 1]
        np.testing.assert_allclose([there.min(), there.max()], [mean[i] - sd[i], mean[i] + sd[i]])
    true = display.truth_["b0", 0.3]
    np.testing.assert_allclose(true.get_ydata(), TRUTH["b0"])
    assert same_color(true.get_color(), GREEN)
    assert display.axes_[0, 1].get_title() == "$P_n$ = 0.15, 8 runs"
    assert display.axes_[2, 0].get_ylabel() == "$b_{0}$"
    assert display.axes_[3, 0].get_xlabel() == "time, s"
    covers_nothing(display)


def test_batch_fits_stand_at_their_windows():
    table = paths()
    display = EnsembleDisplay.from_table(table)
    first, last = (display.batch_["b0", 0.15, form] for form in ("ini", "fin"))
    np.testing.assert_allclose(first.get_xdata(), [0, 30.72])
    np.testing.assert_allclose(last.get_xdata(), [51.2, TIME[-1]])
    np.testing.assert_allclose(last.get_ydata(), cell(table, "fin", 0.15)["b0"].mean())
    assert same_color(last.get_color(), ORANGE)
    short = EnsembleDisplay.from_table(table, batch_time=10.0)
    np.testing.assert_allclose(short.batch_["b0", 0.15, "ini"].get_xdata(), [0, 10])


def test_single_replications():
    table = paths((0.15,))
    display = EnsembleDisplay.from_table(table, n_singles=2)
    lines = list(display.singles_["b1", 0.15].values())
    assert len(lines) == 2
    second = cell(table, "lambda", 0.15).query("replication == 1")
    np.testing.assert_allclose(lines[1].get_ydata(), second["b1"])
    assert EnsembleDisplay.from_table(table, n_singles=0).singles_["b1", 0.15] == {}


def test_operator_parameters_without_values_and_wild():
    table = paths((0.0, 0.3))
    rows = table.index[(table["form"] == "lambda") & (table["remnant_intensity"] == 0.3)]
    table.loc[rows[::10], OPERATOR] = np.nan
    wild = rows[np.arange(len(rows)) % 101 == 3]
    table.loc[wild, "T_L"] = 1e6
    display = EnsembleDisplay.from_table(table, parameters="operator", truth=TRUTH)
    assert display.names_ == OPERATOR
    assert display.missing_["K_e", 0.3].get_text() == "10.2 % without value"
    assert ("K_e", 0.0) not in display.missing_
    low, high = display.axes_[1, 1].get_ylim()
    assert -1 < low < 0.4
    assert 1.2 < high < 5
    mean = display.lines_["T_L", 0.3].get_ydata()
    outside = np.sum((mean < low) | (mean > high))
    assert outside >= len(wild) - 2
    assert display.notes_["T_L", 0.3].get_text() == f"{outside} of {mean.size} outside"
    assert display.axes_[1, 0].get_ylim() == (low, high)
    assert display.axes_[3, 0].get_ylabel() == r"$\omega_{nm}$, rad/s"
    covers_nothing(display)
    calm = EnsembleDisplay.from_table(table, parameters="operator", average="median")
    assert ("T_L", 0.3) not in calm.notes_


def test_constant_truth_and_chosen_columns():
    truth = pd.DataFrame({"b0": [0.07]})
    both = pd.concat([paths(), paths(condition="C3")], ignore_index=True)
    display = EnsembleDisplay.from_table(
        both, condition="C3", parameters=["b0"], remnant_intensity=0.15, truth=truth
    )
    assert display.axes_.shape == (1, 1)
    line = display.truth_["b0", 0.15]
    np.testing.assert_allclose(line.get_xdata(), [0, TIME[-1]])
    np.testing.assert_allclose(line.get_ydata(), 0.07)
    assert display.title == r"C3, $\lambda$"
    covers_nothing(display)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"form": "none"}, "no row has form = none; the table has lambda, Lambda, ini, fin"),
        ({"form": "ini"}, "is a batch fit"),
        ({"condition": "C9"}, "no row has condition = C9"),
        ({"remnant_intensity": [0.15, 0.7]}, r"no row has remnant_intensity = 0\.7"),
        ({"parameters": "all"}, "parameters must be 'arx', 'operator' or a list"),
        ({"parameters": ["b7"]}, "no column 'b7'"),
        ({"average": "mode"}, "average must be one of 'mean', 'median'"),
    ],
)
def test_refusals(change, message):
    with pytest.raises(ValueError, match=message):
        EnsembleDisplay.from_table(paths(), **change)


def test_refuses_other_tables():
    table = paths((0.15,))
    with pytest.raises(ValueError, match="would mix condition = C4, C3"):
        EnsembleDisplay.from_table(pd.concat([table, paths((0.15,), condition="C3")]))
    with pytest.raises(ValueError, match="no columns of operator parameters"):
        EnsembleDisplay.from_table(table.drop(columns=OPERATOR), parameters="operator")
    with pytest.raises(ValueError, match="no column 'time'"):
        EnsembleDisplay.from_table(table.drop(columns="time"))
    with pytest.raises(ValueError, match="truth has none of the columns a1, a2, b0, b1"):
        EnsembleDisplay.from_table(table, truth=TRUTH[OPERATOR])
    with pytest.raises(TypeError, match="truth is a DataFrame"):
        EnsembleDisplay.from_table(table, truth=[1, 2])
