"""How large effects may be that are not named, and how large they would have been seen.

Beside the finished model an effect changes the output by a column that grows with its size; what
the model's own parameters can make of it is projected out. How that column fits the residual gives
the likelihood of every size, with a simulation at each of a few sizes and no further fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import chi2

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import Record
from ..effects.registry import title_of
from ..model.fitting import AR_ORDER, Criterion, derivatives, scaled_inverse
from ..model.likelihood import fit_autoregression, likeliest
from ..model.model import Model, begin_alike
from ..model.simulator import Simulator
from .expected import SURELY
from .judges import BLOCK, RATES
from .judging import LEAST_GAIN, THRESHOLD, Candidate
from .path import Path
from .probability import find_needed
from .statuses import Against, Ending, Verdict
from .steps import attempt

ALLOWED = float(chi2.ppf(0.9, 1)) / 2  # nats below the likeliest size: 95 % on one side
ROUNDS = 5  # of simulations at the sizes that the last ones lead to
CLOSE = 1.25  # times a size that was simulated, for which it stands too
FAR = 5.0  # times those that were simulated, to which they are extrapolated
N_SIZES = 1000
LEAST_START = 0.01  # of the parameter's scale
TRIED = 3  # sets of the other numbers of an effect: as fitted, and starts
FITTED = 6  # iterations of the model that imitates an effect
WORTHWHILE = 0.95  # times what the last one leaves, at most, for another
EXACT = 1e-9  # of the output, below which a residual is rounding
# Of a change that a model may imitate so far: what is left then hangs on how well it was fitted. Of
# a lag it leaves .04 to .13, of other effects at their limits .2 to 1 (runs of C1 and C2).
IMITATED = 0.15
NONE = 1e-12  # in the place of nothing, which has no logarithm
HALF = 0.5  # of the ceiling, which a model explains that can tell what it is missing
BY_CHANCE = 5.0  # % of VAF: of five parameters fitted to 100 rows that have nothing to do with them
BEGUN = (1.0, 4.0, 0.25, 16.0, 64.0)  # times the first size, until the output shows something
NO_SIZE = "there is no size at which it does nothing"
MOST_POINTS = 100.0  # of VAF: the whole output. Stronger, a change is no small one beside a model
NOT_SEEN = (
    "these runs say nothing of its size, the model imitates it, or what fits best would exceed the "
    "output"
)
ANY_SIZE = "these runs allow it up to the size of the output, or would not have shown it below that"


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


def find_limits(
    path: Path, effects: Sequence[Effect], units: dict[str, str | None], confidence: float
) -> pd.DataFrame:
    """A row for each of the effects that was tried last and is not in the model, largest first.

    By the points of VAF that are allowed. Shown is what is named with a ``confidence``.
    """
    tried = {c.effect.name: c for c in path.steps[-1].candidates if c.model is not None}
    asked = [e for e in effects if e.name in tried and e.name not in path.ids]
    rows: list[Limit] = []
    if asked:
        beside = Beside(path.model)
        needed = max(find_needed(asked[0], confidence), THRESHOLD)
        record = path.model.simulator.record
        for e in asked:
            found = attempt(partial(limit_effect, beside, tried[e.name], e, units, needed), record)
            failed = isinstance(found, Against)
            rows.append(Limit(e.name, title_of(e.name), reason=NOT_SEEN) if failed else found)
    rows.sort(key=lambda row: (np.isnan(row.limit_points), -row.limit_points))
    return pd.DataFrame([vars(row) for row in rows], columns=[one.name for one in fields(Limit)])


def end_explained(ending: Ending, vaf: float, ceiling: float, share: float) -> Ending:
    """The end of a search whose best model may explain too little to say anything.

    VAF and ceiling (NaN where it is not known) are in percent about zero; ``share`` is the part of
    the output's power that is not its mean.
    """
    explained, possible = (100 - (100 - value) / max(share, 1e-300) for value in (vaf, ceiling))
    if ending.verdict not in (Verdict.NOTHING, Verdict.FOUND, Verdict.POSSIBLE):
        return ending
    # What is found and explains that much is there, whatever else is missing.
    half = ending.verdict is Verdict.NOTHING and np.isfinite(possible)
    if explained >= (HALF * possible if half else BY_CHANCE):
        return ending
    return Ending(Verdict.TOO_LITTLE, [], [*ending.named, *ending.stand_ins])


class View:
    """A model at a rate, at its likeliest parameters and noise model, and what both can imitate.

    In a closed loop an effect holds earlier remnant, which a noise model may take it for: lags of
    the residual are what its numbers move.
    """

    def __init__(self, model: Model, rate: float | None = None):
        self.criterion = criterion = Criterion(model.simulator.record, rate=rate)
        if model.simulator.core.kind.is_operator:
            found = likeliest(model.simulator, [model.theta], criterion.rate)
            model = model if found is None else model.at(found[1])
        else:
            criterion.set_noise(criterion.remnant_model(model.output))
            model = model.refined(criterion, max_iter=4)
        self.model, self.output = model, model.output
        self.residual = criterion.residual(self.output)
        noise = fit_autoregression(self.residual, criterion.known)
        criterion.set_noise(noise or criterion.remnant_model(self.output))
        self.rows = derivatives(model.simulator, criterion, model.theta)[:-1]
        self.table = np.concatenate([criterion.whitened(self.rows), self.lags_of(self.residual)])
        self.inverse = scaled_inverse(self.table @ self.table.T)
        self.noise = self.whitened(self.residual)
        freedom = max(criterion.n - len(self.table), 1)
        rounding = EXACT * np.sqrt(criterion.power / max(criterion.n, 1)) + 1e-300
        self.sigma = max(float(np.linalg.norm(self.noise) / np.sqrt(freedom)), rounding)

    def thinned(self, change: np.ndarray) -> np.ndarray:
        """A change of the output on the rows of the criterion."""
        return np.where(self.criterion.known, change[:: self.criterion.thin], 0.0)

    def imitated(self, change: np.ndarray) -> np.ndarray:
        """Steps of the parameters that imitate a change best, beside the noise model."""
        steps = self.inverse @ (self.table @ self.criterion.whitened(change[None])[0])
        return np.asarray(steps[: len(self.rows)])

    def whitened(self, change: np.ndarray) -> np.ndarray:
        """A whitened change, without what the parameters and the noise model imitate."""
        white = self.criterion.whitened(change[None])[0]
        return white - (self.inverse @ (self.table @ white)) @ self.table

    def evidence_of(self, change: np.ndarray) -> float:
        """Nats by which a model that lacks a change is less likely, if it is there.

        Its noise model is then one of remnant and change.
        """
        thin = self.thinned(change)
        table = np.concatenate([self.table[: len(self.rows)], self.lags_of(self.residual + thin)])
        white = self.criterion.whitened(thin[None])[0]
        left = white - (scaled_inverse(table @ table.T) @ (table @ white)) @ table
        n = self.criterion.n
        return n / 2 * float(np.log1p(left @ left / self.sigma**2 / n))

    def lags_of(self, signal: np.ndarray) -> np.ndarray:
        """Past values of a signal, on the rows that count."""
        late = np.zeros((AR_ORDER, *signal.shape))
        for k in range(AR_ORDER):
            late[k, k + 1 :] = signal[: -k - 1]
        return (late * self.criterion.weight).reshape(AR_ORDER, -1)


class Beside(View):
    """A model beside which effects are tried, and how the judges see it."""

    def __init__(self, model: Model):
        kind = model.simulator.core.kind
        first, *others = RATES if kind.is_operator else (None,)
        super().__init__(model, first)
        self.judges = [self, *(View(model, rate) for rate in others)]
        record, criterion = model.simulator.record, self.criterion
        length = max(round(BLOCK * record.time_unit / (record.dt * criterion.thin)), 1)
        n, n_runs = criterion.y.shape
        self.blocks = (np.arange(n)[:, None] // length * n_runs + np.arange(n_runs)).ravel()

    def left_of(self, change: np.ndarray) -> np.ndarray:
        """What the model, fitted again, leaves of a change of the output."""
        simulator, theta, left = self.model.simulator, self.model.theta, change
        for _ in range(FITTED):
            thin = self.thinned(left)
            before = float(np.linalg.norm(self.whitened(thin)))
            theta = np.clip(theta + self.imitated(thin), simulator.low, simulator.high)
            again = change - (simulator.run(theta) - self.output)
            after = float(np.linalg.norm(self.whitened(self.thinned(again))))
            left = again if after < before else left
            if not after < WORTHWHILE * before:
                break
        return left


class AtSizes(NamedTuple):
    """What the runs say of an effect at sizes.

    ``evidence`` are the nats that the judges expect of it, ``seen`` is the change of the whitened
    output in standard deviations of noise, without what the model makes of it, ``fits`` its
    correlation with the residual in standard deviations, ``spread`` the variance of that by blocks
    of rows, at least 1, ``points`` those of VAF, and ``unsure`` the standard deviation of the
    points that held-out rows show, by blocks.
    """

    evidence: np.ndarray
    seen: np.ndarray
    fits: np.ndarray
    spread: np.ndarray
    points: np.ndarray
    unsure: np.ndarray


@dataclass(eq=False)
class Side:
    """An effect beside a model, at sizes on one side of doing nothing.

    Sizes are distances from the ``neutral`` value of the parameter at ``position``, up to ``most``;
    where that is infinite, they are the inverse of the parameter. The first is ``start``, of which
    a fit found the share ``fitted``, less than zero on the other side; None is not fitted.
    """

    beside: Beside
    simulator: Simulator
    theta: np.ndarray
    position: int
    neutral: float
    sign: float
    most: float
    start: float
    fitted: float | None

    def __post_init__(self) -> None:
        self.at: dict[float, list[float]] = {}
        self.lost = False  # whether the model imitates it, or cannot be beside the size fitted

    def value(self, size: float) -> float:
        """The parameter at a size."""
        return self.neutral + self.sign * size if np.isfinite(self.neutral) else 1 / size

    def simulate(self, size: float) -> bool:
        """Find what the runs say of a size; whether they say anything."""
        beside, criterion = self.beside, self.beside.criterion
        theta = self.theta.copy()
        theta[self.position] = self.value(size)
        change = self.simulator.run(theta) - beside.output
        if not np.isfinite(change).all():
            return False
        left = beside.left_of(change)
        thin = beside.thinned(left)
        seen = beside.whitened(thin)
        plain = thin - np.tensordot(beside.imitated(thin), beside.rows, 1)
        plain = np.where(criterion.weight > 0.0, plain, 0.0)  # not where a run begins
        length = float(np.linalg.norm(seen))
        whole = float(np.linalg.norm(criterion.whitened(beside.thinned(change)[None])))
        points = 100 * float((plain**2).sum()) / criterion.power
        too_strong = points > MOST_POINTS
        self.lost |= EXACT * beside.sigma < length < IMITATED * whole
        self.lost |= too_strong and self.fitted is not None and size == self.start
        if too_strong:
            return False
        if self.lost or not length > EXACT * beside.sigma:
            self.at[size] = [NONE, NONE, 0.0, 1.0, NONE, NONE]
            return False
        fits = float(seen @ beside.noise) / length
        scores = seen / length * (beside.noise - fits * seen / length)
        by_blocks = np.bincount(beside.blocks, scores / beside.sigma)
        shaken = np.bincount(beside.blocks, (plain * beside.residual).ravel())
        evidence = [judge.evidence_of(left) for judge in beside.judges]
        self.at[size] = [
            max(min(evidence), NONE),
            length / beside.sigma,
            fits / beside.sigma,
            max(float(by_blocks @ by_blocks), 1.0),
            points,
            200 * float(np.linalg.norm(shaken)) / criterion.power,
        ]
        return True

    def begin(self) -> bool:
        """Simulate a first size that shows something; whether there is one."""
        begun = any(self.simulate(min(times * self.start, self.most)) for times in BEGUN)
        return begun and not self.lost

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
        evidence, seen, fits, spread, points, unsure = np.array([self.at[size] for size in sizes]).T
        beyond = ask - np.clip(ask, at[0], at[-1])

        def grow(values: np.ndarray, power: int) -> np.ndarray:
            return np.exp(np.interp(ask, at, np.log(np.maximum(values, NONE))) + power * beyond)

        fits, spread = (np.interp(ask, at, values) for values in (fits, spread))
        first = self.at.get(self.start)
        if self.fitted is not None and first is not None:  # better than the slope at none
            fits = np.full_like(fits, self.fitted * first[1])
        evidence, points = grow(evidence, 2), grow(points, 2)
        return asked, AtSizes(evidence, grow(seen, 1), fits, spread, points, grow(unsure, 1))


def list_sides(
    beside: Beside, simulator: Simulator, theta: np.ndarray, name: str, size: str, is_fitted: bool
) -> list[Side]:
    """The sides of an effect's size, both where it has a sign, beside other numbers of theta."""
    effect = dict(simulator.effects.steps)[name]
    neutral = effect.neutral
    full, zero = f"{name}__{size}", float(neutral[size])
    i = simulator.names.index(full)
    low, high, scale = simulator.low[i], simulator.high[i], float(simulator.scale[i])
    value = float(theta[i])
    ends = [(1.0, high - zero), (-1.0, zero - low)]
    start, shares = max(abs(value - zero), LEAST_START * scale), (1.0, -1.0)
    if np.isinf(zero):
        ends, start = [(1.0, 1 / max(low, 1e-300))], 1 / value
    else:
        shares = (value - zero) / start, (zero - value) / start
    theta = theta.copy()
    for k, one in enumerate(simulator.names):  # other sizes do nothing
        if one.startswith(f"{name}__"):
            theta[k] = neutral.get(one.removeprefix(f"{name}__"), theta[k])
    return [
        Side(beside, simulator, theta, i, zero, sign, most, start, share)
        for (sign, most), share in zip(ends, shares if is_fitted else (None, None), strict=False)
        if most > 0.0
    ]


def list_numbers(
    fitted: Effect, values: dict[str, float], usual: Effect, record: Record
) -> list[tuple[dict[str, float], bool]]:
    """Numbers of the usual form of an effect, and whether they were fitted: these, and some starts.

    They differ in what is not its size. Where another form was fitted there are only starts.
    """
    alike = all(getattr(fitted, key, None) == getattr(usual, key, None) for key in usual.choices)
    free = [p.name for p in usual.free]
    tried = [({key: values[key] for key in free}, True)] if alike else []
    others = [key for key in free if key not in usual.neutral]
    for start in usual.starts(record):
        known = [[one[key] for key in others] for one, _ in tried]
        if [start[key] for key in others] not in known and len(tried) < TRIED:
            tried.append(({key: start[key] for key in free}, False))
    return tried


class Solved(NamedTuple):
    """Of one side: the largest size allowed and the least that is shown, each with its points."""

    limit: float
    limit_points: float
    shown: float
    shown_points: float

    def within(self, most: float) -> Solved:
        """The same, infinite where it is beyond the sizes that were simulated."""
        limit, shown = (
            (*pair,) if pair[0] <= most else (np.inf, np.inf) for pair in (self[:2], self[2:])
        )
        return Solved(*limit, *shown)


def solve(sides: list[Side], needed: float, least: float) -> list[Solved]:
    """What is asked of all sides, from the sizes that were simulated.

    Shown is what has the evidence ``needed`` (nats) and gains the ``least`` points.
    """
    asked = [side.at_sizes() for side in sides]
    losses = [(one.seen**2 - 2 * one.seen * one.fits) / (2 * one.spread) for _, one in asked]
    best = min(0.0, *(float(loss.min()) for loss in losses))
    found = []
    for (sizes, one), loss in zip(asked, losses, strict=True):
        sure = one.evidence - SURELY * np.sqrt(2 * one.spread * one.evidence)
        likely = sure >= needed
        likely &= one.points - SURELY * one.unsure >= least
        allowed = np.flatnonzero(loss <= best + ALLOWED)
        last = int(allowed[-1]) if allowed.size else 0
        first = int(np.argmax(likely))
        # Infinite is what these runs allow at any size, or would not have shown at any.
        limit = (sizes[last], one.points[last]) if last < N_SIZES - 1 else (np.inf, np.inf)
        shown = (sizes[first], one.points[first]) if likely.any() else (np.inf, np.inf)
        found.append(Solved(*limit, *shown))
    return found


def solve_to_the_end(sides: list[Side], needed: float, least: float) -> list[Solved]:
    """The same, with simulations at the sizes that are found, until these stay."""
    found = solve(sides, needed, least)
    for _ in range(ROUNDS):
        pairs = zip(sides, found, strict=True)
        if True not in [side.go_on(one.limit, one.shown) for side, one in pairs]:
            break
        found = solve(sides, needed, least)
    return [one.within(CLOSE * max(side.at)) for side, one in zip(sides, found, strict=True)]


def limit_effect(
    beside: Beside,
    candidate: Candidate,
    template: Effect,
    units: dict[str, str | None],
    needed: float,
) -> Limit:
    """The limit of an effect that was fitted beside a model, in the usual one of its forms.

    It is shown with the nats that are ``needed``.
    """
    fitted, name, parent = candidate.model, candidate.name, beside.model
    assert fitted is not None
    record = replace(parent.simulator.record, prediction=beside.output)
    effect = template.alternatives(record)[0].variants(record)[0]
    own = {n.removeprefix(f"{name}__"): value for n, value in fitted.values().items()}
    row = Limit(effect.name, title_of(effect.name), reason=NO_SIZE)
    size = next((p.name for p in effect.free if p.name in effect.neutral), None)
    if size is None:
        return row
    alike = begin_alike(parent, name, effect, effect.starts(record)[0])
    beside = beside if alike is parent else Beside(alike)
    effects = Effects([*parent.effects.steps, (name, effect)])
    simulator = Simulator(parent.simulator.core, effects, parent.simulator.record)
    sized = simulator.parameters[simulator.names.index(f"{name}__{size}")]
    zero = float(effect.neutral[size])
    inverse = np.isinf(zero)
    row.parameter, row.unit, row.reason = size, sized.label(units), NOT_SEEN
    row.sense = "at least" if inverse else "at most"
    more = len(effect.free) + effect.n_hidden
    needed += more / 2 * float(np.log(beside.criterion.n))
    least = LEAST_GAIN * beside.criterion.power_about_mean / max(beside.criterion.power, 1e-300)
    found = []
    for numbers, is_fitted in list_numbers(dict(fitted.effects.steps)[name], own, effect, record):
        values = parent.values() | {f"{name}__{key}": value for key, value in numbers.items()}
        theta = np.array([values[n] for n in simulator.names])
        sides = list_sides(beside, simulator, theta, name, size, is_fitted)
        if all(side.begin() for side in sides):
            found.append(solve_to_the_end(sides, needed, least))
        elif not found:
            return row
    # Of two sides the worse; shown is what would be with any of the other numbers.
    limit = max((one.limit, one.limit_points) for one in found[0])
    shown = max((one.shown, one.shown_points) for some in found for one in some)

    def told(size: float, points: float) -> tuple[float, float]:
        if np.isinf(size):
            return np.nan, np.nan
        return (1 / size if inverse else zero + size), points

    row.limit, row.limit_points = told(*limit)
    row.shown_from, row.shown_points = told(*shown)
    row.reason = ANY_SIZE if np.isnan([row.limit, row.shown_from]).any() else ""
    return row
