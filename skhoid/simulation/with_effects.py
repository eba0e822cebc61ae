"""Effects in the closed loop, by the same simulation as in fits, repeated in sweeps.

The operator's response to a known error moves the error only after the delay. So the loop is closed
stretch by stretch: response and error are computed in turn until neither changes, which takes a few
sweeps for a stretch of a few delays. In this way effects are simulated by their own ``apply``,
including those of users.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.operator_signals import Gains
from ..effects.record import Record
from ..exceptions import UnstableLoopError
from ..human import HumanOperator, LinearElement
from ..human.variation import evaluate
from ..model.cores import OperatorCore
from ..model.simulator import Simulator

if TYPE_CHECKING:
    from .task import CompensatoryTask

RUN_IN = 20.0  # s; the default of seven windows is for loops with little damping
STRETCH = 2.0  # delays
SHORTEST = 0.1  # s, of a stretch
AHEAD = 3.0  # s of the forcing functions that a preview may ask for
SWEEPS = 100
SAME = 1e-9  # of the forcing functions
LOST = 1e2  # times the forcing functions: an error this large is not tracking

OPERATOR_GAINS = range(2, 6)  # columns of the physics, see _kernels.loop


class _Operator(Effect):
    """The gains of a HumanOperator, which may vary over time, as factors on gains of 1."""

    name = "operator"
    place = "gain"

    def __init__(self, *, operator: HumanOperator):
        self.operator = operator

    def apply(self, signal: Gains, record: Record, **values: float) -> Gains:
        given = self.operator.over_time(record.t[:, 0])
        error, rate, omega, zeta = (
            given[name][:, None] for name in ("K_e", "K_edot", "omega_nm", "zeta_nm")
        )
        return Gains(error, rate, omega, zeta)


def check_effects(task: CompensatoryTask) -> None:
    """Refuse effects without numbers, and operators that cannot have effects."""
    effects = Effects.of(task.effects)
    if not isinstance(task.operator, HumanOperator):
        raise ValueError(
            "CompensatoryTask: effects need a HumanOperator; the operator is a "
            f"{type(task.operator).__name__}."
        )
    if task.display != "compensatory":
        raise ValueError(
            "CompensatoryTask: with effects the display must be 'compensatory'; the effects "
            "feedforward and output_feedback respond to target and output."
        )
    for name, effect in effects:
        if effect.noise:
            raise ValueError(
                f"CompensatoryTask: {effect.name} is noise; add {effect.noise} of your own to y."
            )
        if effect.free:
            missing = ", ".join(f"{p.name}=" for p in effect.free)
            raise ValueError(
                f"CompensatoryTask: the effect {name} needs numbers to be simulated: "
                f"{type(effect).__name__}({missing})."
            )


def with_first_choices(
    task: CompensatoryTask, channels: dict[str, np.ndarray], t: np.ndarray
) -> Effects:
    """The effects with open choices (form, channel) made: the first option of each."""
    window = t[:, 0] > -0.5 / task.sampling_rate
    record = _record(task, {n: c[window] for n, c in channels.items()}, t[window])
    steps = []
    for name, effect in Effects.of(task.effects):
        reason = effect.refusal(record, OperatorCore(task.operator.tau_e).kind)
        if reason is not None:
            raise ValueError(f"CompensatoryTask: the effect {name} does not apply: {reason}.")
        steps.append((name, effect.variants(record)[0]))
    return Effects(steps)


def track_with_effects(
    task: CompensatoryTask,
    track: Callable[..., tuple[np.ndarray, np.ndarray]],
    f_t: np.ndarray,
    f_d: np.ndarray,
    white: np.ndarray,
    physics: np.ndarray,
) -> np.ndarray:
    """Signals e, u, x, n of runs of a task with effects, of shape (4, n_total, n_runs).

    ``track(f_t, f_d, white, physics)`` runs the loop of ``_kernels.loop`` from its first sample.
    """
    n_total, dt = white.shape[0], 1 / task.sampling_rate
    t = (np.arange(-task.n_run_in, task.n_samples) * dt)[:, None]
    out = track(f_t, f_d, white, physics)[0]
    silent = physics.copy()
    silent[:, OPERATOR_GAINS] = 0.0
    channels = {"e": out[0], "x": out[2], "f_t": np.broadcast_to(f_t, out[0].shape)}
    if f_d.any():
        channels["dist"] = np.broadcast_to(f_d, out[0].shape)
    effects = Effects([("operator", _Operator(operator=task.operator))])
    effects = Effects([*effects.steps, *with_first_choices(task, channels, t).steps])
    core, ones = OperatorCore(task.operator.tau_e), np.ones(4)

    answer = np.zeros(out[0].shape)
    size = max(np.abs(f_t).max(), np.abs(f_d).max()) or 1.0
    step = max(round(STRETCH * task.operator.tau_e / dt), round(SHORTEST / dt), 1)
    for end in [*range(step, n_total, step), n_total]:
        shown = min(end + round(AHEAD / dt), n_total)
        for _ in range(SWEEPS):
            record = _record(task, {n: c[:shown] for n, c in channels.items()}, t[:shown])
            new = Simulator(core, effects, record).run(ones)[:end]
            change = np.abs(new - answer[:end]).max()
            answer[:end] = new
            moved = answer[:end] + (f_d[:end] if f_d.shape[1] > 1 else f_d[:end, :1])
            out = track(f_t[:end], moved, white[:end], silent)[0]
            channels["e"][:end], channels["x"][:end] = out[0], out[2]
            if not change > SAME * size:
                break
        else:
            raise ValueError(
                f"The loop with the effects {effects.names[1:]} cannot be solved at "
                f"t = {t[end - 1, 0]:.2f} s: they respond without delay to signals that they move."
            )
        if not np.abs(out[0]).max() < LOST * size:
            raise UnstableLoopError(
                f"The loop with the effects {effects.names[1:]} is unstable: its error passes "
                f"{LOST:g} times the forcing functions by t = {t[end - 1, 0]:.2f} s."
            )
    out[1] += answer
    return out


def _record(task: CompensatoryTask, channels: dict[str, np.ndarray], t: np.ndarray) -> Record:
    element = task.controlled_element
    K_c, omega_b = (float(evaluate(p, np.zeros(1))[0]) for p in (element.K_c, element.omega_b))
    return Record(
        dt=1 / task.sampling_rate,
        t=t,
        channels=channels,
        roles={name: name for name in channels},
        inputs=("e",),
        known=np.ones(channels["e"].shape, dtype=bool),
        controlled_element=LinearElement((K_c,), (1.0, omega_b, 0.0)),
    )
