"""What values say of a loop: which column is a sum of others, and which answers which."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .words import equal, moves

_ALIKE = 0.9  # correlation of signals with themselves one lag ago: lags then see the dynamics
_LAGS = 4
_ROWS = 50_000  # of a record, from its middle, are enough
_FEW = 60  # lags in a record, below which nothing is said
_NOISE = 1e-3  # of a standard deviation: what is predicted better is a copy
MOST_OF_LOOP = 8  # columns among which a loop is looked for
ANSWERS, IGNORES = 0.2, 0.05  # influence of one signal on another that is seen, and that is none
_TRACKS = 0.5  # variance of an error in those of the target and of what follows it
_LEADS = 0.05  # by how much influences must differ


def influence(signals: list[np.ndarray]) -> np.ndarray:
    """Share of what the past of ``signals[j]`` leaves open that the past of ``signals[i]`` tells.

    Element (i, j), after Granger (1969, Econometrica 37:424), with lags so long that the signals
    have changed between them. All are 0 where the record is short.
    """
    count = len(signals)
    found = np.zeros((count, count))
    table = np.column_stack(signals)
    table = table[np.isfinite(table).all(axis=1)]
    middle = max(0, (len(table) - _ROWS) // 2)
    table = table[middle : middle + _ROWS]
    if len(table) < _FEW or not all(moves(column) for column in table.T):
        return found
    table = (table - table.mean(axis=0)) / table.std(axis=0)
    lag = 1
    while lag < len(table) and np.mean(table[lag:] * table[:-lag]) > _ALIKE:
        lag = max(lag + 1, int(1.2 * lag))
    if len(table) < _FEW * lag:
        return found
    rows = np.arange(_LAGS * lag, len(table), max(1, lag // 4))
    past = [np.column_stack([c[rows - k * lag] for k in range(1, _LAGS + 1)]) for c in table.T]

    def left(answer: np.ndarray, known: np.ndarray) -> float:
        known = np.column_stack([known, np.ones(len(known))])
        square = known.T @ known + _NOISE**2 * len(known) * np.eye(known.shape[1])
        rest = answer - known @ np.linalg.solve(square, known.T @ answer)
        return float(rest @ rest) / len(rest) + _NOISE**2

    for j in range(count):
        alone = left(table[rows, j], past[j])
        for i in set(range(count)) - {j}:
            found[i, j] = 1 - left(table[rows, j], np.hstack([past[j], past[i]])) / alone
    return found


@dataclass(frozen=True)
class LoopRoles:
    """Columns by role, as far as values say, and those that may be the output, likeliest first."""

    roles: dict[str, str]
    outputs: list[str]


def answers(output: np.ndarray, error: np.ndarray) -> bool:
    """Whether a signal plainly answers another."""
    return len(output) == len(error) and bool(influence([error, output])[0, 1] > ANSWERS)


def find_loop(columns: Mapping[str, np.ndarray], known: Mapping[str, str]) -> LoopRoles:
    """Who is who among columns; ``known`` gives those of some roles.

    Where e = f_t - x holds among three of them, or two differ by less than either moves, these
    are target, x and error, if the output answers that error; x is the one that follows the
    output. Of two columns alone, the one that answers the other without being answered is the
    output of an open loop.
    """
    names = list(columns)
    free = [name for name in names if name not in known.values()]
    lengths = {len(columns[name]) for name in names}
    if len(names) < 2 or len(free) > MOST_OF_LOOP or len(lengths) > 1:
        return LoopRoles({}, free)
    effects = influence([columns[name] for name in names])
    gain = {(a, b): effects[i, j] for i, a in enumerate(names) for j, b in enumerate(names)}
    shares = {pair: _share(columns, pair) for pair in combinations(free, 2)}
    limit = max(_TRACKS, min(1.0, min(shares.values(), default=1.0)))
    near = {c for pair, share in shares.items() if share <= limit and share < 1 for c in pair}
    net = {c: sum(gain[o, c] - gain[c, o] for o in names) for c in free}
    apart = {c: max(max(gain[o, c], gain[c, o]) for o in names) < IGNORES for c in free}

    def order(c: str) -> tuple[bool, bool, float]:
        # Of target or error, output and x, the output is answered and answers.
        return apart[c], c in near, -net[c] if len(free) == 2 else abs(net[c])

    free.reverse()  # what comes last in a file, if nothing tells
    outputs = sorted(free, key=order)
    unknown = LoopRoles({}, outputs)
    if len(names) == 2:
        for a, b in (names, names[::-1]):
            if gain[a, b] > ANSWERS and gain[b, a] < IGNORES and not known:
                return LoopRoles({"e": a, "u": b}, outputs)
        return unknown
    triple = _find_sum(columns, known) or _find_pair(columns, known)
    if triple is None:
        return unknown
    roles = dict(known)
    *error, one, other = triple
    difference = columns[one] - columns[other]
    if "u" not in roles:
        rest = [name for name in outputs if name not in triple]
        told = {name: influence([difference, columns[name]])[0, 1] for name in rest}
        moved = [name for name in rest if told[name] > IGNORES]
        if len(moved) == 1 and told[moved[0]] > ANSWERS:
            rest = moved  # beside the heart rate, the temperature, another axis
        if len(rest) != 1:
            return LoopRoles({}, rest or outputs)
        roles["u"] = rest[0]
    if error:
        roles["e"] = error[0]
    if not answers(columns[roles["u"]], difference):
        return unknown
    held = next((role for role in ("f_t", "x") if roles.get(role) in (one, other)), None)
    if held is None:
        lead = gain[roles["u"], other] - gain[roles["u"], one]
        if abs(lead) < _LEADS or lead * _lag(columns[one], columns[other]) <= 0:
            return unknown
        roles["f_t"], roles["x"] = (one, other) if lead > 0 else (other, one)
    else:
        roles["x" if held == "f_t" else "f_t"] = other if roles[held] == one else one
    return LoopRoles({role: name for role, name in roles.items() if role not in known}, outputs)


def _share(columns: Mapping[str, np.ndarray], pair: tuple[str, str]) -> float:
    """Variance of the difference of two columns in that of the one which varies less."""
    one, other = (columns[name] for name in pair)
    return float(np.nanvar(one - other) / (min(np.nanvar(one), np.nanvar(other)) or np.inf))


def _find_sum(columns: Mapping[str, np.ndarray], known: Mapping[str, str]) -> list[str] | None:
    """Error, and the two whose difference it is, where that is plain."""
    found = []
    for three in combinations([name for name in columns if name != known.get("u")], 3):
        if any(
            equal(columns[whole], columns[a] + columns[b])
            for whole in three
            for a, b in [[name for name in three if name != whole]]
        ):
            found.append(sorted(three, key=lambda name: float(np.nanvar(columns[name]))))
    if len(found) != 1:
        return None
    error, one, _ = found[0]
    if "e" in known and known["e"] in found[0]:
        return [known["e"], *(name for name in found[0] if name != known["e"])]
    return found[0] if np.nanvar(columns[error]) < _TRACKS * np.nanvar(columns[one]) else None


def _find_pair(columns: Mapping[str, np.ndarray], known: Mapping[str, str]) -> list[str] | None:
    """The two columns of which one follows the other, if only they do."""
    given = {known[role] for role in ("f_t", "x") if role in known}
    names = [name for name in columns if name not in {known.get("u"), known.get("e")}]
    pairs = [pair for pair in combinations(names, 2) if given <= set(pair)]
    close = [list(pair) for pair in pairs if _share(columns, pair) < _TRACKS]
    return close[0] if len(close) == 1 else None


def _lag(one: np.ndarray, other: np.ndarray) -> int:
    """By how many rows the second signal is behind the first."""
    from scipy import signal

    there = np.isfinite(one) & np.isfinite(other)
    first, second = (values[there] - values[there].mean() for values in (one, other))
    products = signal.correlate(second, first, "same", "fft")
    return int(np.argmax(products)) - len(first) // 2
