"""Which people and runs look wrong, and why: robust rules, controlled for their number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from ...runs import RUN
from .groups import ALL, CONDITION, SUBJECT

FAMILY = 0.05  # chance that a rule flags anything where nothing is wrong
LEAST_Z = 3.5  # robust standard deviations
POINTS = 10.0  # VAF points that a run must be worse
FOLLOWS, FAR_ABOVE = 10.0, 50.0  # % VAF: does not follow; the others, far above
FACTOR = 3.0  # in the size of the output
PEOPLE, RUNS = 5, 3  # least numbers to compare
SURE, PART = 3.0, 0.2  # standard errors, and part of the others' gain, from which a sign is clear
SAME = 0.8  # of the others have the same sign, at least
FEW = 0.25  # of the people, at most, are outlying
COEFFICIENT = r"[ab]\d+(\(.*\))?"  # of an ARX model
PERFECT = 0.1  # % left, below which runs are alike
KEY = [SUBJECT, CONDITION]


class Flag(NamedTuple):
    """Someone or something outlying; ``run`` is ``"all"`` for a person."""

    subject: Any
    condition: Any
    run: Any
    kind: str
    reason: str


def outlying_table(groups: pd.DataFrame, table: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """All flags. ``runs`` has the VAF of each run, and ``spread``, that of its output."""
    of_runs = gains(table[table[RUN] != ALL])
    known = runs.assign(vaf=runs["vaf"].fillna(runs["vaf_group"]))
    flags = [
        *_unlike_the_others(gains(groups), of_runs, "sign", _opposite),
        *_wrong_scale(runs),
        *_unlike_the_others(groups.drop_duplicates(KEY), known, "no response", _far_below),
    ]
    explained = {flag[:2] for flag in flags if flag.run == ALL}
    flags += [flag for flag in _far_people(groups) if flag[:2] not in explained]
    told = {flag[:3] for flag in flags}
    flags += [flag for flag in _bad_runs(runs) if flag[:3] not in told]
    places = {key: n for n, key in enumerate(groups[KEY].itertuples(index=False, name=None))}
    joined: dict[tuple[Any, ...], Flag] = {}
    for flag in sorted(flags, key=lambda flag: places[flag[:2]]):
        before = joined.get(flag[:4])
        reason = f"{before.reason}; {flag.reason}" if before else flag.reason
        joined[flag[:4]] = flag._replace(reason=reason)
    return pd.DataFrame(list(joined.values()), columns=Flag._fields)


def _unlike_the_others(
    people: pd.DataFrame,
    runs: pd.DataFrame,
    kind: str,
    find: Callable[[pd.DataFrame], Iterator[tuple[int, str]]],
) -> Iterator[Flag]:
    """People among those of the condition, and runs among those of a person who is not flagged."""
    flagged = set()
    for condition, part in people.groupby(CONDITION, sort=False):
        for at, reason in find(part):
            who = part[SUBJECT].iloc[at], condition
            flagged.add(who)
            yield Flag(*who, ALL, kind, reason.format(others="the other people"))
    for (subject, condition), part in runs.groupby(KEY, sort=False):
        for at, reason in find(part) if (subject, condition) not in flagged else ():
            said = reason.format(others="this person's other runs")
            yield Flag(subject, condition, part[RUN].iloc[at], kind, said)


def _opposite(part: pd.DataFrame) -> Iterator[tuple[int, str]]:
    """Clear gains whose sign is not that of nearly all others."""
    values, se = (part[name].to_numpy(dtype=float) for name in ("estimate", "se"))
    if len(values) < RUNS:
        return
    clear = np.abs(values) > SURE * np.nan_to_num(se)
    clear &= np.abs(values) > PART * np.median(np.abs(values))
    for at in np.flatnonzero(clear):
        others = np.sign(np.delete(values, at))
        if np.mean(others == -np.sign(values[at])) >= SAME:
            sign = "positive" if values[at] < 0 else "negative"
            yield (
                int(at),
                f"{part['name'].iloc[at]} is {values[at]:.3g}, but {sign} for {{others}}: the "
                "stick may be inverted",
            )


def _far_below(part: pd.DataFrame) -> Iterator[tuple[int, str]]:
    """A VAF near zero, where that of the others is far above."""
    vaf = part["vaf"].to_numpy(dtype=float)
    for at in np.flatnonzero(vaf < FOLLOWS):
        others = np.delete(vaf, at)
        others = others[np.isfinite(others)]
        if others.size >= RUNS - 1 and np.median(others) > FAR_ABOVE:
            yield (
                int(at),
                f"does not follow the error: VAF (about zero) {vaf[at]:.0f} %, "
                f"{np.median(others):.0f} % for the median of {{others}}",
            )


def gains(table: pd.DataFrame) -> pd.DataFrame:
    """K_e of each fit, or else the static gain of its ARX coefficients; ``se`` where known."""
    keys = [*KEY, RUN]
    K_e = table[(table["parameter"] == "K_e") & np.isfinite(table["estimate"])]
    found = K_e[[*keys, "estimate", "se"]].assign(name="K_e")
    a, b = (
        table[table["parameter"].str.fullmatch(rf"{letter}\d+")]
        .groupby(keys, sort=False)["estimate"]
        .sum()
        for letter in "ab"
    )
    if b.empty:
        return found.reset_index(drop=True)
    static = (b / (1 + a.reindex(b.index, fill_value=0.0))).rename("estimate").reset_index()
    there = pd.MultiIndex.from_frame(static[keys]).isin(pd.MultiIndex.from_frame(found[keys]))
    rest = static[~there].assign(se=np.nan, name="the static gain")
    return pd.concat([found, rest], ignore_index=True) if len(found) else rest


def robust_scale(values: np.ndarray) -> float:
    """Spread by the distances of pairs (Rousseeuw and Croux's Qn): up to half may be wrong."""
    n = len(values)
    apart = np.sort(np.abs(values[:, None] - values)[np.triu_indices(n, 1)])
    half = n // 2 + 1
    small = n / (n + 1.4) if n % 2 else n / (n + 3.8)
    return float(2.2219 * small * apart[half * (half - 1) // 2 - 1])


def _limit(n_tests: int, n_values: int | None = None) -> float:
    """Robust z that chance exceeds with the probability FAMILY in all tests together.

    Of few values, by t with the degrees of freedom of their robust scale (0.8 for each value).
    """
    tail = FAMILY / (2 * max(n_tests, 1))
    if n_values is None:
        return max(LEAST_Z, float(stats.norm.isf(tail)))
    return max(LEAST_Z, float(stats.t.isf(tail, max(0.8 * (n_values - 1), 2.0))))


def _far(values: np.ndarray, se: np.ndarray) -> np.ndarray:
    """Robust z of each value, with the spread between all and its own standard error."""
    spread = np.hypot(robust_scale(values), np.nan_to_num(se))
    apart = values - np.median(values)
    tiny = 1e-9 * max(float(np.abs(values).max()), 1e-300)
    return np.where(np.abs(apart) > tiny, apart / np.maximum(spread, tiny), 0.0)


def _far_people(groups: pd.DataFrame) -> Iterator[Flag]:
    """People with parameters far from the others' in the same condition; one flag each.

    Those of effects tell nothing: who has not the effect has its parameter at a bound.
    """
    known = groups[np.isfinite(groups["estimate"]) & (groups["parameter"] != "vaf")]
    known = known[~known["parameter"].str.contains("__")]
    if (known["parameter"] == "K_e").any():  # which say the same in physical terms
        known = known[~known["parameter"].str.fullmatch(COEFFICIENT)]
    families = [
        (condition, parameter, part)
        for (condition, parameter), part in known.groupby([CONDITION, "parameter"], sort=False)
        if len(part) >= PEOPLE
    ]
    # On a scale of ratios too, where small values are as far away as large ones.
    n_tests = 2 * sum(len(part) for *_, part in families)
    found: dict[tuple[Any, Any], list[str]] = {}
    for condition, parameter, part in families:
        values, se = (part[name].to_numpy(dtype=float) for name in ("estimate", "se"))
        z = _far(values, se)
        if (values > 0).all():
            with np.errstate(over="ignore"):
                ratios = _far(np.log(values), se / values)
            z = np.where(np.abs(ratios) > np.abs(z), ratios, z)
        far = np.flatnonzero(np.abs(z) > _limit(n_tests, len(part)))
        if far.size > FEW * len(part):  # then people are of two kinds
            continue
        for at in far:
            value = f"{values[at]:.3g} {part['unit'].iloc[at]}".rstrip()
            found.setdefault((part[SUBJECT].iloc[at], condition), []).append(
                f"{parameter} is {value}, {abs(z[at]):.0f} spreads from the "
                f"{np.median(values):.3g} of the median person"
            )
    for who, reasons in found.items():
        yield Flag(*who, ALL, "parameter", "; ".join(reasons))


def _wrong_scale(runs: pd.DataFrame) -> Iterator[Flag]:
    """Outputs several times as large, or as small, as those of others."""
    known = runs[runs["spread"] > 0]
    people = known.groupby(KEY, sort=False)["spread"].median().reset_index()
    parts = [part for _, part in people.groupby(CONDITION, sort=False) if len(part) >= PEOPLE]
    for part in parts:
        size = np.log(part["spread"].to_numpy(dtype=float))
        far = np.abs(_far(size, np.zeros(size.size))) > _limit(sum(map(len, parts)), size.size)
        ratio = np.exp(size - np.median(size))
        for at in np.flatnonzero(far & (np.abs(np.log(ratio)) > np.log(FACTOR))):
            row = part.iloc[at]
            reason = _tell_scale(ratio[at], "the median person")
            yield Flag(row[SUBJECT], row[CONDITION], ALL, "scale", reason)
    size = np.log(known["spread"])
    apart = size - size.groupby([known[name] for name in KEY]).transform("median")
    for run, _ in _outside(known, apart.to_numpy()):
        if abs(apart.iloc[run]) > np.log(FACTOR):
            reason = _tell_scale(np.exp(apart.iloc[run]), "this person's other runs")
            yield _flag_run(known, run, "scale", reason)


def _flag_run(runs: pd.DataFrame, at: int, kind: str, reason: str) -> Flag:
    row = runs.iloc[at]
    return Flag(row[SUBJECT], row[CONDITION], row[RUN], kind, reason)


def _tell_scale(ratio: float, of: str) -> str:
    times = f"{ratio:.3g} times" if ratio > 1 else f"1/{1 / ratio:.3g} of"
    return f"the output is {times} that of {of}: its unit or its scale may be wrong"


def _bad_runs(runs: pd.DataFrame) -> Iterator[Flag]:
    """Runs worse than the others of the same person: fitted alone, and by the common model."""
    for column, fitted in (
        ("vaf", "fitted alone, its VAF is"),
        ("vaf_group", "by the model of all runs, its VAF is"),
    ):
        known = runs[np.isfinite(runs[column])]
        of = [known[name] for name in KEY]
        lost = np.log(np.maximum(100 - known[column].astype(float), PERFECT))
        apart = lost - lost.groupby(of).transform("median")
        median = known[column].groupby(of).transform("median")
        for at, z in _outside(known, apart.to_numpy()):
            vaf, others = known[column].iloc[at], median.iloc[at]
            if z > 0 and others - vaf >= POINTS:
                reason = f"{fitted} {vaf:.0f} %, that of the median run {others:.0f} %"
                yield _flag_run(known, at, "run", reason)


def _outside(runs: pd.DataFrame, apart: np.ndarray) -> Iterator[tuple[int, float]]:
    """Places of runs too far from the median of their group, with their z.

    A few runs do not tell their own spread: that of all groups together counts at least.
    """
    of = [runs[name] for name in KEY]
    sizes = runs[RUN].groupby(of).transform("size").to_numpy()
    some = sizes >= RUNS
    if not some.any():
        return
    # Deviations from the median of few values are smaller than those from the truth.
    scale = np.median(np.abs(apart[some]) * np.sqrt(sizes[some] / (sizes[some] - 1)))
    own = pd.Series(np.abs(apart), runs.index).groupby(of).transform("median").to_numpy()
    z = apart / np.maximum(1.4826 * np.maximum(scale, own), 1e-6)
    for at in np.flatnonzero(some & (np.abs(z) > _limit(int(some.sum())))):
        yield int(at), float(z[at])
