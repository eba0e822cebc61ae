"""How large effects may be that are not named, and how large they would have been seen.

Beside the finished model an effect changes the output by a column that grows with its size; what
the model's own parameters can make of it is projected out. How that column fits the residual gives
the likelihood of every size, with a simulation at each of a few sizes and no further fit.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import chi2, norm

from ..effects.composition import Effects
from ..effects.registry import title_of
from ..model.fitting import Criterion, derivatives
from ..model.model import Model
from ..model.simulator import Simulator
from .judging import THRESHOLD, Candidate
from .path import Path
from .statuses import Ending, Verdict

ALLOWED = float(chi2.ppf(0.9, 1)) / 2  # nats below the likeliest size: 95 % on one side
SHOWN = float(norm.ppf(0.9))  # standard deviations of the evidence, for 90 %
BLOCK = 10.0  # s, longer than remnant and loop remember
ROUNDS = 6  # of simulations at the sizes that the last ones lead to
CLOSE = 1.1  # times a size that was simulated, for which it stands too
FAR = 5.0  # times those that were simulated, to which they are extrapolated
N_SIZES = 1000
EXACT = 1e-9  # of the output, below which a residual is rounding
HALF = 0.5  # of the ceiling, which a model explains that can tell what it is missing
BY_CHANCE = 5.0  # % of VAF: of five parameters fitted to 100 rows that have nothing to do with them
BEGUN = (1.0, 4.0, 0.25, 16.0, 64.0)  # times the first size, until the output shows something
NO_SIZE = "there is no size at which it does nothing"
NOT_SEEN = "these runs say nothing of its size"
ANY_SIZE = "these runs allow it at any size, or would not have shown it at any"


@dataclass
class Limit:
    """A row of ``limits_``; NaN is what these runs do not tell, for a reason."""

    effect: str
    title: str
    parameter: str = ""
    unit: str = ""
    sense: str = ""
    limit: float = np.nan
    limit_points: float = np.nan
    shown_from: float = np.nan
    shown_points: float = np.nan
    reason: str = ""


def find_limits(path: Path, units: dict[str, str | None]) -> pd.DataFrame:
    """A row for each effect that was tried last and is not in the model, most allowed first."""
    known, rows = {*path.ids}, []
    tried = [c for c in path.steps[-1].candidates if c.model is not None]
    beside = Beside(path.model) if tried else None
    for candidate in tried:
        effect = candidate.effect
        if beside is None or effect.free_form or effect.name in known:
            continue
        known.add(effect.name)
        rows.append(limit_effect(beside, candidate, units))
    rows.sort(key=lambda row: (np.isnan(row.limit_points), -row.limit_points))
    return pd.DataFrame([vars(row) for row in rows], columns=[one.name for one in fields(Limit)])


def end_explained(ending: Ending, vaf: float, ceiling: float, share: float) -> Ending:
    """The end of a search whose best model may explain too little to say anything.

    VAF and ceiling (NaN where it is not known) are in percent about zero; ``share`` is the part of
    the output's power that is not its mean.
    """
    explained, possible = (100 - (100 - value) / max(share, 1e-300) for value in (vaf, ceiling))
    told = ending.verdict in (Verdict.NOTHING, Verdict.FOUND)
    little = explained < (BY_CHANCE if np.isnan(possible) else HALF * possible)
    if ending.verdict is Verdict.FOUND and explained >= BY_CHANCE:
        return ending  # what explains that much is there, whatever else is missing
    if not (told and little):
        return ending
    return Ending(Verdict.TOO_LITTLE, [], [*ending.named, *ending.stand_ins])


class Beside:
    """A model under the noise model of its residual, and what its parameters can make of others."""

    def __init__(self, model: Model):
        record = model.simulator.record
        self.criterion = criterion = Criterion(record)
        criterion.set_noise(criterion.remnant_model(model.output))
        self.model = model.refined(criterion, max_iter=4)
        rows = derivatives(self.model.simulator, criterion, self.model.theta)
        white = criterion.whitened(rows)
        self.own = make_basis(white[:-1])
        self.own_plain = make_basis((rows[:-1] * criterion.known).reshape(len(rows) - 1, -1))
        self.residual = outside(self.own, white[-1:])[0]
        freedom = max(criterion.n - len(self.own), 1)
        rounding = EXACT * np.sqrt(criterion.power / max(criterion.n, 1)) + 1e-300
        self.sigma = max(float(np.sqrt(self.residual @ self.residual / freedom)), rounding)
        length = max(round(BLOCK * record.time_unit / (record.dt * criterion.thin)), 1)
        n, n_runs = criterion.y.shape
        self.blocks = (np.arange(n)[:, None] // length * n_runs + np.arange(n_runs)).ravel()


class AtSizes(NamedTuple):
    """What the runs say of an effect at sizes.

    ``seen`` is the change of the whitened output in standard deviations of noise, without what the
    model's parameters make of it, ``alone`` the same without what other numbers of the effect make
    of it, ``fits`` its correlation with the residual in standard deviations, ``spread`` the
    variance of that by blocks of rows, at least 1, and ``points`` those of VAF.
    """

    seen: np.ndarray
    alone: np.ndarray
    fits: np.ndarray
    spread: np.ndarray
    points: np.ndarray


@dataclass(eq=False)
class Side:
    """An effect beside a model, at sizes on one side of doing nothing.

    Sizes are distances from the ``neutral`` value of the parameter at ``position``, up to ``most``;
    where that is infinite, they are the inverse of the parameter. ``others`` are the positions of
    the effect's parameters that are no sizes: other sizes are at neutral.
    """

    beside: Beside
    simulator: Simulator
    theta: np.ndarray
    position: int
    others: list[int]
    neutral: float
    sign: float
    most: float

    def __post_init__(self) -> None:
        self.at: dict[float, list[float]] = {}
        self.made_by_others: np.ndarray | None = None

    def value(self, size: float) -> float:
        """The parameter at a size."""
        return self.neutral + self.sign * size if np.isfinite(self.neutral) else 1 / size

    def simulate(self, size: float) -> bool:
        """Find what the runs say of a size; whether they say anything."""
        beside, criterion = self.beside, self.beside.criterion
        theta = self.theta.copy()
        theta[self.position] = self.value(size)
        change = (self.simulator.run(theta) - beside.model.output)[:: criterion.thin]
        change = np.where(criterion.known, change, 0.0)
        if not np.isfinite(change).all():
            return False
        seen = outside(beside.own, criterion.whitened(change[None]))
        if self.made_by_others is None and seen.any():
            rows = derivatives(self.simulator, criterion, theta, self.others)[:-1]
            self.made_by_others = make_basis(outside(beside.own, criterion.whitened(rows)))
        basis = np.zeros((0, seen.size)) if self.made_by_others is None else self.made_by_others
        alone, residual = outside(basis, seen)[0], outside(basis, beside.residual[None])[0]
        plain = outside(beside.own_plain, change.reshape(1, -1))
        lengths = [float(np.linalg.norm(one)) for one in (seen, alone, plain)]
        if min(lengths) <= 1e-9 * beside.sigma:
            return False
        scores = alone * residual / (lengths[1] * beside.sigma)
        of_blocks = np.bincount(beside.blocks, scores)
        self.at[size] = [
            lengths[0] / beside.sigma,
            lengths[1] / beside.sigma,
            float(scores.sum()),
            max(float(of_blocks @ of_blocks), 1.0),
            100 * lengths[2] ** 2 / criterion.power,
        ]
        return True

    def begin(self, size: float) -> bool:
        """Simulate a first size that shows something; whether there is one."""
        return any(self.simulate(min(times * size, self.most)) for times in BEGUN)

    def go_on(self, *sizes: float) -> bool:
        """Simulate sizes that are not near another, not too far at once; whether there were any."""
        done = [
            self.simulate(size)
            for size in np.minimum(sizes, min(FAR * max(self.at), self.most)).tolist()
            if all(max(size / one, one / size) > CLOSE for one in self.at)
        ]
        return any(done)

    def at_sizes(self) -> tuple[np.ndarray, AtSizes]:
        """Sizes, and what the runs say of them: beyond those simulated it is in proportion."""
        sizes = sorted(self.at)
        asked = np.geomspace(sizes[0] / FAR, min(sizes[-1] * FAR, self.most), N_SIZES)
        at, ask = np.log(sizes), np.log(asked)
        seen, alone, fits, spread, points = np.array([self.at[size] for size in sizes]).T
        beyond = ask - np.clip(ask, at[0], at[-1])

        def grow(values: np.ndarray, power: int) -> np.ndarray:
            return np.exp(np.interp(ask, at, np.log(values)) + power * beyond)

        fits, spread = (np.interp(ask, at, values) for values in (fits, spread))
        return asked, AtSizes(grow(seen, 1), grow(alone, 1), fits, spread, grow(points, 2))


def make_basis(rows: np.ndarray) -> np.ndarray:
    """Orthonormal rows that span the same."""
    lengths = np.linalg.norm(rows, axis=1)
    rows = rows[lengths > 0.0] / lengths[lengths > 0.0, None]
    values, vectors = np.linalg.eigh(rows @ rows.T)
    kept = values > 1e-9
    return (vectors[:, kept] / np.sqrt(values[kept])).T @ rows


def outside(basis: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """What a basis leaves of rows."""
    return rows - (rows @ basis.T) @ basis


def list_sides(
    beside: Beside, candidate: Candidate, simulator: Simulator, size: str
) -> tuple[list[Side], float]:
    """The sides of an effect's size, both where it has a sign; and the size that was fitted."""
    fitted, name = candidate.model, candidate.name
    assert fitted is not None
    effect = dict(fitted.effects.steps)[name]
    neutral = {f"{name}__{key}": value for key, value in effect.neutral.items()}
    values = {**fitted.values(), **beside.model.values()}
    theta = np.array([neutral.get(n, values[n]) for n in simulator.names])
    full = f"{name}__{size}"
    i, zero = simulator.names.index(full), neutral[full]
    low, high, scale = simulator.low[i], simulator.high[i], simulator.scale[i]
    others = [
        k for k, n in enumerate(simulator.names) if n.startswith(f"{name}__") and n not in neutral
    ]
    ends = [(1.0, high - zero), (-1.0, zero - low)]
    begun = max(abs(values[full] - zero), 0.01 * scale)
    if np.isinf(zero):
        ends, begun = [(1.0, 1 / max(low, 1e-300))], 1 / values[full]
    return [
        Side(beside, simulator, theta, i, others, zero, sign, most)
        for sign, most in ends
        if most > 0.0
    ], begun


class Solved(NamedTuple):
    """Of one side: the largest size allowed and the least that is shown, each with its points."""

    limit: float
    limit_points: float
    shown: float
    shown_points: float


def solve(sides: list[Side], needed: float) -> list[Solved]:
    """What is asked of all sides, from the sizes that were simulated."""
    asked = [side.at_sizes() for side in sides]
    losses = [(one.alone**2 - 2 * one.alone * one.fits) / (2 * one.spread) for _, one in asked]
    best = min(0.0, *(float(loss.min()) for loss in losses))
    found = []
    for (sizes, one), loss in zip(asked, losses, strict=True):
        evidence = one.seen**2 / 2
        likely = evidence - SHOWN * np.sqrt(2 * one.spread * evidence) >= needed
        allowed = np.flatnonzero(loss <= best + ALLOWED)
        last = int(allowed[-1]) if allowed.size else 0
        first = int(np.argmax(likely))
        # Infinite is what these runs allow at any size, or would not have shown at any.
        limit = (sizes[last], one.points[last]) if last < N_SIZES - 1 else (np.inf, np.inf)
        shown = (sizes[first], one.points[first]) if likely.any() else (np.inf, np.inf)
        found.append(Solved(*limit, *shown))
    return found


def limit_effect(beside: Beside, candidate: Candidate, units: dict[str, str | None]) -> Limit:
    """The limit of an effect that was fitted beside a model."""
    fitted, name, parent = candidate.model, candidate.name, beside.model
    assert fitted is not None
    effect = dict(fitted.effects.steps)[name]
    row = Limit(effect.name, title_of(effect.name), reason=NO_SIZE)
    size = next((p.name for p in effect.free if p.name in effect.neutral), None)
    if size is None:
        return row
    effects = Effects([*parent.effects.steps, (name, effect)])
    simulator = Simulator(parent.simulator.core, effects, parent.simulator.record)
    dimension = simulator.parameters[simulator.names.index(f"{name}__{size}")].dimension
    sides, begun = list_sides(beside, candidate, simulator, size)
    zero = float(effect.neutral[size])
    inverse = np.isinf(zero)
    row.parameter, row.unit, row.reason = size, dimension.label(units), NOT_SEEN
    row.sense = "at least" if inverse else "at most"
    if not all(side.begin(begun) for side in sides):
        return row
    more = fitted.n_parameters - parent.n_parameters
    needed = THRESHOLD + more / 2 * float(np.log(beside.criterion.n))
    found = solve(sides, needed)
    for _ in range(ROUNDS):
        pairs = zip(sides, found, strict=True)
        if True not in [side.go_on(one.limit, one.shown) for side, one in pairs]:
            break
        found = solve(sides, needed)
    # Of two sides the one with less information.
    limit = max((one.limit, one.limit_points) for one in found)
    shown = max((one.shown, one.shown_points) for one in found)

    def told(size: float, points: float) -> tuple[float, float]:
        if np.isinf(size):
            return np.nan, np.nan
        return (1 / size if inverse else zero + size), points

    row.limit, row.limit_points = told(*limit)
    row.shown_from, row.shown_points = told(*shown)
    row.reason = ANY_SIZE if np.isnan([row.limit, row.shown_from]).any() else ""
    return row
