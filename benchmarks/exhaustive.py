"""Whether a search that follows only what may become the best names what one of all effects does.

    pip install -e .
    python benchmarks/exhaustive.py --cases 60 --seed 0

Each case is short runs of a person with nothing hidden, one effect of the catalogue or two, with
some remnant, searched with ``exhaustive=True`` and without. Verdict and names have to be the same,
parameters within ``CLOSE`` of their standard errors. Seconds are those of the processor.
"""

from __future__ import annotations

import argparse
import time
import warnings
from contextlib import suppress
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Effects
from skhoid.effects.catalogue import CLASSES

CLOSE = 0.1  # standard errors


def draw_case(seed: int) -> tuple[list[str], Any, Any]:
    """Ids of what is hidden, and runs of a loop that a person can keep."""
    rng = np.random.default_rng(seed)
    count = rng.choice(3, p=(0.2, 0.5, 0.3))
    while True:
        hidden = []
        for i in rng.choice(len(CLASSES), size=count, replace=False):
            examples = CLASSES[i].examples
            hidden.append(CLASSES[i](**examples[rng.integers(len(examples))]))
        with suppress(ValueError):  # it does not apply here, or nobody can keep it stable
            X, y = make_tracking_runs(
                str(rng.choice(["C1", "C2"])),
                n_runs=3,
                duration=40.0,
                sampling_rate=50.0,
                remnant_intensity=float(rng.uniform(0.03, 0.25)),
                channels=["e", "x", "f_t"],
                effects=Effects.of(hidden) if hidden else None,
                random_state=seed,
            )
            return [effect.name for effect in hidden], X, y


def search(X: Any, y: Any, *, exhaustive: bool) -> tuple[EffectSearchCV, float]:
    """A fitted search, and the seconds it took."""
    begin = time.process_time()
    fitted = EffectSearchCV(OperatorRegressor(), exhaustive=exhaustive).fit(X, y)
    return fitted, time.process_time() - begin


def compare(one: EffectSearchCV, other: EffectSearchCV) -> tuple[bool, bool]:
    """Whether names and verdict are the same, and whether parameters are."""
    named = [(s.best_effects_, s.stand_ins_, s.verdict_) for s in (one, other)]
    found, expected = (s.best_estimator_.parameters_ for s in (one, other))
    if named[0] != named[1] or list(found.index) != list(expected.index):
        return named[0] == named[1], False
    off = (found["value"] - expected["value"]).abs()
    return True, bool((off <= CLOSE * expected["sd"].fillna(np.inf) + 1e-9).all())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=60, help="how many (default: 60)")
    parser.add_argument("--seed", type=int, default=0, help="of the first (default: 0)")
    options = parser.parse_args()
    same = alike = n = 0
    taken = np.zeros(2)
    for seed in range(options.seed, options.seed + options.cases):
        hidden, X, y = draw_case(seed)
        with warnings.catch_warnings(), threadpool_limits(1):
            warnings.simplefilter("ignore")
            (whole, slow), (brief, fast) = (search(X, y, exhaustive=way) for way in (True, False))
        named, measured = compare(brief, whole)
        same, alike, n = same + named, alike + measured, n + 1
        taken += slow, fast
        text = f"{whole.best_effects_} {whole.verdict_.name}"
        if not named:
            text += f" -> {brief.best_effects_} {brief.verdict_.name}"
        told = f"{slow:.1f} s, {fast:.1f} s{'' if named else '  OTHER'}"
        print(f"{seed}: {hidden}: {text}; {told}", flush=True)
    print(f"names and verdict: the same in {same} of {n}; parameters too in {alike}")
    print(f"exhaustive {taken[0]:.0f} s, else {taken[1]:.0f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
