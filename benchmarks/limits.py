"""How often a weak effect is as small as its limit says, and one of `shown_from` is found.

    pip install -e .
    python benchmarks/limits.py --cases 20 --seed 0

Runs of C1 or C2 with one effect of known size, two or five of 41 s at 50 or 100 Hz, with a remnant
of 5 to 30 %. `limits_` of the same runs without the effect says what sizes are weak: shares of
`shown_from`, or of four times the limit where no size is shown. Counted is how often the true size
is within the limit that the runs with the effect give (wanted: 95 %), and how often a search for
that effect alone names it at the whole of `shown_from` (wanted: 90 %). A true size of nothing is
always within.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.stats import binomtest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import effect
from skhoid.exceptions import UnstableLoopError

# Choices, which the search is given too: the forms of an effect measure its size differently.
FORMS: dict[str, dict[str, Any]] = {
    "bias": {},
    "dead_zone": {"form": "gap", "at": "error"},
    "asym_gain": {"form": "all", "at": "error"},
    "cubic_gain": {"form": "cubic", "at": "error"},
    "saturation": {"form": "hard", "at": "output"},
    "backlash": {},
    "extra_lag": {},
    "feedforward": {"form": "rate"},
    "integral": {"form": "pure"},
    "gain_drift": {"form": "linear"},
}
OTHERS = {"feedforward": {"delay": 0.2}}  # numbers of what is hidden, which the search estimates
SHARES = (0.2, 0.5, 1.0)  # of the size that would be shown
LARGE = 4.0  # times the limit without it, where no size would be shown


def run_case(name: str, seed: int) -> list[dict[str, Any]]:
    """Sizes, limits, and whether what would be shown is found, of one case."""
    warnings.simplefilter("ignore")
    rng = np.random.default_rng([seed, *name.encode()])
    condition, n_runs = rng.choice(["C1", "C2"]), int(rng.choice([2, 5]))
    options = {
        "remnant_intensity": float(rng.choice([0.05, 0.15, 0.3])),
        "sampling_rate": float(rng.choice([50.0, 100.0])),
        "remnant_gain": "table",
        "duration": 40.96,
        "run_in": 20.0,
        "channels": ["e", "x", "f_t"],
    }

    def searched(size: float | None, number: int, most: int = 0) -> Any:
        """A search for the effect alone, in runs that have it with a size."""
        hidden = None
        if size is not None:
            hidden = template.with_choices(**OTHERS.get(name, {}), **{parameter: size})
        seeded = int(np.random.default_rng([seed, number, *name.encode()]).integers(2**31))
        X, y = make_tracking_runs(condition, n_runs, effects=hidden, random_state=seeded, **options)
        search = EffectSearchCV(OperatorRegressor(), effects=[template], max_effects=most)
        return search.fit(X, y)

    parameter, template = "", effect(name).with_choices(**FORMS[name])
    without = searched(None, 0).limits_.iloc[0]
    parameter, shown = str(without["parameter"]), float(without["shown_from"])
    from_below, is_shown = without["sense"] == "at least", np.isfinite(shown)
    if not is_shown:
        shown = float(without["limit"]) * (1 / LARGE if from_below else LARGE)
    if not np.isfinite(shown):
        return []
    rows = []
    for number, share in enumerate(SHARES, 1):
        size = shown / share if from_below else shown * share
        try:
            limit = float(searched(size, number).limits_.iloc[0]["limit"])
        except UnstableLoopError:  # nobody could track with it
            continue
        within = np.nan if np.isnan(limit) else (limit <= size if from_below else limit >= size)
        row = {"effect": name, "seed": seed, "share": share, "within": within, "found": np.nan}
        if share == 1.0 and is_shown:
            row["found"] = name in searched(size, number, 1).best_effects_
        rows.append({**row, "size": size, "limit": limit, "condition": condition, **options})
    return rows


def tell(counted: pd.Series) -> str:
    """A share with its counts and 95 % interval, of what is known."""
    counted = counted.dropna()
    if counted.empty:
        return "-"
    k, n = int(counted.sum()), len(counted)
    low, high = binomtest(k, n).proportion_ci(method="wilson")
    return f"{k} of {n} ({100 * k / n:.0f} %, {100 * low:.0f}-{100 * high:.0f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=20, help="of each effect")
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    parser.add_argument("--effects", default=",".join(FORMS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", help="CSV of all cases")
    options = parser.parse_args()
    jobs = [
        delayed(run_case)(name, seed)
        for name in options.effects.split(",")
        for seed in range(options.seed, options.seed + options.cases)
    ]
    rows = [row for case in Parallel(options.jobs)(jobs) for row in case]
    table = pd.DataFrame(rows)
    if options.out:
        table.to_csv(options.out, index=False)
    for name, cases in [*table.groupby("effect", sort=False), ("all", table)]:
        within, found = tell(cases["within"]), tell(cases["found"])
        print(f"{name:16} within the limit {within:34} found {found}")


if __name__ == "__main__":
    main()
