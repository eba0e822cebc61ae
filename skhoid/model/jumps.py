"""Scans of an added effect, and fits where the response jumps with its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.optimize import differential_evolution

from .. import _kernels
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.parameter import U
from ..effects.record import differentiated
from .cores import BOUND
from .effort import is_spent
from .fitting import Criterion, Fit, RemnantModel, minimise, sse_at
from .model import Model, find_scaled_sse, make_start
from .simulator import Simulator


class Tied(Simulator):
    """A simulator whose thresholds of the command follow the gains.

    A command and its thresholds that grow by the same factor have the same events. In vectors
    theta, thresholds are those at the gain of ``reference``, which is such a vector too.
    """

    def __init__(self, simulator: Simulator, reference: np.ndarray):
        super().__init__(simulator.core, simulator.effects, simulator.record)
        tied = [
            f"{name}__{p.name}"
            for name, effect in self.effects
            for p in effect.free
            if effect.place == "command" and p.dimension == U
        ]
        gains = self.core.gains
        self.gain = self.names.index(gains[0]) if gains else 0
        self.reference = abs(float(reference[self.gain])) if gains else 0.0
        self.tied = np.array([self.reference > 0.0 and name in tied for name in self.names])

    def factor(self, theta: np.ndarray) -> float:
        return self.reference / max(abs(theta[self.gain]), 1e-3 * self.reference)

    def to(self, theta: np.ndarray) -> np.ndarray:
        return np.where(self.tied, theta * self.factor(theta), theta) if self.tied.any() else theta

    def back(self, theta: np.ndarray) -> np.ndarray:
        if not self.tied.any():
            return theta
        return np.clip(np.where(self.tied, theta / self.factor(theta), theta), self.low, self.high)

    def run(self, theta: np.ndarray) -> np.ndarray:
        self._given = theta
        return super().run(self.back(theta))

    def run_with_change(self, position: int, value: float) -> np.ndarray:
        if position != self.gain or not self.tied.any():
            theta = self._given.copy()
            theta[position] = value
            return super().run_with_change(position, float(self.back(theta)[position]))
        before = self._theta
        theta = self._given.copy()
        theta[position] = value
        # The gain comes before the thresholds: every stage after it runs again.
        self._theta = self.back(theta)
        output = super().run_with_change(position, value)
        self._theta = before
        return output

    def back_fit(self, fit: Fit) -> Fit:
        """The fit with its normal equations in the parameters of the model."""
        if not self.tied.any():
            return fit
        by = np.eye(fit.theta.size)
        by[self.tied, self.tied] = self.factor(fit.theta)
        by[self.tied, self.gain] = -fit.theta[self.tied] / (fit.theta[self.gain] or 1.0)
        theta, normal = self.back(fit.theta), by.T @ fit.normal @ by
        return replace(fit, theta=theta, normal=normal, gradient=by.T @ fit.gradient)


PHASES = 4  # of a refractory time, at which the first event of a window is tried
FOLLOWED = 3  # iterations from a value that is scanned


class Scan:
    """The :class:`~skhoid.effects.ErrorScan` of an effect added to a parent model.

    ``bent`` says whether missing effects may have distorted the parent, ``again`` whether the
    effect was scanned beside a smaller one, ``asked`` what share of the squares it has to save.
    """

    def __init__(
        self,
        parent: Model,
        name: str,
        variant: Effect,
        coarse: Criterion,
        *,
        bent: bool = True,
        again: bool = False,
        asked: float = 0.0,
    ):
        self.parent, self.name, self.variant, self.coarse = parent, name, variant, coarse
        self.bent, self.again, self.asked = bent, again, asked
        self.parameters = parent.values()
        self.explores = coarse.rate < coarse.record.criterion_rate
        self.by_seconds: dict[float, tuple[Simulator, Criterion]] = {}
        self.by_lead: dict[tuple[float, float], tuple[np.ndarray, np.ndarray]] = {}

    def of(self, variant: Effect) -> Scan:
        """The scan of another variant, with what is the same for all that has been computed."""
        other = copy(self)
        other.variant, other.by_seconds = variant, {}
        return other

    @cached_property
    def ordinary(self) -> dict[str, float]:
        core = self.parent.simulator.core
        if not (self.bent and core.ordinary):
            return self.parameters
        values = {**self.parameters, **core.ordinary}
        fixed = np.array([name not in core.gains + core.delays for name in values])
        start = np.array(list(values.values()))
        simulator = Simulator(core, self.parent.effects, self.coarse.record)
        plain = minimise(simulator, self.coarse, start, max_iter=4, tol=1e-3, fixed=fixed)
        return dict(zip(values, plain.theta.tolist(), strict=True))

    @cached_property
    def residual(self) -> np.ndarray:
        record = self.coarse.record
        simulator = Simulator(self.parent.simulator.core, self.parent.effects, record)
        assert record.y is not None
        return np.where(record.known, record.y - simulator.run(self.parent.theta), 0.0)

    def earlier(self, seconds: float) -> dict[str, float]:
        change = {f"+{name}": self.ordinary[name] - v for name, v in self.parameters.items()}
        for name, by in self.parent.simulator.core.earlier(self.ordinary, seconds).items():
            change[f"+{name}"] += by
        return {name: value for name, value in change.items() if value}

    def refitted(
        self, output: np.ndarray, against: np.ndarray | None = None
    ) -> list[tuple[dict[str, float], np.ndarray]]:
        core = self.parent.simulator.core
        record = replace(self.coarse.record, y=output, remembered={})
        x = record.input
        if against is not None:
            dead = round(record.ahead / record.dt) if np.isfinite(record.ahead) else 0
            x = x - np.concatenate([against[dead:], np.zeros_like(against[:dead])])
        simulator = Simulator(core, Effects([]), record.changed({record.inputs[0]: x}))
        found = []
        for theta in core.starts_for(record, x):
            values = dict(zip(simulator.names, theta.tolist(), strict=True))
            changes = {f"+{name}": v - self.parameters[name] for name, v in values.items()}
            found.append((changes, simulator.run(theta)))
        return found

    def on_first(self, seconds: float) -> tuple[Simulator, Criterion]:
        """The model on the first seconds."""
        if seconds not in self.by_seconds:
            short = Criterion(self.coarse.record.beginning(seconds), rate=self.coarse.rate)
            together = Effects([*self.parent.effects.steps, (self.name, self.variant)])
            simulator = Simulator(self.parent.simulator.core, together, short.record)
            self.by_seconds[seconds] = simulator, short
        return self.by_seconds[seconds]

    def __call__(self, values: dict[str, float], seconds: float) -> float:
        simulator, short = self.on_first(seconds)
        theta = make_start(self.parent, simulator, self.name, values)
        return find_scaled_sse(simulator, short, theta)

    def commands(self, seconds: float, ahead: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        core = self.parent.simulator.core
        if not core.delays:
            ahead = 0.0
        if (seconds, ahead) not in self.by_lead:
            record = self.coarse.record.beginning(seconds)
            simulator = Simulator(core, self.parent.effects, record)
            values = dict(self.ordinary)
            if ahead:
                for name in core.delays:
                    values[name] = max(values[name] - ahead, core.least_delay(record.dt))
            simulator.run(np.array([values[name] for name in simulator.names]))
            position = np.ascontiguousarray(simulator.last_state.command.position)
            self.by_lead[seconds, ahead] = position, differentiated(position, record.dt)
        return self.by_lead[seconds, ahead]

    def matrices(self, dt: float) -> tuple[np.ndarray, float]:
        """The ordinary response to a held command, and its 2 zeta omega."""
        found = self.parent.simulator.core.second_order(self.ordinary)
        if found is None:
            raise ValueError(
                f"{type(self.variant).__name__} calls left or left_by_events, which need an "
                "operator as the core; with other cores, call error_of(values, seconds)."
            )
        omega, zeta = (np.array([value]) for value in found)
        return _kernels.greybox.held_linearly(omega, zeta, dt), float(2 * zeta[0] * omega[0])

    def left_by_events(
        self,
        points: np.ndarray,
        seconds: float,
        of_error: bool,
        *,
        ahead: float = 0.0,
        window: float = np.inf,
    ) -> np.ndarray:
        simulator, short = self.on_first(seconds)
        position, slope = self.commands(seconds, ahead)
        dt = simulator.record.dt
        matrices, damping = self.matrices(dt)
        return _kernels.greybox.events_scanned(
            position,
            slope,
            short.y,
            short.known,
            points / np.array([dt, 1.0, 1.0, 1.0]),
            matrices,
            damping,
            of_error,
            short.thin,
            self._rows_of(window, short),
            0 if np.isinf(window) else PHASES,
        )

    def _rows_of(self, window: float, short: Criterion) -> int:
        record, thin = short.record, short.thin
        seconds = min(window, record.duration + record.dt)
        return thin * round(seconds / record.dt / thin + 1)

    def left_without(self, seconds: float, window: float = np.inf) -> float:
        _, short = self.on_first(seconds)
        rows, row = self._rows_of(window, short), np.arange(len(short.y)) * short.thin
        counts = (
            short.known if np.isinf(window) else short.known & (row % rows >= rows // 4)[:, None]
        )
        left = self.residual[: len(short.record.t) : short.thin]
        return float((left[counts] ** 2).sum())

    def left(self, columns: Sequence[np.ndarray], seconds: float) -> np.ndarray:
        simulator, short = self.on_first(seconds)
        matrices, _ = self.matrices(simulator.record.dt)
        n, runs, count = columns[0].shape
        answers = []
        for column in columns:
            flat = np.ascontiguousarray(column.reshape(n, runs * count))
            rest = np.zeros_like(flat)
            y = _kernels.greybox.second_order(flat, rest, matrices, 0.0, 0.0, BOUND)
            rate = np.empty_like(y)
            rate[1:-1], rate[0], rate[-1] = y[2:] - y[:-2], 0.0, 0.0
            answers += [y[:: short.thin], rate[:: short.thin]]
        table = np.stack(answers).reshape(len(answers), -1, count)
        known = short.known.ravel()
        y = short.y.ravel()
        if not known.all():
            table, y = table[:, known], y[known]
        k = len(answers)
        gram = np.empty((count, k, k))
        for i in range(k):
            for j in range(i + 1):
                gram[:, i, j] = gram[:, j, i] = np.einsum("ij,ij->j", table[i], table[j])
        right = np.stack([y @ table[i] for i in range(k)], axis=1)
        size = np.sqrt(np.einsum("kii->ki", gram)) + 1e-150
        gram = gram / (size[:, :, None] * size[:, None, :]) + 1e-6 * np.eye(k)
        right = right / size
        solved = np.linalg.solve(gram, right[:, :, None])[:, :, 0]
        return np.asarray(y @ y - np.einsum("ki,ki->k", solved, right))

    def fitted(self, values: dict[str, float]) -> tuple[float, dict[str, float]]:
        simulator, coarse = self.on_first(np.inf)
        theta = make_start(self.parent, simulator, self.name, values)
        mine = np.array([name.startswith(f"{self.name}__") for name in simulator.names])
        tied = Tied(simulator, theta)
        fit = minimise(tied, coarse, tied.to(theta), max_iter=FOLLOWED, tol=1e-3, fixed=mine)
        found = dict(zip(simulator.names, tied.back(fit.theta).tolist(), strict=True))
        own = {k: found.get(f"{self.name}__{k}", v) for k, v in values.items() if k[0] != "+"}
        return fit.sse, own | {f"+{k}": found[k] - v for k, v in self.parameters.items()}


N_AGAIN = 2  # scans around what was found
SOFT = (0.1, 0.05, 0.025, 0.012)  # corners, ever sharper
# How far off estimates in a wrong minimum are, relative.
OFF = 0.05
OFF_LEAD = 0.2  # gains but the first: a lead and a lag trade places
OFF_USUAL = 0.3  # of what is usual for the others
WIDEST = 12.0  # times as far off, at most
RUNS_EVOLVED = 2
POPULATION, GENERATIONS = 80, 60
DRAWN = 30  # points of an effect's cube for each member of the first generation
CHAINS, STEPS = 16, 60
SHARES = (0.2, 0.6, 0.95)  # of the difference of two chains; the second is usual for few parameters
DIVERGED = 1e3  # times the squares of the start


def search_pattern(
    model: Model, name: str, criterion: Criterion, sizes: tuple[float, ...]
) -> Model:
    """Pattern search over the parameters of an effect whose response is not smooth in them.

    The other parameters follow each step.
    """
    simulator = model.simulator
    softer = _follow_softened(model, name, criterion)
    if softer is not None:
        return softer
    tied = Tied(simulator, model.theta)
    mine = [i for i, n in enumerate(simulator.names) if n.startswith(f"{name}__")]
    fixed = np.zeros(model.theta.size, dtype=bool)
    fixed[mine] = True
    best = replace(model.fit, theta=tied.to(model.theta))
    for _ in range(N_AGAIN):
        before = best.sse
        for start in _find_starts_beside(simulator, name, criterion, tied.back(best.theta), model):
            trial = minimise(tied, criterion, tied.to(start), max_iter=6, fixed=fixed)
            best = trial if trial.sse < best.sse else best
        if not best.sse < 0.999 * before:
            break
    for size in sizes:
        for i in [] if is_spent() else mine:
            width = size * max(abs(best.theta[i]), 0.1 * simulator.scale[i])
            for sign in (1.0, -1.0):
                for _ in range(4):
                    theta = best.theta.copy()
                    theta[i] += sign * width
                    trial = minimise(tied, criterion, theta, max_iter=1, fixed=fixed)
                    if not trial.sse < best.sse:
                        break
                    best = trial
        best = minimise(tied, criterion, best.theta, max_iter=4, fixed=fixed)
    return Model(simulator, tied.back_fit(best), model.other_cores)


def _follow_softened(model: Model, name: str, criterion: Criterion) -> Model | None:
    """The fit of an effect whose corners are softened at first and then sharpened."""
    simulator = model.simulator
    theta = model.theta
    for amount in SOFT:
        soft = simulator.with_soft_corners(amount, only=name)
        if soft is simulator:
            return None
        theta = minimise(soft, criterion, theta, max_iter=8, tol=1e-4).theta
    sharp = minimise(simulator, criterion, theta, max_iter=4)
    return Model(simulator, min(sharp, model.fit, key=lambda fit: fit.sse), model.other_cores)


def _find_starts_beside(
    simulator: Simulator, name: str, criterion: Criterion, theta: np.ndarray, model: Model
) -> list[np.ndarray]:
    """Starts that an effect proposes near given parameters, on the record of a criterion."""
    variant = dict(simulator.effects.steps)[name]
    found = dict(zip(simulator.names, theta.tolist(), strict=True))
    fewer = Effects([item for item in simulator.effects if item[0] != name])
    plain = Simulator(simulator.core, fewer, simulator.record)
    rest = {n: found[n] for n in plain.names}
    fit = replace(model.fit, theta=np.array(list(rest.values())))
    scan = Scan(Model(plain, fit), name, variant, criterion, bent=False)
    own = {n.split("__")[-1]: v for n, v in found.items() if n not in rest} | variant.fixed
    values = variant.scanned_beside(scan, own)
    return [make_start(scan.parent, simulator, name, v) for v in values]


def evolve(model: Model, name: str, criterion: Criterion) -> tuple[Model, np.ndarray]:
    """The model at the best minimum by differential evolution, if that is better than its own.

    All parameters together, on some runs: events of an effect that jumps depend on the core too,
    and whitened residuals have deep and narrow minima. Returned too are the distances from the best
    of the last generation, of shape (POPULATION, n_parameters).
    """
    simulator, record = model.simulator, criterion.record
    runs = np.sort(np.argsort(-record.known.sum(axis=0), kind="stable")[:RUNS_EVOLVED])
    some = record if runs.size == record.n_runs else record.part(runs, 1)
    few = simulator.on_record(some)
    noise = RemnantModel(criterion.noise.ar, criterion.noise.scale[runs])
    on_few = Criterion(some, noise, rate=criterion.rate)
    effect = dict(simulator.effects.steps)[name]
    keys = [p.name for p in effect.free]
    mine = np.array([simulator.names.index(f"{name}__{key}") for key in keys])
    rest = np.setdiff1d(np.arange(model.theta.size), mine)
    values = {key: float(model.theta[i]) for key, i in zip(keys, mine, strict=True)}
    off = _guess_how_far_off(model)
    low = np.maximum(simulator.low, model.theta - WIDEST * off)[rest]
    high = np.minimum(simulator.high, model.theta + WIDEST * off)[rest]
    start = sse_at(few, on_few, model.theta)

    def at(point: np.ndarray) -> np.ndarray:
        theta = model.theta.copy()
        theta[rest] = point[: rest.size]
        found = effect.within_cube(values, point[rest.size :], record)
        theta[mine] = [found[key] for key in keys]
        return np.clip(theta, simulator.low, simulator.high)

    def left(point: np.ndarray) -> float:
        return min(sse_at(few, on_few, at(point)), DIVERGED * start)

    rng = np.random.default_rng(0)
    first = np.empty((POPULATION, model.theta.size))
    for member in first:
        member[: rest.size] = model.theta[rest] + off[rest] * rng.standard_normal(rest.size)
        member[: rest.size] = np.clip(member[: rest.size], low, high)
        cube = rng.uniform(size=(DRAWN, mine.size))
        drawn = [np.r_[member[: rest.size], own] for own in cube]
        member[:] = min(drawn, key=left)
    bounds = [*zip(low, high, strict=True), *[(0.0, 1.0)] * mine.size]
    best = differential_evolution(
        left, bounds, init=first, maxiter=GENERATIONS, tol=1e-5, polish=False, rng=rng,
        mutation=(0.3, 0.9), recombination=0.8,
    )  # fmt: skip
    fixed = np.zeros(model.theta.size, dtype=bool)
    fixed[mine] = True
    fit = minimise(simulator, criterion, at(best.x), max_iter=6, fixed=fixed)
    found = Model(simulator, fit, model.other_cores) if fit.sse < model.sse else model
    return found, np.array([at(point) for point in best.population]) - at(best.x)


def _guess_how_far_off(model: Model) -> np.ndarray:
    """What to add to or subtract from parameters of a first generation, typically."""
    simulator, core = model.simulator, model.simulator.core
    relative = dict.fromkeys(simulator.names, OFF) | dict.fromkeys(core.gains[1:], OFF_LEAD)
    relative |= {n: OFF_USUAL * one.spread for n, one in core.usual.items() if one.relative}
    sizes = [simulator.size(i, value) for i, value in enumerate(model.theta)]
    return np.array([relative[n] for n in simulator.names]) * sizes


def wander(model: Model, criterion: Criterion, apart: np.ndarray) -> tuple[Model, np.ndarray]:
    """The likeliest parameters that Markov chains pass, and the covariance of chains about them.

    A likelihood with many narrow minima side by side has no slopes that would tell how far the
    estimates may be off. Each chain steps along the difference of two others (Ter Braak 2006, A
    Markov chain Monte Carlo version of the genetic algorithm differential evolution).
    """
    simulator = model.simulator
    rng = np.random.default_rng(0)
    chains = np.clip(model.theta + apart[:CHAINS], simulator.low, simulator.high)
    chains[0] = model.theta
    squares = np.array([sse_at(simulator, criterion, theta) for theta in chains])
    best = int(squares.argmin())
    likeliest, least = chains[best].copy(), float(squares[best])
    passed = []
    for k in range(STEPS):
        for i in range(CHAINS):
            one, other = rng.choice(CHAINS, size=2, replace=False)
            theta = chains[i] + rng.choice(SHARES) * (chains[one] - chains[other])
            if not ((theta >= simulator.low) & (theta <= simulator.high)).all():
                continue
            sse = sse_at(simulator, criterion, theta)
            odds = criterion.n / 2 * (squares[i] - sse) / least
            if np.log(rng.uniform()) < odds:
                chains[i], squares[i] = theta, sse
            if sse < least:
                likeliest, least = theta.copy(), sse
        if k >= STEPS // 2:
            passed.append(chains.copy())
    away = np.concatenate(passed) - likeliest
    return model.at(likeliest), away.T @ away / len(away)
