"""Which people and runs look wrong, and why: robust rules, controlled for their number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from ...runs import RUN
from .groups import ALL, CONDITION, SUBJECT

FAMILY = 0.05  # chance that a rule flags anything where nothing is wrong
RUN_Z, PERSON_Z = 3.5, 4.0  # least, in robust standard deviations
POINTS = 10.0  # VAF points that a run must be worse
FOLLOWS, FAR_ABOVE = 10.0, 50.0  # % VAF: does not follow; the others, far above
FACTOR = 3.0  # in the size of the output
PEOPLE, RUNS = 5, 3  # least numbers to compare
SURE = 3.0  # standard errors, from which a sign is known
SAME = 0.8  # of the others have the same sign, at least
PART = 0.2  # of the others' gain that one of the wrong sign must reach
FEW = 0.25  # of the people, at most, are outlying
COEFFICIENT = r"[ab]\d+(\(.*\))?"  # of an ARX model
PERFECT = 0.1  # % left, below which runs are alike
# Of the scale of pairs: consistent for normal errors, and degrees of freedom per value.
NORMAL, EFFICIENCY = 2.2219, 0.8


class Flag(NamedTuple):
    """Someone or something outlying; ``run`` is ``"all"`` for a person."""

    subject: Any
    condition: Any
    run: Any
    kind: str
    reason: str


def outlying_table(groups: pd.DataFrame, table: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """All flags. ``runs`` has the VAF of each run, and ``spread``, that of its output."""
    flags = [*_wrong_sign(groups, table), *_wrong_scale(runs), *_not_following(groups, runs)]
    explained = {flag[:2] for flag in flags if flag.run == ALL}
    flags += [f for f in _far_people(groups) if f[:2] not in explained]
    told = {flag[:3] for flag in flags}
    flags += [flag for flag in _bad_runs(runs) if flag[:3] not in told]
    places = {key: n for n, key in enumerate(dict.fromkeys(zip(*_keys(groups), strict=True)))}
    joined: dict[tuple[Any, ...], Flag] = {}
    for flag in sorted(flags, key=lambda flag: places[flag[:2]]):
        before = joined.get(flag[:4])
        reason = f"{before.reason}; {flag.reason}" if before else flag.reason
        joined[flag[:4]] = flag._replace(reason=reason)
    return pd.DataFrame(list(joined.values()), columns=Flag._fields)


def _keys(table: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    return table[SUBJECT], table[CONDITION]


def robust_scale(values: np.ndarray) -> float:
    """Spread by the distances of pairs (Rousseeuw and Croux's Qn): up to half may be wrong."""
    n = len(values)
    apart = np.sort(np.abs(values[:, None] - values)[np.triu_indices(n, 1)])
    half = n // 2 + 1
    small = n / (n + 1.4) if n % 2 else n / (n + 3.8)
    return float(NORMAL * small * apart[half * (half - 1) // 2 - 1])


def threshold(least: float, n_tests: int, n_values: int | None = None) -> float:
    """Robust z that chance exceeds with the probability FAMILY in all tests together."""
    tail = FAMILY / (2 * max(n_tests, 1))
    if n_values is None:
        return max(least, float(stats.norm.isf(tail)))
    return max(least, float(stats.t.isf(tail, max(EFFICIENCY * (n_values - 1), 2.0))))


def _far(values: np.ndarray, se: np.ndarray) -> np.ndarray:
    """Robust z of each value, with the spread between all and its own standard error."""
    spread = np.hypot(robust_scale(values), np.where(np.isfinite(se), se, 0.0))
    apart = values - np.median(values)
    tiny = 1e-9 * max(float(np.abs(values).max()), 1e-300)
    return np.where(np.abs(apart) > tiny, apart / np.maximum(spread, tiny), 0.0)


def _far_people(groups: pd.DataFrame) -> Iterator[Flag]:
    """People with parameters far from the others' in the same condition; one flag each."""
    known = groups[np.isfinite(groups["estimate"]) & (groups["parameter"] != "vaf")]
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
        z, limit = _far(values, se), threshold(PERSON_Z, n_tests, len(part))
        if (values > 0).all():
            with np.errstate(over="ignore"):
                ratios = _far(np.log(values), se / values)
            z = np.where(np.abs(ratios) > np.abs(z), ratios, z)
        others = _number(float(np.median(values)))
        far = np.flatnonzero(np.abs(z) > limit)
        if far.size > FEW * len(part):  # then people are of two kinds
            continue
        for at in far:
            unit = f" {part['unit'].iloc[at]}" if part["unit"].iloc[at] else ""
            found.setdefault((part[SUBJECT].iloc[at], condition), []).append(
                f"{parameter} is {_number(values[at])}{unit}, {abs(z[at]):.0f} spreads from the "
                f"{others} of the median person"
            )
    for (subject, condition), reasons in found.items():
        yield Flag(subject, condition, ALL, "parameter", "; ".join(reasons))


def gains(table: pd.DataFrame) -> pd.DataFrame:
    """K_e of each fit, or else the static gain of its ARX coefficients; ``se`` where known."""
    keys = [SUBJECT, CONDITION, RUN]
    K_e = table[(table["parameter"] == "K_e") & np.isfinite(table["estimate"])]
    names = table["parameter"].str
    found = K_e[[*keys, "estimate", "se"]].assign(name="K_e")
    if names.fullmatch(r"b\d+").any():
        b = table[names.fullmatch(r"b\d+")].groupby(keys, sort=False)["estimate"].sum()
        a = table[names.fullmatch(r"a\d+")].groupby(keys, sort=False)["estimate"].sum()
        static = (b / (1 + a.reindex(b.index, fill_value=0.0))).rename("estimate").reset_index()
        there = pd.MultiIndex.from_frame(static[keys]).isin(pd.MultiIndex.from_frame(found[keys]))
        rest = static[~there].assign(se=np.nan, name="the static gain")
        found = pd.concat([found, rest], ignore_index=True) if len(found) else rest
    return found.reset_index(drop=True)


def _wrong_sign(groups: pd.DataFrame, table: pd.DataFrame) -> Iterator[Flag]:
    inverted = set()
    for condition, part in gains(groups).groupby(CONDITION, sort=False):
        for at, sign in _opposite(part):
            row = part.iloc[at]
            inverted.add((row[SUBJECT], condition))
            reason = (
                f"{row['name']} is {_number(row['estimate'])}, but {sign} for the other people: "
                "the stick may be inverted"
            )
            yield Flag(row[SUBJECT], condition, ALL, "sign", reason)
    of_runs = gains(table[table[RUN] != ALL])
    for (subject, condition), part in of_runs.groupby([SUBJECT, CONDITION], sort=False):
        if (subject, condition) in inverted:
            continue
        for at, sign in _opposite(part):
            row = part.iloc[at]
            reason = (
                f"{row['name']} is {_number(row['estimate'])}, but {sign} in this person's other "
                "runs: the stick may be inverted"
            )
            yield Flag(subject, condition, row[RUN], "sign", reason)


def _opposite(part: pd.DataFrame) -> Iterator[tuple[int, str]]:
    """Places of clear gains whose sign is not that of nearly all others."""
    values, se = (part[name].to_numpy(dtype=float) for name in ("estimate", "se"))
    if len(values) < RUNS:
        return
    clear = np.abs(values) > SURE * np.where(np.isfinite(se), se, 0.0)
    clear &= np.abs(values) > PART * np.median(np.abs(values))
    for at in np.flatnonzero(clear):
        others = np.sign(np.delete(values, at))
        if np.mean(others == -np.sign(values[at])) >= SAME:
            yield int(at), "positive" if values[at] < 0 else "negative"


def _wrong_scale(runs: pd.DataFrame) -> Iterator[Flag]:
    """Outputs several times as large, or as small, as those of others."""
    known = runs[runs["spread"] > 0]
    of_people = known.groupby([SUBJECT, CONDITION], sort=False)["spread"].median().reset_index()
    parts = [part for _, part in of_people.groupby(CONDITION, sort=False) if len(part) >= PEOPLE]
    n_tests = sum(map(len, parts))
    for part in parts:
        size = np.log(part["spread"].to_numpy(dtype=float))
        z = _far(size, np.zeros(size.size))
        limit = threshold(PERSON_Z, n_tests, size.size)
        ratio = np.exp(size - np.median(size))
        for at in np.flatnonzero((np.abs(z) > limit) & (np.abs(np.log(ratio)) > np.log(FACTOR))):
            row = part.iloc[at]
            reason = f"the output is {_times(ratio[at])} that of the median person{_SCALE}"
            yield Flag(row[SUBJECT], row[CONDITION], ALL, "scale", reason)
    size = np.log(known["spread"])
    apart = size - size.groupby([known[SUBJECT], known[CONDITION]]).transform("median")
    for row, _, times in _outside(known, apart.to_numpy(), np.exp(apart.to_numpy())):
        if abs(np.log(times)) > np.log(FACTOR):
            reason = f"the output is {_times(times)} that of this person's other runs{_SCALE}"
            yield Flag(row[SUBJECT], row[CONDITION], row[RUN], "scale", reason)


_SCALE = ": its unit or its scale may be wrong"


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio > 1 else f"1/{1 / ratio:.3g} of"


def _not_following(groups: pd.DataFrame, runs: pd.DataFrame) -> Iterator[Flag]:
    people = groups.drop_duplicates([SUBJECT, CONDITION])
    silent = set()
    for condition, part in people.groupby(CONDITION, sort=False):
        for at, others in _far_below(part["vaf"].to_numpy(dtype=float)):
            row = part.iloc[at]
            silent.add((row[SUBJECT], condition))
            yield Flag(
                row[SUBJECT],
                condition,
                ALL,
                "no response",
                f"does not follow the error: VAF {row['vaf']:.0f} %, {others:.0f} % for the "
                "median of the others",
            )
    for (subject, condition), part in runs.groupby([SUBJECT, CONDITION], sort=False):
        if (subject, condition) in silent:
            continue
        own = "vaf" if np.isfinite(part["vaf"]).any() else "vaf_group"
        for at, others in _far_below(part[own].to_numpy(dtype=float)):
            row = part.iloc[at]
            yield Flag(
                subject,
                condition,
                row[RUN],
                "no response",
                f"does not follow the error: VAF {row[own]:.0f} %, {others:.0f} % for the median "
                "of this person's other runs",
            )


def _far_below(vaf: np.ndarray) -> Iterator[tuple[int, float]]:
    """Places near zero, and the median of the others where that is far above."""
    for at in np.flatnonzero(vaf < FOLLOWS):
        others = np.delete(vaf, at)
        others = others[np.isfinite(others)]
        if others.size >= RUNS - 1 and np.median(others) > FAR_ABOVE:
            yield int(at), float(np.median(others))


def _bad_runs(runs: pd.DataFrame) -> Iterator[Flag]:
    """Runs worse than the others of the same person: fitted alone, and by the common model."""
    for column, fitted in (
        ("vaf", "fitted alone, its VAF is"),
        ("vaf_group", "by the model of all runs, its VAF is"),
    ):
        known = runs[np.isfinite(runs[column])]
        lost = np.log(np.maximum(100 - known[column].to_numpy(dtype=float), PERFECT))
        of = [known[SUBJECT], known[CONDITION]]
        apart = lost - pd.Series(lost, known.index).groupby(of).transform("median")
        median = known[column].groupby(of).transform("median").to_numpy()
        for row, z, others in _outside(known, apart.to_numpy(), median):
            if z > 0 and others - row[column] >= POINTS:
                yield Flag(
                    row[SUBJECT],
                    row[CONDITION],
                    row[RUN],
                    "run",
                    f"{fitted} {row[column]:.0f} %, that of the median run {others:.0f} %",
                )


def _outside(
    runs: pd.DataFrame, apart: np.ndarray, beside: np.ndarray
) -> Iterator[tuple[Any, float, float]]:
    """Runs too far from the median of their group, with their z and a value of ``beside``.

    A few runs do not tell their own spread: that of all groups together counts at least.
    """
    of = [runs[SUBJECT], runs[CONDITION]]
    sizes = runs[RUN].groupby(of).transform("size").to_numpy()
    some = sizes >= RUNS
    if not some.any():
        return
    # Deviations from the median of few values are smaller than those from the truth.
    scale = 1.4826 * float(
        np.median(np.abs(apart[some]) * np.sqrt(sizes[some] / (sizes[some] - 1)))
    )
    own = 1.4826 * pd.Series(np.abs(apart), runs.index).groupby(of).transform("median").to_numpy()
    z = apart / np.maximum(np.maximum(scale, own), 1e-6)
    limit = threshold(RUN_Z, int(some.sum()))
    for at in np.flatnonzero(some & (np.abs(z) > limit)):
        yield runs.iloc[at], float(z[at]), float(beside[at])


def _number(value: float) -> str:
    return f"{value:.3g}"
