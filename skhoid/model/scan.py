"""Scans: what a model with an added effect leaves unexplained, computed cheaply for many values."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from .. import _kernels
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.record import differentiated
from .cores import BOUND
from .fitting import Criterion, minimise
from .model import Model, scaled_sse, start_beside
from .simulator import Simulator
from .tied import Tied

FOLLOWED = 3  # iterations from a value that is scanned


class Scan:
    """The :class:`~skhoid.effects.ErrorScan` of an effect added to a parent model.

    ``bent`` says whether missing effects may have distorted the parent.
    """

    def __init__(
        self, parent: Model, name: str, variant: Effect, coarse: Criterion, *, bent: bool = True
    ):
        self.parent, self.name, self.variant, self.coarse = parent, name, variant, coarse
        self.bent = bent
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
        record = replace(self.coarse.record, y=output, _derived={})
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
        theta = start_beside(self.parent, simulator, self.name, values)
        return scaled_sse(simulator, short, theta)

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

    def left_by_events(self, points: np.ndarray, seconds: float, of_error: bool) -> np.ndarray:
        simulator, short = self.on_first(seconds)
        position, slope = self.commands(seconds)
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
        )

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
        theta = start_beside(self.parent, simulator, self.name, values)
        mine = np.array([name.startswith(f"{self.name}__") for name in simulator.names])
        tied = Tied(simulator, theta)
        fit = minimise(tied, coarse, tied.to(theta), max_iter=FOLLOWED, tol=1e-3, fixed=mine)
        found = dict(zip(simulator.names, tied.back(fit.theta).tolist(), strict=True))
        own = {k: found.get(f"{self.name}__{k}", v) for k, v in values.items() if k[0] != "+"}
        return fit.sse, own | {f"+{k}": found[k] - v for k, v in self.parameters.items()}
