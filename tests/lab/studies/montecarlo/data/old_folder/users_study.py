"""A user's module as it was when the folder beside it was made."""

import numpy as np

from skhoid import MonteCarloStudy

SCALE = 2.0


def power(y):
    return SCALE * (y**2).mean()


def percentile(p):
    def of_size(y):
        return np.percentile(abs(y), p)

    return of_size


def measured(digits):
    def form_and_power(data, form):
        found = {"value": round(form(data.y), digits), "power": power(data.y)}
        return found | {"drawn": data.random_state}

    return form_and_power


def study(**options):
    """A study with functions in its cells, so that its seeds hold what functions are."""
    return MonteCarloStudy(
        measured(12),
        {"form": [percentile(50), percentile(90)]},
        2,
        simulation={"duration": 5.12, "run_in": 2.0, "remnant_gain": 0.02},
        block_size=1,
        **{"random_state": 5} | options,
    )
