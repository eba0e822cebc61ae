"""The plots of a comparison show its tables, and say what is not available."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from scipy.stats import norm
from support.comparisons import altered
from support.pictures import KINDS as OF_DISPLAYS
from support.plot_checks import GREY, PURPLE, VERMILION

from skhoid import ARXRegressor, compare, make_tracking_runs
from skhoid.plotting import ComparisonDisplay
from skhoid.recordings import Finding

pytestmark = pytest.mark.slow

KINDS = OF_DISPLAYS["ComparisonDisplay"]
TABLES = [
    "by_run",
    "by_time",
    "by_frequency",
    "by_operating_point",
    "tests",
    "correlations",
    "time_frequency",
]


def drawn(found, kind, **members):
    """A picture of a comparison with other members."""
    comparison = altered(found, **members) if members else found
    return ComparisonDisplay(comparison=comparison, kind=kind).plot()


@pytest.fixture(autouse=True)
def nothing_left():
    yield
    plt.close("all")


def runs(n_runs):
    """Runs in the course of which controlled element and operator change, at 41 s."""
    return make_tracking_runs(
        "C4",
        n_runs=n_runs,
        remnant_intensity=0.15,
        channels=["e", "x", "f_t"],
        random_state=0,
    )


@pytest.fixture(scope="module")
def model():
    X, y = make_tracking_runs(
        "C1", n_runs=3, remnant_intensity=0.15, channels=["e", "x", "f_t"], random_state=1
    )
    return ARXRegressor(nk=29).fit(X, y)


@pytest.fixture(scope="module")
def estimation():
    return make_tracking_runs(
        "C1", n_runs=3, remnant_intensity=0.15, channels=["e", "x", "f_t"], random_state=1
    )


@pytest.fixture(scope="module")
def found(model, estimation):
    return compare(model, *runs(5), estimation=estimation)


@pytest.fixture(scope="module")
def of_one_run(model):
    return compare(model, *runs(1))


def marked(table, *rows):
    """A table of which just these rows exceed chance."""
    return table.assign(exceeds=np.isin(np.arange(len(table)), rows))


def texts(display):
    panels = np.atleast_1d(getattr(display, "axes_", getattr(display, "ax_", None)))
    return " ".join(text.get_text() for panel in panels for text in panel.texts)


def all_runs(table):
    return table[table["run"] == "all"]


def heights(bars):
    return [bar.get_height() for bar in bars]


def repeating(table, **by_window):
    """Windows of which it is known what repeats: nothing but as stated, {window: (points, p)}."""
    known = (table["run"] == "all").to_numpy()
    table = table.assign(
        explainable=np.where(known, 0.0, np.nan), p_explainable=np.where(known, 1.0, np.nan)
    )
    for window, (points, p) in by_window.items():
        at = table.index[int(window[1:])]
        table.loc[at, ["explainable", "p_explainable"]] = points, p
    return table


def of_all_alone(table):
    """Windows of which it is not known what repeats."""
    return table.drop(columns=["explainable", "p_explainable"])


def a_test(name, signal="residual", **columns):
    row = {
        "test": name,
        "signal": signal,
        "statistic": 9.0,
        "p": 1e-9,
        "exceeds": True,
        "where": 20.0,
        "size": 1.0,
        "cost": np.nan,
        "valid": True,
        "description": "",
    }
    return row | columns


def test_page_shows_the_worst_window_of_the_worst_run(found):
    display = found.plot()
    validation = found.by_run[found.by_run["data"] == "validation"]
    assert display.run_ == validation.set_index("run")["vaf"].idxmin()
    windows = found.by_time[found.by_time["run"] == display.run_]
    worst = windows.loc[windows["rmse"].idxmax()]
    trace = found.traces.loc[int(display.run_)]
    for name in ("measured", "simulated"):
        line = display.lines_[name]
        time = line.get_xdata()
        assert time[0] <= worst["start"]
        assert time[-1] >= worst["stop"] - 0.02
        column = {"measured": "measured", "simulated": "predicted"}[name]
        np.testing.assert_array_equal(line.get_ydata(), trace.loc[time[0] : time[-1], column])


@pytest.mark.parametrize(
    ("failing", "fails"), [([], False), ([7], True), ([0, 6], False), (range(16), True)]
)
def test_page_shades_the_worst_window_red_if_misfit_repeats_in_it(found, failing, fails):
    table = found.by_time.assign(exceeds=True)  # remnant of the run shown does not count
    table.loc[(table["run"] == "2") & (table["start"] == table["start"][7]), "rmse"] = 99.0
    runs = found.by_run.assign(vaf=np.where(found.by_run["run"] == "2", -99.0, 0.0))
    windows = {f"w{i}": (1.0, 1e-9) for i in failing}
    display = drawn(found, "overview", by_run=runs, by_time=repeating(table, **windows))
    red = [p for p in display.axes_[0].patches if same_color(p.get_facecolor()[:3], VERMILION)]
    assert [p.get_x() for p in red] == ([table["start"][7]] if fails else [])
    assert any("worst" in text.get_text() for text in display.axes_[0].texts)


@pytest.mark.parametrize("fails", [True, False])
def test_page_of_runs_that_do_not_repeat_shades_a_worst_window_beyond_chance(found, fails):
    table = of_all_alone(found.by_time)
    table = table.assign(exceeds=(table["run"] != "all") & (table["ratio"] > 1) & fails)
    display = drawn(found, "overview", by_time=table)
    red = [p for p in display.axes_[0].patches if same_color(p.get_facecolor()[:3], VERMILION)]
    assert len(red) == fails


def test_page_says_how_good_and_what_first(found):
    first = Finding("gain", "The gain is 50 % too low.", "p < 0.001", "", "")
    display = drawn(found, "overview", findings=[first])
    title = display.figure_.get_suptitle()
    assert f"VAF {found.vaf:.1f} %" in title
    assert f"noise ceiling at least {found.noise_ceiling:.1f} %" in title
    assert f"{found.explainable_gap:.1f} points" in title
    assert display.axes_[0].get_title() == first.title
    untold = drawn(found, "overview", findings=[])
    assert untold.figure_.get_suptitle() == title
    assert untold.axes_[0].get_title() == ""


def amplitude_of_page(found, tests):
    """What the page shows of amplitude, where the mean residual is largest over x."""
    table = found.by_operating_point
    x = table["channel"] == "x"
    table = table.assign(mean=table["mean"].where(~x, 50 * table["band"]), valid=True)
    display = drawn(found, "overview", by_operating_point=table, tests=tests)
    return display.axes_[3].get_xlabel()


def test_page_takes_the_channel_of_the_strongest_test_of_shape(found):
    tests = pd.DataFrame(
        [
            a_test("nonlinearity", "e", statistic=20.0),
            a_test("asymmetry", "f_t", statistic=30.0),
            a_test("nonlinearity", "x", statistic=90.0, exceeds=False),
            a_test("nonlinearity", "force", statistic=90.0),  # has no bins
            a_test("nonlinearity", "u", statistic=np.nan),
            a_test("cross-correlation", "x", statistic=90.0),
        ]
    )
    assert "target" in amplitude_of_page(found, tests)
    assert "error" in amplitude_of_page(found, tests.drop(index=1))


def test_page_takes_the_channel_furthest_outside_its_band_where_no_test_exceeds(found):
    assert "output x" in amplitude_of_page(found, found.tests.assign(exceeds=False))
    assert "output x" in amplitude_of_page(found, found.tests.iloc[:0])


def test_bar_adds_up(found):
    display = found.plot("ceiling")
    explained, misfit, remnant = (bar.get_width() for bar in display.ax_.patches)
    assert explained == pytest.approx(found.vaf)
    assert misfit == pytest.approx(found.explainable_gap)
    assert remnant == pytest.approx(100 - found.noise_ceiling)
    (arrow,) = (text for text in display.ax_.texts if text.get_text() == "")
    assert arrow.xy[0] == pytest.approx(found.noise_ceiling)
    assert arrow.xyann[0] > 0  # a lower bound: to the right is more
    assert found.ceiling_note in display.ax_.get_xlabel().replace("\n", " ")


def bars_of(display):
    """Heights and colours of the bars over time, and of the misfit in them."""
    bars, *misfit = display.ax_.containers
    colours = [container[0].get_facecolor() for container in display.ax_.containers]
    return heights(bars), [heights(container) for container in misfit], colours


def test_time_shows_shares_and_ratios(found):
    table = found.by_time.assign(chance_low=0.8, chance_high=1.3)
    display = drawn(found, "time", by_time=table, tests=found.tests)
    together = all_runs(table)
    shares, _, _ = bars_of(display)
    np.testing.assert_allclose(shares, together["share"])
    assert sum(shares) == pytest.approx(100 - found.vaf)
    assert list(display.lines_) == [*"01234", "all"]
    third = table[table["run"] == "2"]
    np.testing.assert_array_equal(display.lines_["2"].get_ydata()[::2], third["ratio"])
    np.testing.assert_array_equal(display.lines_["all"].get_ydata()[1::2], together["ratio"])
    vertices = display.axes_[1].collections[0].get_paths()[0].vertices
    assert (vertices[:, 1].min(), vertices[:, 1].max()) == (0.8, 1.3)


def test_time_is_red_where_what_repeats_is_beyond_chance(found):
    share = found.by_time["share"]
    table = repeating(
        found.by_time.assign(exceeds=True),  # remnant may grow
        w2=(share[2] / 2, 1e-4),
        w5=(share[5] / 2, 0.5),
        w9=(2 * share[9], 1e-9),  # an estimate; the bar is not exceeded
    )
    display = drawn(found, "time", by_time=table, tests=found.tests)
    _, (misfit,), colours = bars_of(display)
    assert same_color(colours[0], GREY)
    assert same_color(colours[1], VERMILION)
    expected = np.zeros(len(misfit))
    expected[[2, 9]] = share[2] / 2, share[9]
    np.testing.assert_allclose(misfit, expected)
    # Nor is the remnant of single runs red.
    assert not any(same_color(line.get_color(), VERMILION) for line in display.axes_[1].lines)


def test_time_is_not_red_where_nothing_repeats(found):
    table = repeating(found.by_time.assign(exceeds=True))
    _, misfit, colours = bars_of(drawn(found, "time", by_time=table, tests=found.tests))
    assert misfit == []
    assert same_color(colours[0], PURPLE)


def test_time_of_runs_that_do_not_repeat_is_red_where_more_is_lost(found):
    table = marked(found.by_time, 3, 12)
    assert (table["ratio"].iloc[[3, 12]] > 1).tolist() == [False, True]
    display = drawn(found, "time", by_time=of_all_alone(table), tests=found.tests)
    _, (misfit,), _ = bars_of(display)
    assert np.flatnonzero(misfit).tolist() == [12]
    assert misfit[12] == table["share"][12]


def changes_of(display):
    labels = [line.get_label() for line in display.axes_[1].lines]
    return [label for label in labels if "change, " in label]


def test_time_marks_changes_that_exceed_chance_and_cost_something(found):
    changes = dict(label.removesuffix(" s").split(", ") for label in changes_of(found.plot("time")))
    assert float(changes["remnant power change"]) == pytest.approx(41.0, abs=2.0)
    tests = pd.DataFrame(
        [
            a_test("gain change", cost=0.049),
            a_test("delay change", cost=0.051, where=30.0),
            a_test("remnant power change", where=40.0),  # no model wins it back: it has no cost
            a_test("mean change", where=np.nan),
            a_test("lag", where=50.0),
        ]
    )
    display = drawn(found, "time", by_time=found.by_time, tests=tests)
    assert changes_of(display) == ["delay change, 30.0 s", "remnant power change, 40.0 s"]


def test_time_of_one_run_has_no_thin_lines(of_one_run):
    assert list(of_one_run.plot("time").lines_) == ["all"]


def red_marks(panel):
    """Marks of what exceeds chance, in the colour of misfit or ringed in it."""
    lines = [line for line in panel.lines if line.get_linestyle() == "None"]
    red = [line for line in lines if same_color(line.get_markeredgecolor(), VERMILION)]
    return np.concatenate([line.get_xydata() for line in red] or [np.empty((0, 2))])


def test_frequency_shows_spectra_and_responses(found):
    table = marked(found.by_frequency, 4)
    display = drawn(found, "frequency", by_frequency=table)
    excited = table[table["kind"] == "excited"]
    for name in ("output", "residual"):
        line = display.lines_[f"{name} lines"]
        np.testing.assert_array_equal(line.get_xdata(), excited["omega"])
        np.testing.assert_array_equal(line.get_ydata(), excited[f"psd_{name}"])
    np.testing.assert_array_equal(red_marks(display.ax_)[:, 0], table["omega"][4:5])
    for name in ("measured", "model"):
        gain = display.lines_[f"{name} gain"].get_ydata()
        np.testing.assert_array_equal(gain, excited[f"{name}_gain"])
    intervals = display.axes_[1].collections[0].get_segments()
    factor = np.exp(norm.ppf(0.975) * excited["sd_gain"] / excited["measured_gain"])
    upper = [segment[:, 1].max() for segment in intervals]
    np.testing.assert_allclose(upper, excited["measured_gain"] * factor)


def test_frequency_without_a_target():
    X, y = runs(2)
    found = compare(ARXRegressor(nk=29).fit(X[["e"]], y), X[["e"]], y)
    display = found.plot("frequency")
    assert "model gain" not in display.lines_
    assert "not available" in texts(display)
    assert display.lines_["residual"].get_xdata().size > 0


def test_operating_points(found):
    table = marked(found.by_operating_point, 0, 5).assign(valid=True)
    display = drawn(found, "amplitude", by_operating_point=table)
    assert list(display.lines_) == list(dict.fromkeys(table["channel"]))
    for (name, line), panel in zip(display.lines_.items(), display.axes_, strict=True):
        bins = table[table["channel"] == name]
        np.testing.assert_array_equal(line.get_xdata(), bins["center"])
        np.testing.assert_array_equal(line.get_ydata(), bins["mean"])
        vertices = panel.collections[0].get_paths()[0].vertices
        assert vertices[:, 1].max() == pytest.approx(bins["band"].max())
        assert len(red_marks(panel)) == bins["exceeds"].sum()
    named = dict(zip(display.lines_, (p.get_xlabel() for p in display.axes_), strict=True))
    assert named["u"] == "simulated u, deg"  # not the measured one, which holds the residual
    assert "simulated" not in named["e"] + named["x"] + named["f_t"]


def test_levels_held_are_marked_in_the_panel_of_the_output(found):
    tests = pd.DataFrame(
        [
            a_test("level", "u", where=-0.15),
            a_test("level", "u", where=0.15),
            a_test("level", "u", where=np.nan),
            a_test("level", "u", where=0.3, exceeds=False),
            a_test("level", "force", where=0.4),
            a_test("outlier", "u", where=0.5),
        ]
    )
    table = found.by_operating_point
    display = drawn(found, "amplitude", by_operating_point=table, tests=tests)
    for name, panel in zip(display.lines_, display.axes_, strict=True):
        dashed = [line for line in panel.lines if line.get_linestyle() == "--"]
        levels = [-0.15, 0.15] if name == "u" else []
        assert [line.get_xdata()[0] for line in dashed] == levels


def test_what_is_no_test_is_said_and_not_red(found):
    points = found.by_operating_point.assign(exceeds=True, valid=False)
    correlations = found.correlations.assign(correlation=0.9, valid=False)
    for display in (
        drawn(found, "amplitude", by_operating_point=points),
        drawn(found, "correlation", correlations=correlations),
    ):
        for panel in display.axes_:
            title = panel.get_title() + panel.get_title(loc="left")
            assert "closed loop: not a test" in title
            assert not any(same_color(line.get_color(), VERMILION) for line in panel.lines)


def test_correlations(found):
    display = found.plot("correlation")
    for name, line in display.lines_.items():
        table = found.correlations[found.correlations["signal"] == name]
        np.testing.assert_array_equal(line.get_xdata(), table["lag"])
        np.testing.assert_array_equal(line.get_ydata(), table["correlation"])
    table = found.correlations.assign(correlation=0.0, band=0.1, valid=True)
    table.loc[table.index[7], "correlation"] = -0.2
    (panel, *_) = drawn(found, "correlation", correlations=table).axes_
    (red,) = (line for line in panel.lines if same_color(line.get_color(), VERMILION))
    np.testing.assert_array_equal(red.get_xydata(), [[table["lag"].iloc[7], -0.2]])


def test_map_is_in_decibels(found):
    mesh = found.plot("map").ax_.collections[0]
    ratio = found.time_frequency.loc[:, found.time_frequency.columns > 0]
    expected = 10 * np.log10(ratio.to_numpy().T)
    np.testing.assert_allclose(np.ma.filled(mesh.get_array(), np.nan), expected)
    low, high = mesh.get_clim()
    assert low == -high


def test_runs_and_their_ceiling(found):
    display = drawn(found, "runs", by_run=marked(found.by_run, 1))
    for name, line in display.lines_.items():
        expected = found.by_run.loc[found.by_run["data"] == name, "vaf"]
        np.testing.assert_array_equal(line.get_ydata(), expected)
    assert list(display.lines_) == ["validation", "estimation"]
    assert red_marks(display.ax_)[:, 1].tolist() == [found.by_run["vaf"][1]]
    drawn_ceiling = [line for line in display.ax_.lines if "ceiling" in line.get_label()]
    np.testing.assert_array_equal(drawn_ceiling[0].get_ydata(), [found.noise_ceiling] * 2)
    assert display.ax_.get_title() == "Beyond chance: run 1"


def test_a_lost_run_is_named_at_the_edge(found):
    table = found.by_run.copy()
    table.loc[0, "vaf"] = -312.0
    display = drawn(found, "runs", by_run=table)
    assert "-312 %" in texts(display)
    assert display.ax_.get_ylim()[0] > -50


def test_labels_of_outer_levels(model):
    X, y = runs(2)
    labels = pd.MultiIndex.from_tuples(
        [("S1", run, time) for run, time in X.index], names=["subject", "run", "time"]
    )
    found = compare(model, X.set_axis(labels), y.set_axis(labels))
    runs_display = found.plot("runs")
    assert [t.get_text() for t in runs_display.ax_.get_xticklabels()] == ["S1/0", "S1/1"]
    page = found.plot()
    assert page.run_ in ["S1/0", "S1/1"]
    assert list(found.plot("time").lines_) == ["S1/0", "S1/1", "all"]


@pytest.mark.parametrize("kind", KINDS)
def test_empty_tables_are_said(kind, found):
    empty = {name: getattr(found, name).iloc[:0] for name in TABLES}
    none = {"noise_ceiling": np.nan, "noise_ceiling_interval": (np.nan, np.nan)}
    display = drawn(found, kind, **empty, **none, explainable_gap=np.nan, findings=[])
    if kind != "ceiling":
        assert "not available" in texts(display)
    display.figure_.canvas.draw()


@pytest.mark.parametrize("kind", ["overview", "amplitude", "runs"])
def test_tables_of_nan_are_drawn(kind, found):
    lost = {}
    for name in TABLES[:-1]:
        table = getattr(found, name)
        unknown = table.select_dtypes("floating").columns.difference(
            ["omega", "start", "stop", "lag", "low", "high", "center"]
        )
        lost[name] = table.assign(**dict.fromkeys(unknown, np.nan))
    lost["time_frequency"] = found.time_frequency * np.nan
    drawn(found, kind, **lost).figure_.canvas.draw()


def test_anything_but_a_comparison_is_refused(model):
    with pytest.raises(TypeError, match="got ARXRegressor"):
        ComparisonDisplay.from_comparison(model)
    with pytest.raises(ValueError, match="kind must be one of 'overview', 'ceiling'"):
        drawn(None, "frequencies")


def test_from_estimator_compares_first(model, estimation):
    display = ComparisonDisplay.from_estimator(model, *runs(2), "runs", estimation=estimation)
    assert len(display.lines_["estimation"].get_ydata()) == 3
    assert len(display.lines_["validation"].get_ydata()) == 2
