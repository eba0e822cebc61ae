"""Tidy tables of parameters for the tests of statistics."""

import numpy as np
import pandas as pd


def simulated(
    seed=0, people=12, conditions=4, runs=5, effect=0.3, interaction=0.05, missing=0.1, mean=3.0
):
    """One parameter of several people; the second last person lacks the last condition."""
    rng = np.random.default_rng(seed)
    rows = []
    for p in range(people):
        person, error = mean + 0.3 * rng.normal(), 0.05 * rng.uniform(1.0, 5.0)
        for c in range(conditions):
            here = person + effect * c + interaction * rng.normal()
            for r in range(runs):
                estimate = here + error * rng.normal()
                gone = runs > 1 and (rng.random() < missing or (p, c) == (people - 2, 3))
                if not (missing and gone):
                    rows.append((f"S{p + 1}", f"C{c + 1}", str(r + 1), "K_e", estimate, error))
    names = ["subject", "condition", "run", "parameter", "estimate", "se"]
    table = pd.DataFrame(rows, columns=names)
    return table.assign(
        unit="deg/deg", vaf=80.0, ceiling=90.0, n_rows=8192, outlying="", failure=""
    )
