import numpy as np
import pandas as pd
import pytest
from support.plot_checks import covers_nothing

from skhoid.plotting import MemoryHorizonDisplay

INF = float("inf")
HORIZONS = [*(2.0 ** np.arange(1, 14)), INF]
INTENSITIES = (0.0, 0.15, 0.3)
CONDITIONS = ("C1", "C2", "C3", "C4", "C5", "C6")
N = 3
LABELS_OF = ("validation", "estimation")


def forgetting(conditions=CONDITIONS, horizons=HORIZONS, forms=("lambda", "Lambda")):
    """A made-up study: short horizons collapse with remnant, long ones lag where C3-C6 change."""
    table = pd.MultiIndex.from_product(
        [conditions, INTENSITIES, range(N), forms, horizons],
        names=["condition", "remnant_intensity", "replication", "form", "memory_horizon"],
    ).to_frame(index=False)
    P_n, N0 = table["remnant_intensity"], table["memory_horizon"]
    noise = 800 * P_n / N0
    varies = ~table["condition"].isin(["C1", "C2"])
    lag = 15 * varies / (1 + 1000 / N0)
    own = 0.5 * (table["replication"] - 1)
    table["vaf_validation"] = (100 * (1 - P_n) - noise - lag + own).clip(0, None)
    table["vaf_estimation"] = (100 * (1 - P_n) + noise / 4 - lag + own).clip(None, 100)
    return table


def mean_of(table, condition, form, P_n, column):
    rows = table[
        (table["condition"] == condition)
        & (table["form"] == form)
        & (table["remnant_intensity"] == P_n)
    ]
    return rows.groupby("memory_horizon")[column].mean().to_numpy()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gain", "overfit_difference"])
def test_lines_are_the_means_of_the_replications(kind):
    table = forgetting(("C1", "C4"))
    display = MemoryHorizonDisplay.from_table(table, kind=kind)
    cell = ("C4", "Lambda", 0.15)
    validation, estimation = (mean_of(table, *cell, f"vaf_{of}") for of in LABELS_OF)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = {
            "gain": validation - validation[-1],
            "vaf_validation": validation,
            "vaf_estimation": estimation,
            "overfit_difference": estimation - validation,
            "overfit_ratio": np.where(validation > 0, estimation / validation, np.nan),
            "tradeoff_ratio": validation / validation[-1],
        }[kind]
    key = r"C4, $\Lambda$", "$P_n$ = 0.15"
    line = display.lines_[key]
    np.testing.assert_allclose(line.get_ydata(), expected)
    np.testing.assert_array_equal(line.get_xdata(), [*HORIZONS[:-1], display.infinite_])
    mark = display.best_[key]
    best = validation.argmax()
    assert mark.get_xdata()[0] == line.get_xdata()[best]
    assert mark.get_ydata()[0] == line.get_ydata()[best]
    assert (display.results["n"] == N).all()


@pytest.mark.slow
def test_six_conditions_in_the_order_of_the_thesis():
    display = MemoryHorizonDisplay.from_table(forgetting())
    assert display.axes_.shape == (12,)
    assert display.ax_.get_title() == r"C1, $\lambda$"
    assert display.axes_[-1].get_title() == r"C6, $\Lambda$"
    for one, other in display.axes_.reshape(6, 2):
        assert one.get_ylim() == other.get_ylim()
    covers_nothing(display)


def test_best_of_all_cells_is_a_vertical_line():
    table = forgetting(("C3", "C4"))
    better = (table["form"] == "Lambda") & (table["memory_horizon"] == 64)
    table.loc[better, "vaf_validation"] += 10
    display = MemoryHorizonDisplay.from_table(table)
    means = table[table["form"] == "lambda"].groupby("memory_horizon")["vaf_validation"].mean()
    assert display.best_overall == {"lambda": means.idxmax(), "Lambda": 64}
    for form, panel in zip(["lambda", "Lambda"] * 2, display.axes_, strict=True):
        (dashed,) = [line for line in panel.lines if line.get_linestyle() == "--"]
        assert dashed.get_xdata()[0] == display.best_overall[form]
    (legend,) = display.figure_.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels[:3] == ["$P_n$ = 0", "$P_n$ = 0.15", "$P_n$ = 0.3"]
    expected = rf"best of all cells: $N_0$ = {means.idxmax():g} ($\lambda$), 64 ($\Lambda$)"
    assert labels[-1] == expected


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gain", "overfit_difference"])
def test_collapse_does_not_squeeze_the_rest(kind):
    display = MemoryHorizonDisplay.from_table(forgetting(("C1", "C4")), kind=kind)
    for panel, note in zip(display.axes_, display.notes_.values(), strict=True):
        low, high = panel.get_ylim()
        assert high - low < 40
        values = np.concatenate(
            [line.get_ydata() for line in display.lines_.values() if line.axes is panel]
        )
        outside = np.sum((values < low) | (values > high))
        assert outside > 0
        assert note.get_text() == f"{outside} of {values.size} outside"
    for mark in display.best_.values():
        low, high = mark.axes.get_ylim()
        assert low < mark.get_ydata()[0] < high
    covers_nothing(display)


def test_without_an_infinite_horizon():
    table = forgetting(("C4",), [64, 256, 1024])
    display = MemoryHorizonDisplay.from_table(table, kind="vaf_validation")
    assert np.isfinite(list(display.best_overall.values())).all()
    with pytest.raises(ValueError, match="no value of 'gain'"):
        MemoryHorizonDisplay.from_table(table)


def test_refusals():
    table = forgetting(("C4",), [64, INF])
    with pytest.raises(ValueError, match="kind must be one of 'gain', 'vaf_validation'"):
        MemoryHorizonDisplay.from_table(table, kind="loss")
    with pytest.raises(ValueError, match="no column 'vaf_estimation'; it has condition"):
        MemoryHorizonDisplay.from_table(table.drop(columns="vaf_estimation"))
    with pytest.raises(ValueError, match="several rows of one replication"):
        MemoryHorizonDisplay.from_table(pd.concat([table, table]))
    rates = pd.concat([table.assign(sampling_rate=rate) for rate in (50.0, 100.0)])
    rates = rates[["sampling_rate", *table.columns]]
    with pytest.raises(ValueError, match=r"would mix sampling_rate = 50\.0, 100\.0"):
        MemoryHorizonDisplay.from_table(rates)
