"""Box plots and responses of studies."""

import numpy as np
import pandas as pd
import pytest
from support.pictures import legend_texts
from support.plot_checks import covers_nothing

from skhoid import HumanOperator
from skhoid.plotting import StudyBoxDisplay, StudyResponseDisplay

BIASES = ["bias_a1", "bias_b0"]


def delays(n=12, **columns):
    """A made-up study of delays: first-order remnant makes the bias twenty times as large."""
    rng = np.random.default_rng(0)
    table = pd.MultiIndex.from_product(
        [["C1"], ["1", "2", "nm"], [0.0, 0.15], ["fixed", "estimated"], range(n)],
        names=["condition", "remnant_order", "remnant_intensity", "delay", "replication"],
    ).to_frame(index=False)
    noise = table["remnant_intensity"] * rng.standard_normal(len(table))
    table["nk"] = 29 + np.where(table["delay"] == "fixed", 0, np.rint(20 * noise))
    far = np.where(table["remnant_order"] == "1", 20.0, 1.0)
    return table.assign(**dict.fromkeys(BIASES, far * noise), vaf_validation=80 + noise, **columns)


def medians(drawn):
    return [line.get_ydata()[0] for line in drawn["medians"]]


def test_boxes_are_those_of_the_replications():
    table = delays()
    table = table[table["delay"] == "estimated"]
    display = StudyBoxDisplay.from_table(table, "nk", reference=29)
    (artists,) = display.artists_
    for group, drawn in artists.items():
        of_group = table[table["remnant_order"] == group]
        expected = of_group.groupby("remnant_intensity")["nk"].median()
        np.testing.assert_array_equal(medians(drawn), expected)
    assert legend_texts(display) == [
        "$H_n^{1}$",
        "$H_n^{2}$",
        "$H_n^{nm}$",
        "true delay $n_k^0$",
    ]
    covers_nothing(display)


def test_a_group_far_away_bends_the_axis():
    display = StudyBoxDisplay.from_table(delays(), BIASES, by="delay")
    assert display.axes_.shape == (2, 2)
    assert display.ax_.get_yscale() == "symlog"
    assert "log beyond" in display.ax_.get_ylabel()
    assert display.axes_[0, 1].get_title() == "estimated $n_k^*$"
    table = delays()
    near = StudyBoxDisplay.from_table(table[table["remnant_order"] != "1"], BIASES[0], by="delay")
    assert near.ax_.get_yscale() == "linear"
    covers_nothing(display)


def test_difference_is_taken_in_each_replication():
    display = StudyBoxDisplay.from_table(
        delays(), "vaf_validation", difference=("delay", "fixed", "estimated")
    )
    table = delays().set_index(["remnant_order", "remnant_intensity", "replication"])
    sides = [table.loc[table["delay"] == d, "vaf_validation"] for d in ("fixed", "estimated")]
    expected = (sides[0] - sides[1]).groupby(level=[0, 1]).median()
    np.testing.assert_allclose(medians(display.artists_[0]["2"]), expected["2"])
    label = "VAF of validation, points:\nfixed $n_k^0$ − estimated $n_k^*$"
    assert display.ax_.get_ylabel() == label


def test_what_would_be_mixed_is_refused():
    with pytest.raises(ValueError, match="several rows of one"):
        StudyBoxDisplay.from_table(delays(), "nk")
    with pytest.raises(ValueError, match="no column 'vaf'"):
        StudyBoxDisplay.from_table(delays(), "vaf", by="delay")
    with pytest.raises(ValueError, match="no rows"):
        StudyBoxDisplay.from_table(delays().iloc[:0], "nk", by="delay")


def responses(**columns):
    omega = np.array([0.3, 1.0, 3.0, 9.0, 17.0])
    true = HumanOperator().frequency_response(omega)
    index = pd.MultiIndex.from_product(
        [["C1"], [0.15, 0.3], ["batch", "fc"], omega],
        names=["condition", "remnant_intensity", "method", "omega"],
    )
    H = np.tile(true, 4)
    values = {"magnitude": np.abs(H), "phase": np.degrees(np.angle(H)), "phase_sd": 5.0}
    values |= {"magnitude_sd": 0.1 * np.abs(H), "relative_sd": 0.2}
    values |= {"stated_magnitude_sd": 0.05 * np.abs(H), "stated_phase_sd": np.nan} | columns
    return pd.DataFrame(values, index=index)


def test_responses_by_method_with_their_deviations():
    operator = HumanOperator()
    display = StudyResponseDisplay.from_summary(responses(), truth=operator.frequency_response)
    assert display.axes_.shape == (4, 2)
    titles = [panel.get_title() for panel in display.axes_[0]]
    assert titles == ["Fourier coefficients", "batch ARX"]
    omega = responses().index.get_level_values("omega")[:5].to_numpy()
    line = display.means_["magnitude", "fc", 0.15]
    np.testing.assert_allclose(
        line.get_ydata().astype(float), np.abs(operator.frequency_response(omega))
    )
    fine = display.axes_[1, 0].lines[0]
    expected = np.interp(np.log(omega), np.log(fine.get_xdata()), fine.get_ydata())
    phases = display.means_["phase", "fc", 0.15].get_ydata().astype(float)
    np.testing.assert_allclose(phases, expected, atol=3.0)  # in the turn of the truth
    found = {line.get_label(): line.get_ydata() for line in display.axes_[2, 0].lines}
    np.testing.assert_allclose(found["± 1 sd over replications"], 10.0)
    np.testing.assert_allclose(found["total sd, Eq. H.7"], 20.0)
    np.testing.assert_allclose(found["sd stated, Eqs. H.9-H.10"], 5.0)
    covers_nothing(display)
    both = pd.concat([responses(), responses().rename({"C1": "C2"}, level=0)])
    with pytest.raises(ValueError, match="draws one condition"):
        StudyResponseDisplay.from_summary(both)
