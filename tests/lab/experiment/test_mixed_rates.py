"""Error rates and coverage, by the benchmark at a reduced size."""

import runpy

import numpy as np
import pandas as pd
import pytest
from support.places import ROOT

from skhoid.lab.experiment.rows import select

BENCHMARK = runpy.run_path(str(ROOT / "benchmarks" / "people_statistics.py"))
WORLDS = BENCHMARK["WORLDS"]


@pytest.mark.parametrize("log", [False, True])
def test_draws_are_the_rows_that_the_table_gives(log):
    draw = WORLDS["all of these"].draw(np.random.default_rng(0), 0.1)
    rows, wanted = draw.rows(log), select(draw.table(), "K_e", transform="log" if log else None)
    for one, other in zip(rows.cells, wanted.cells, strict=True):
        np.testing.assert_allclose(one, other)
    assert rows.tau == pytest.approx(wanted.tau)
    assert rows.tau_cells == pytest.approx(wanted.tau_cells)
    np.testing.assert_array_equal(rows.cell, wanted.cell)


def test_experiments_are_put_together_from_a_pool():
    rng = np.random.default_rng(0)
    table = pd.DataFrame(
        {
            "subject": np.repeat(np.arange(15), 20),
            "parameter": "K_e",
            "estimate": rng.normal(3.0, 0.1, 300),
            "se": 0.1,
        }
    )
    draw = BENCHMARK["Pool"](table, "K_e").draw(rng, 0.5)
    assert np.unique(draw.person).size == 12
    assert np.unique(draw.condition).size == 4
    means = [draw.estimate[draw.condition == c].mean() for c in range(4)]
    np.testing.assert_allclose(means, [3.0, 3.5, 4.0, 4.5], atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["as planned", "large person x condition"])
def test_rates_are_as_wanted(name):
    """150 experiments: 4 standard errors of 5 % are 7 points; contrasts are six each."""
    world = WORLDS[name]
    found = [
        BENCHMARK["analysed"](world.draw(np.random.default_rng(seed), 0.0), np.full(4, 3.0), False)
        for seed in range(150)
    ]
    rates = 100.0 * pd.DataFrame(found).mean()
    for error in ("F", "Holm"):
        assert rates[error] < 12.0
    assert 1.0 < rates["contrast"] < 9.0
    assert 91.0 < rates["cover difference"] < 99.0
    assert 90.0 < rates["cover mean"] < 99.5
