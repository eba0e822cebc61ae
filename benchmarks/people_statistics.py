"""Error rates, coverage and power of the statistics of experiments with people.

    pip install -e ".[statistics]"
    python benchmarks/people_statistics.py [--experiments 2000] [--jobs 2] [--only NAME ...]
    python benchmarks/people_statistics.py --pool identified.parquet [--log]

Experiments of 12 people, 4 conditions and 5 runs are made at the level of the table of estimates:
people's true parameters are drawn, their standard errors differ by a factor of up to 5, one person
has bad data (standard errors three times as large), 10 % of the runs are missing. In each world
half of the experiments have no effect, and half one that an analysis of variance of run means finds
about every second time. With --pool, experiments are put together from really identified runs
without any effect: people are drawn, and the runs of each permuted over the conditions; an effect
scales the estimates of conditions.

Wanted, in percent: errors 4 to 6, coverage 93 to 97, and 10 points more power than the analysis
of variance. Two standard errors of a rate of 5 % from 2,000 experiments are 1.0. What is missed by
more than that is listed; exits with 1 if an error rate is too high or a coverage too low. Too few
errors cost power only, which stands beside them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import stats

from skhoid.lab.experiment.mixed import fit_cells, holm, list_pairs
from skhoid.lab.experiment.repeated import sphericity
from skhoid.lab.experiment.rows import Cells, combine

PEOPLE, CONDITIONS, RUNS = 12, 4, 5
MEAN, SPREAD, ERROR = 3.0, 0.3, 0.06  # mean and sd of people, smallest standard error
WORST = 5.0  # times as large
BAD = 3.0  # times, the standard errors of one person
MISSING = 0.1
ALPHA = 0.05
PILOT = 400  # experiments from which an effect is found
Make = Callable[[np.random.Generator, float], "Draw"]


@dataclass(frozen=True)
class World:
    """How experiments are made.

    ``interaction`` is the sd of person x condition, ``beyond`` that of runs beyond their standard
    errors, ``noisy`` the relative sd of standard errors themselves, ``heavy`` whether people have
    the tails of t with 3 degrees of freedom, ``hidden`` whether the bad person's standard errors
    do not tell, ``uneven`` how much larger the interaction is in the last condition.
    """

    interaction: float = 0.05
    beyond: float = 0.0
    noisy: float = 0.0
    heavy: bool = False
    hidden: bool = False
    uneven: float = 1.0
    runs: int = RUNS
    people: int = PEOPLE

    def draw(self, rng: np.random.Generator, effect: float) -> Draw:
        """One experiment; the mean rises evenly from the first to the last condition."""
        shape = self.people, CONDITIONS, self.runs
        error = ERROR * WORST ** rng.uniform(size=self.people)
        error[0] *= BAD
        told = error.copy()
        if self.hidden:
            told[0] /= BAD
        sd = self.interaction * np.array([1.0, 1.0, 1.0, self.uneven])
        true = MEAN + SPREAD * self._drawn(rng, (self.people, 1))
        true = true + sd * self._drawn(rng, shape[:2])
        true = true + effect * np.linspace(0.0, 1.0, CONDITIONS)
        spread = np.hypot(error[:, None, None], self.beyond)
        estimate = true[:, :, None] + spread * rng.normal(size=shape)
        se = told[:, None, None] * np.exp(self.noisy * rng.normal(size=shape))
        person, condition, run = np.indices(shape)
        there = rng.uniform(size=estimate.size) >= MISSING
        return Draw(person, condition, run, estimate, se).some(there)

    def _drawn(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return rng.standard_t(3, shape) / np.sqrt(3.0) if self.heavy else rng.normal(size=shape)


WORLDS = {
    "as planned": World(),
    "no person x condition": World(interaction=0.0),
    "large person x condition": World(interaction=0.3),
    "se known to 20 %": World(noisy=0.2),
    "runs scatter beyond se": World(beyond=0.15),
    "heavy-tailed people": World(heavy=True),
    "bad person, se do not tell": World(hidden=True),
    "all of these": World(0.15, beyond=0.1, noisy=0.2, heavy=True),
    "one condition varies twice": World(interaction=0.1, uneven=2.0),
    "one run each": World(runs=1),
    "6 people": World(people=6),
}


class Draw(NamedTuple):
    """One experiment: a value for each row."""

    person: np.ndarray
    condition: np.ndarray
    run: np.ndarray
    estimate: np.ndarray
    se: np.ndarray

    def some(self, kept: np.ndarray) -> Draw:
        return Draw(*(column.ravel()[kept.ravel()] for column in self))

    def table(self) -> pd.DataFrame:
        """As a tidy table of parameters."""
        columns = dict(zip(("subject", *self._fields[1:]), self, strict=True))
        same = {"parameter": "K_e", "unit": "", "outlying": "", "failure": ""}
        return pd.DataFrame(columns).assign(**same)

    def cells(self, log: bool) -> Cells:
        """What the model makes of the table, without the time of pandas."""
        values, errors = self.estimate, self.se
        if log:
            values, errors = np.log(values), errors / values
        subject, condition = (
            np.unique(codes, return_inverse=True)[1] for codes in (self.person, self.condition)
        )
        return combine(values, errors, subject, condition).cells

    def means(self, log: bool = False) -> np.ndarray:
        """Means of runs of the people who have all conditions."""
        values = np.log(self.estimate) if log else self.estimate
        place = self.person * CONDITIONS + self.condition
        size = (int(self.person.max()) + 1) * CONDITIONS
        sums, counts = (np.bincount(place, w, size).reshape(-1, CONDITIONS) for w in (values, None))
        whole = np.all(counts > 0, axis=1)
        return sums[whole] / counts[whole]


class Pool:
    """Experiments put together from identified runs of people without any effect."""

    def __init__(self, table: pd.DataFrame, parameter: str) -> None:
        table = table[(table["parameter"] == parameter) & np.isfinite(table["estimate"])]
        known = table["se"] > 0.0
        self.estimates = [
            (g["estimate"].to_numpy(), g["se"].to_numpy())
            for _, g in table[known].groupby("subject", sort=False)
            if len(g) >= CONDITIONS * 2
        ]
        if len(self.estimates) < PEOPLE:
            raise SystemExit(f"{parameter}: {len(self.estimates)} people; {PEOPLE} are needed.")

    def draw(self, rng: np.random.Generator, effect: float) -> Draw:
        """One experiment; the effect is relative."""
        parts = []
        for p, chosen in enumerate(rng.permutation(len(self.estimates))[:PEOPLE]):
            estimate, se = self.estimates[chosen]
            order = rng.permutation(estimate.size)[: CONDITIONS * RUNS]
            condition = np.arange(order.size) % CONDITIONS
            scale = 1.0 + effect * condition / (CONDITIONS - 1)
            run = np.arange(order.size) // CONDITIONS
            person = np.full(order.size, p)
            parts.append((person, condition, run, scale * estimate[order], scale * se[order]))
        draw = Draw(*map(np.concatenate, zip(*parts, strict=True)))
        return draw.some(rng.uniform(size=draw.se.size) >= MISSING)


def anova_p(means: np.ndarray) -> tuple[float, float]:
    """p of the analysis of variance of run means, plain and by Greenhouse and Geisser."""
    n, k = means.shape
    rest = means - means.mean(axis=1, keepdims=True)
    between = n * np.sum(rest.mean(axis=0) ** 2)
    within = np.sum((rest - rest.mean(axis=0)) ** 2)
    F = between / (k - 1) / (within / ((n - 1) * (k - 1)))
    epsilon = sphericity(means)[0]
    return tuple(stats.f.sf(F, e * (k - 1), e * (n - 1) * (k - 1)) for e in (1.0, epsilon))


def analysed(draw: Draw, truth: np.ndarray | None, log: bool) -> dict[str, float]:
    """What the statistics say of one experiment: p-values, and which intervals hold the truth."""
    conditions = np.unique(draw.condition)
    model = fit_cells(draw.cells(log))
    pairs = model.contrasts(list_pairs(conditions.tolist(), None))
    plain, corrected = anova_p(draw.means(log))
    found = {
        "F": float(model.omnibus().p < ALPHA),
        "contrast": float(np.mean(pairs.p < ALPHA)),
        "Holm": float(np.min(holm(pairs.p)) < ALPHA),
        "ANOVA": float(plain < ALPHA),
        "ANOVA GG": float(corrected < ALPHA),
        "df": float(np.mean(pairs.df)),
    }
    if truth is not None:
        true = truth[conditions]
        reach = stats.t.isf(ALPHA / 2, pairs.df) * pairs.se
        wanted = np.array([true[i] - true[j] for i, j in pairs.pairs])
        found["cover difference"] = float(np.mean(abs(pairs.difference - wanted) < reach))
        mean, se, df = model.at.estimate(np.eye(len(true)))
        found["cover mean"] = float(np.mean(abs(mean - true) < stats.t.isf(ALPHA / 2, df) * se))
    return found


def effect_of_half_power(make: Make, seed: int) -> float:
    """The effect that an analysis of variance finds every second time."""

    def power(effect: float) -> float:
        rng = np.random.default_rng(seed)
        found = [anova_p(make(rng, effect).means())[0] < ALPHA for _ in range(PILOT)]
        return float(np.mean(found))

    low, high = 0.0, 0.05
    while power(high) < 0.5:
        low, high = high, 2.0 * high
    for _ in range(5):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if power(middle) < 0.5 else (low, middle)
    return 0.5 * (low + high)


def measured(
    make: Make, n: int, jobs: int, seed: int, *, log: bool = False, mean: float | None = MEAN
) -> pd.Series:
    """Rates over n experiments without and n with an effect; ``mean`` is the true one if known."""
    effect = effect_of_half_power(make, seed)
    seeds = np.random.SeedSequence(seed).spawn(2 * n)

    def one(number: int) -> dict[str, float]:
        size = effect * (number % 2)
        truth = None if mean is None else mean + size * np.linspace(0.0, 1.0, CONDITIONS)
        return analysed(make(np.random.default_rng(seeds[number]), size), truth, log)

    def some(numbers: range) -> list[dict[str, float]]:
        return [one(number) for number in numbers]

    step = 100
    chunks = [range(a, min(a + step, 2 * n)) for a in range(0, 2 * n, step)]
    done = Parallel(n_jobs=jobs)(delayed(some)(chunk) for chunk in chunks)
    table = pd.DataFrame([row for part in done for row in part])
    null, real = table[::2].mean(), table[1::2].mean()
    rates = {f"error {name}": null[name] for name in ("F", "contrast", "Holm", "ANOVA", "ANOVA GG")}
    if mean is not None:
        rates |= {name: table[name].mean() for name in ("cover difference", "cover mean")}
    rates |= {f"power {name}": real[name] for name in ("F", "ANOVA", "ANOVA GG")}
    rates["gain"] = real["F"] - real["ANOVA"]
    rates["power Holm"] = real["Holm"]
    result = 100.0 * pd.Series(rates)
    result["df"], result["effect"] = null["df"], effect
    return result


def missed(rates: pd.Series, n: int) -> tuple[list[str], list[str]]:
    """Which rates are outside what is wanted by two standard errors: wrong, and too careful."""
    slack = 200.0 * np.sqrt(0.05 * 0.95 / n)
    wrong, careful = [], []
    for name in ("error F", "error contrast", "error Holm", "cover difference", "cover mean"):
        if name not in rates:
            continue
        error = rates[name] if name.startswith("error") else 100.0 - rates[name]
        low, high = (4.0, 6.0) if name.startswith("error") else (3.0, 7.0)
        if error > high + slack:
            wrong.append(f"{name} {rates[name]:.1f}")
        if error < low - slack and name != "error Holm":
            careful.append(f"{name} {rates[name]:.1f}")
    return wrong, careful


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--experiments", type=int, default=2000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=None)
    parser.add_argument("--pool", default=None)
    parser.add_argument("--log", action="store_true")
    given = parser.parse_args()
    worlds: dict[str, tuple[Make, float | None]] = {
        name: (world.draw, MEAN) for name, world in WORLDS.items()
    }
    if given.pool:
        pool = pd.read_parquet(given.pool)
        names = [name for name in dict.fromkeys(pool["parameter"]) if name]
        worlds = {name: (Pool(pool, name).draw, None) for name in names}
    faults: list[str] = []
    told: list[str] = []
    for name, (make, mean) in worlds.items():
        if given.only and name not in given.only:
            continue
        rates = measured(make, given.experiments, given.jobs, given.seed, log=given.log, mean=mean)
        print(f"{name}\n  " + "  ".join(f"{k} {v:.1f}" for k, v in rates.items() if k != "effect"))
        print(f"  effect {rates['effect']:.3g}", flush=True)
        wrong, careful = missed(rates, given.experiments)
        faults += [f"wrong: {name}: {text}" for text in wrong]
        told += [f"too careful: {name}: {text}" for text in careful]
    print("\n".join(["", *told, *faults]) if told + faults else "\nAll rates are as wanted.")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
