"""Pairs of effects: which go together, and what one is worth when the other is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace

import numpy as np
from baseline import SKIPPED, LinearOperator, vaf
from effects import Context, Effect, Operator, RunInputs, Wiring
from loop import U
from scipy.optimize import least_squares
from signals import KEPT
from world import World, opened

# An operator cannot have both, or their sum is one of them.
APART = (
    {"tv_gain", "gain_drift", "lapses", "scheduled_gain"},
    {"wrong_delay", "tv_delay"},
    {"dead_zone", "asym_gain", "rectified", "cubic_gain", "absolute_value"},
    {"saturation", "rate_limit", "backlash", "stiction", "quantised", "hardening_stiffness"},
    {"bias", "drift", "integral", "absolute_value"},
    {"feedforward", "preview", "output_feedback"},
    {"integral", "output_feedback"},
)
SINGLE = {"tremor", "extra_lag", "extra_lead", "nm_mode", "higher_order", "rectified"}


def draw_pair(rng: np.random.Generator, names: tuple[str, ...]) -> tuple[str, str]:
    """Two effects that may stand together, in random order."""
    allowed = [name for name in names if name not in SINGLE]
    while True:
        one, other = (str(name) for name in rng.choice(allowed, 2, replace=False))
        if not any({one, other} <= group for group in APART):
            return one, other


def worth(
    world: World,
    context: Context,
    runs: list[RunInputs],
    outs: list[np.ndarray],
    effects: list[Effect],
    left_out: int,
    delay: float | None,
    linear: LinearOperator,
    oracle_vaf: float,
    wired: Callable[..., Wiring],
) -> float:
    """Points of held-out VAF lost without one effect, the linear operator fitted anew.

    The fit is to two training runs, from the true operator or from the best linear one, whichever
    is nearer; the delay stays at the user's where it is wrong.
    """
    kept = [effect for i, effect in enumerate(effects) if i != left_out]
    fixed = delay if effects[left_out].name == "wrong_delay" else None
    true = np.array(astuple(world.operator))
    free = np.arange(5) != (2 if fixed is not None else 5)

    def operator_of(p: np.ndarray) -> Operator:
        full = true.copy()
        if fixed is not None:
            full[2] = fixed
        full[free] = true[free] * np.exp(p)
        return Operator(*full)

    def output(p: np.ndarray, which: slice) -> np.ndarray:
        changed = replace(world, operator=operator_of(p))
        pairs = zip(runs[which], outs[which], strict=True)
        return np.array(
            [opened(wired(changed, run, context, kept, True), out) for run, out in pairs]
        )

    def measured(which: slice) -> np.ndarray:
        return np.array([out[U, KEPT] for out in outs[which]])

    u = measured(slice(2))
    scale = np.sqrt(np.sum(u**2))

    def residual(p: np.ndarray) -> np.ndarray:
        return ((output(p, slice(2)) - u) / scale)[:, SKIPPED:].ravel()

    gains = np.maximum(linear.gains, 0.2 * true[:2])
    found = np.array([*gains, linear.tau, linear.omega_nm, linear.zeta_nm])
    starts = [np.zeros(int(free.sum())), np.clip(np.log(found / true), -1.4, 1.4)[free]]
    start = min(starts, key=lambda p: float(np.sum(residual(p) ** 2)))
    fit = least_squares(
        residual, start, bounds=(-1.5, 1.5), diff_step=5e-3, ftol=1e-4, xtol=1e-3, max_nfev=8
    )
    held_out = slice(len(runs) - 3, None)
    return oracle_vaf - vaf(measured(held_out), output(fit.x, held_out))
