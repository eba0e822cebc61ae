"""What a model leaves for many values of an effect beside a parent, cheaply."""

from __future__ import annotations

from collections.abc import Sequence
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

ORDINARY = {"omega_nm": 11.0, "zeta_nm": 0.35}  # neuromuscular system of an operator
FOLLOWED = 3  # iterations from a value that is scanned


class Scan:
    """Error of the first seconds of some runs for values of an effect beside a parent."""

    def __init__(self, parent: Model, name: str, variant: Effect, coarse: Criterion):
        self.parent, self.name, self.variant, self.coarse = parent, name, variant, coarse
        self.by_seconds: dict[float, tuple[Simulator, Criterion]] = {}
        self.commands: dict[tuple[float, float], tuple[np.ndarray, np.ndarray]] = {}

    @cached_property
    def cores(self) -> list[dict[str, float]]:
        """Parameters of the parent, and of one with an ordinary neuromuscular system.

        What is missing bends a parent.
        """
        values = self.parent.values()
        found = [values]
        if "omega_nm" in values:
            values = values | ORDINARY
            fixed = np.array([name not in ("K_e", "K_edot", "tau_e") for name in values])
            start = np.array(list(values.values()))
            effects, record = self.parent.effects, self.coarse.record
            simulator = Simulator(self.parent.simulator.core, effects, record)
            plain = minimise(simulator, self.coarse, start, max_iter=4, tol=1e-3, fixed=fixed)
            found.append(dict(zip(values, plain.theta.tolist(), strict=True)))
        return found

    def earlier(self, seconds: float) -> dict[str, float]:
        """Changes of the parent to the last of ``cores``, answering that much earlier."""
        parent, core = self.parent.values(), self.cores[-1]
        change = {f"+{name}": core[name] - parent[name] for name in core}
        if "tau_e" in core:
            change["+tau_e"] -= seconds
        elif "K_edot" in core:
            change["+K_edot"] += core["K_e"] * seconds
        return {name: value for name, value in change.items() if value}

    def on(self, seconds: float) -> tuple[Simulator, Criterion]:
        """The model on the first seconds."""
        if seconds not in self.by_seconds:
            short = Criterion(self.coarse.record.beginning(seconds), rate=self.coarse.rate)
            together = Effects([*self.parent.effects.steps, (self.name, self.variant)])
            simulator = Simulator(self.parent.simulator.core, together, short.record)
            self.by_seconds[seconds] = simulator, short
        return self.by_seconds[seconds]

    def __call__(self, values: dict[str, float], seconds: float) -> float:
        simulator, short = self.on(seconds)
        theta = start_beside(self.parent, simulator, self.name, values)
        return scaled_sse(simulator, short, theta)

    def parts(self, seconds: float, ahead: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Command by the error, by the last of ``cores``, and its rate; (n, runs).

        Where the delay is free it is shorter by ``ahead``.
        """
        core = dict(self.cores[-1])
        if "tau_e" not in core:
            ahead = 0.0
        if (seconds, ahead) not in self.commands:
            record = self.coarse.record.beginning(seconds)
            simulator = Simulator(self.parent.simulator.core, self.parent.effects, record)
            if ahead:
                core["tau_e"] = max(core["tau_e"] - ahead, 0.0)
            simulator.run(np.array([core[name] for name in simulator.names]))
            position = np.ascontiguousarray(simulator.last_state.command.position)
            self.commands[seconds, ahead] = position, differentiated(position, record.dt)
        return self.commands[seconds, ahead]

    def matrices(self, dt: float) -> tuple[np.ndarray, float]:
        """The neuromuscular system of the last of ``cores``, and its 2 zeta omega."""
        omega, zeta = (np.array([self.cores[-1][name]]) for name in ("omega_nm", "zeta_nm"))
        return _kernels.greybox.held_linearly(omega, zeta, dt), float(2 * zeta[0] * omega[0])

    def left_by_events(self, points: np.ndarray, seconds: float, of_error: bool) -> np.ndarray:
        """What commands held by events leave, at points; see the kernel."""
        simulator, short = self.on(seconds)
        position, slope = self.parts(seconds)
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
        """Squares that the best sums of answers to commands (n, runs, count) leave.

        Their rates, which count beside them, make up for another neuromuscular system.
        """
        simulator, short = self.on(seconds)
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
        """Squares on the whole, and values, with the parent's parameters fitted beside them."""
        simulator, coarse = self.on(np.inf)
        theta = start_beside(self.parent, simulator, self.name, values)
        mine = np.array([name.startswith(f"{self.name}__") for name in simulator.names])
        parent = self.parent.values()
        tied = Tied(simulator, theta[simulator.names.index("K_e")] if "K_e" in parent else 0.0)
        fit = minimise(tied, coarse, tied.to(theta), max_iter=FOLLOWED, tol=1e-3, fixed=mine)
        found = dict(zip(simulator.names, tied.back(fit.theta).tolist(), strict=True))
        own = {k: found.get(f"{self.name}__{k}", v) for k, v in values.items() if k[0] != "+"}
        return fit.sse, own | {f"+{k}": found[k] - v for k, v in parent.items()}
