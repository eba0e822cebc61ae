import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from support.plot_checks import covers_nothing

from skhoid.plotting import PALETTE, StudyBoxDisplay

pytestmark = pytest.mark.slow  # simulates studies

ORDERS = [1, 2, 3, 4, "nm"]
INTENSITIES = [0.0, 0.05, 0.15, 0.3]
BIASES = ["bias_a1", "bias_a2", "bias_b0", "bias_b1"]
CELLS = ["condition", "remnant_order", "remnant_intensity", "sampling_rate", "open_loop"]


def delays(n=15, conditions=("C1",), rates=(100.0,), loops=(False,), kinds=("fixed", "estimated")):
    """Delays and biases of a made-up study; those of the first order are ten times the others."""
    table = pd.MultiIndex.from_product(
        [conditions, ORDERS, INTENSITIES, rates, loops, range(n), kinds],
        names=[*CELLS, "replication", "delay"],
    ).to_frame(index=False)
    rng = np.random.default_rng(0)
    size = 0.02 * np.where(table["remnant_order"] == 1, 10, 1)
    estimated = table["delay"] == "estimated"
    spread = 6 * table["remnant_intensity"] * estimated * rng.normal(size=len(table))
    table["nk"] = (0.29 * table["sampling_rate"] + spread).round().astype(int)
    for name in BIASES:
        noise = 1 + 0.2 * rng.normal(size=len(table))
        table[name] = size * noise * table["remnant_intensity"] / 0.15
    table["vaf_validation"] = 100 * (1 - table["remnant_intensity"]) + 0.1 * estimated
    return table


def test_boxes_are_those_of_the_replications():
    table = delays(kinds=["estimated"])
    display = StudyBoxDisplay.from_table(table, "nk", reference=29)
    cell = (table["remnant_order"] == 2) & (table["remnant_intensity"] == 0.3)
    results = table.loc[cell, "nk"]
    box = display.boxes.query("remnant_order == 2 and remnant_intensity == 0.3").iloc[0]
    expected = np.percentile(results, [25, 50, 75])
    np.testing.assert_allclose(box[["q1", "median", "q3"]].astype(float), expected)
    assert box["n"] == 15
    artists = display.artists_[0][2]
    np.testing.assert_allclose(artists["medians"][-1].get_ydata(), expected[1])
    vertices = artists["boxes"][-1].get_path().vertices[:, 1]
    np.testing.assert_allclose([vertices.min(), vertices.max()], expected[[0, 2]])
    assert display.references_[0].get_ydata()[0] == 29
    assert display.ax_.get_ylabel() == "delay $n_k$, samples"
    assert display.ax_.get_xlabel() == "remnant intensity $P_n$"
    covers_nothing(display)


def test_biases_with_both_delays_share_rows():
    table = delays().query("remnant_intensity > 0.1")
    display = StudyBoxDisplay.from_table(table, BIASES, by="delay")
    assert display.axes_.shape == (4, 2)
    assert display.panels_[:2] == [
        {"value": "bias_a1", "delay": "fixed"},
        {"value": "bias_a1", "delay": "estimated"},
    ]
    titles = [panel.get_title() for panel in display.axes_[0]]
    assert titles == ["fixed $n_k^0$", "estimated $n_k^*$"]
    for left, right in display.axes_:
        assert left.get_ylim() == right.get_ylim()
    assert [line.get_ydata()[0] for line in display.references_] == [0] * 8
    covers_nothing(display)


def test_a_group_far_away_bends_the_axis_and_squeezes_nobody():
    display = StudyBoxDisplay.from_table(delays(kinds=["fixed"]), "bias_a1")
    panel = display.ax_
    assert panel.get_yscale() == "symlog"
    assert panel.get_ylabel().endswith("(log beyond ±0.1)")
    low, high = panel.get_ylim()
    others = display.boxes.query("remnant_order != 1")
    first = display.boxes.query("remnant_order == 1")
    assert high > first["high"].max()
    to_axes = panel.transData + panel.transAxes.inverted()
    (_, zero), (_, top) = to_axes.transform([[0, 0.0], [0, others["high"].max()]])
    assert top - zero > 0.2
    assert low < 0
    ticks = panel.get_yticks()
    assert ticks[-1] > 0.1
    assert ticks[-1] <= high
    straight = StudyBoxDisplay.from_table(delays(kinds=["fixed"]), "bias_a1", scale="linear")
    assert straight.ax_.get_yscale() == "linear"
    alike = delays(kinds=["fixed"]).query("remnant_order != 1")
    assert StudyBoxDisplay.from_table(alike, "bias_a1").ax_.get_yscale() == "linear"


def test_outliers_far_away_are_cut_and_counted():
    table = delays(kinds=["estimated"])
    table.loc[[3, 200], "nk"] = 5000
    display = StudyBoxDisplay.from_table(table, "nk")
    assert display.ax_.get_ylim()[1] < 60
    assert display.notes_[0].get_text() == f"2 of {len(table)} outside"


def test_two_columns_make_a_grid():
    table = delays(rates=(50.0, 100.0), loops=(False, True), kinds=["estimated"])
    by = ["sampling_rate", "open_loop"]
    display = StudyBoxDisplay.from_table(table, "nk", by=by, reference={50: 15, 100: 29})
    assert display.axes_.shape == (2, 2)
    assert [line.get_ydata()[0] for line in display.references_] == [15, 15, 29, 29]
    assert display.axes_[0, 0].get_ylabel() == "$f_s$ = 50 Hz\ndelay $n_k$, samples"
    assert [panel.get_title() for panel in display.axes_[0]] == ["closed loop", "open loop"]
    covers_nothing(display)


def test_difference_is_taken_in_each_replication():
    table = delays()
    display = StudyBoxDisplay.from_table(
        table, "vaf_validation", difference=("delay", "fixed", "estimated")
    )
    np.testing.assert_allclose(display.boxes["median"], -0.1)
    assert (display.boxes["n"] == 15).all()
    assert display.references_[0].get_ydata()[0] == 0
    label = "VAF of validation, points:\nfixed $n_k^0$ − estimated $n_k^*$"
    assert display.ax_.get_ylabel() == label


def test_equal_results_show_the_colour_of_their_group():
    table = delays(kinds=["estimated"]).assign(nk=29)
    display = StudyBoxDisplay.from_table(table, "nk")
    median = display.artists_[0][2]["medians"][0]
    np.testing.assert_allclose(median.get_color()[:3], to_rgb(PALETTE[1]))


def test_missing_results_and_other_cells():
    table = pd.DataFrame(
        {
            "subject": ["A", "A", "B", "B"] * 2,
            "display": ["pursuit"] * 4 + ["compensatory"] * 4,
            "replication": [0, 1] * 4,
            "K_e": [1.0, 2.0, np.nan, np.nan, 3.0, 4.0, 5.0, np.nan],
        }
    )
    display = StudyBoxDisplay.from_table(table, "K_e", group="subject", x="display")
    assert display.boxes["n"].tolist() == [2, 0, 2, 1]
    assert [len(drawn["boxes"]) for drawn in display.artists_[0].values()] == [2, 1]
    labels = [text.get_text() for text in display.figure_.legends[0].get_texts()]
    assert labels == ["subject A", "subject B"]
    assert [text.get_text() for text in display.ax_.get_xticklabels()] == [
        "pursuit",
        "compensatory",
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"value": "nk_star"}, r"no column 'nk_star'; it has condition, .*bias_b1"),
        ({"by": ()}, r"would mix delay = fixed, estimated: choose one, as table\[table"),
        ({"by": ["delay", "open_loop", "condition"]}, "at most two columns"),
        ({"by": "remnant_order"}, "different columns"),
        ({"scale": "log"}, "scale must be one of 'auto', 'linear', 'symlog'"),
        ({"by": (), "difference": ("delay", "none", "fixed")}, "no row has delay = none"),
    ],
)
def test_refusals(change, message):
    arguments = {"value": "nk", "by": "delay"} | change
    with pytest.raises(ValueError, match=message):
        StudyBoxDisplay.from_table(delays(), **arguments)


def test_refuses_mixed_cells_and_repeated_rows():
    apart = delays(conditions=("C1", "C2"))
    with pytest.raises(ValueError, match="would mix condition = C1, C2"):
        StudyBoxDisplay.from_table(apart, "nk", by="delay")
    # Also where no replication occurs twice.
    apart.loc[apart["condition"] == "C2", "replication"] += 1000
    with pytest.raises(ValueError, match="would mix condition = C1, C2"):
        StudyBoxDisplay.from_table(apart, "nk", by="delay")
    twice = pd.concat([delays(), delays()])
    with pytest.raises(ValueError, match="several rows of one replication"):
        StudyBoxDisplay.from_table(twice.drop(columns="nk"), BIASES, by="delay")
    with pytest.raises(TypeError, match="a DataFrame; got list"):
        StudyBoxDisplay.from_table([1, 2], "nk")
    with pytest.raises(ValueError, match="no rows"):
        StudyBoxDisplay.from_table(delays().iloc[:0], "nk")
