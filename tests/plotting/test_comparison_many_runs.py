"""Pictures of a comparison of many runs."""

import numpy as np
import pandas as pd

from skhoid.plotting import ResidualTimeDisplay

TESTS = pd.DataFrame(columns=["test", "signal", "exceeds", "where", "cost"])


def windows(run, ratio, exceeds=False):
    start = np.arange(4.0)
    return pd.DataFrame(
        {"run": run, "start": start, "stop": start + 1, "share": 1.0, "ratio": ratio}
    ).assign(exceeds=exceeds)


def drawn(ratios, raised=()):
    parts = [windows(f"r{k}", ratio, k in raised) for k, ratio in enumerate(ratios)]
    table = pd.concat([windows("all", 1.0), *parts], ignore_index=True)
    return ResidualTimeDisplay(by_time=table, tests=TESTS).plot()


def test_time_draws_a_band_and_the_worst_of_many_runs():
    ratios = np.random.default_rng(0).uniform(0.5, 1.5, (80, 4))
    ratios[4], ratios[70] = 3.0, 0.1  # the last holds less than chance
    display = drawn(ratios, raised=(4, 70))
    assert list(display.runs_) == ["r4"]
    (band,) = [c for c in display.axes_[1].collections if c.get_label() == "90 % of single runs"]
    outline = band.get_paths()[0].vertices
    first = outline[outline[:, 0] == 0.0, 1]
    limits = np.quantile(ratios[:, 0], [0.05, 0.95])
    np.testing.assert_allclose([first.min(), first.max()], limits)


def test_time_draws_a_line_for_each_of_some_runs():
    display = drawn(np.ones((50, 4)))
    assert list(display.runs_) == [f"r{k}" for k in range(50)]
    assert not display.axes_[1].collections
