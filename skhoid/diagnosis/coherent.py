"""The part of signals that is caused from outside the loop and is independent of the remnant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from .repeats import Group

if TYPE_CHECKING:
    from .run_signals import Signals

N_TAPS = 40  # of the response to a target, at most
RANK = 1e-8  # of the strongest direction of the target's past; weaker ones are left alone


@dataclass(frozen=True)
class TargetResponse:
    """Finite impulse responses to the target of one run: those of several signals, by name.

    The last coefficient is that of a constant.
    """

    taps: np.ndarray
    coefficients: dict[str, np.ndarray]

    @classmethod
    def of(cls, target: np.ndarray, signals: dict[str, np.ndarray], dt: float) -> TargetResponse:
        """Least squares of all signals at once, which share the past of the target."""
        target = target - target.mean()
        step = tap_spacing(target[None], dt)
        taps = step * np.arange(min(N_TAPS, target.size // (8 * step)))
        past = np.column_stack([lagged_from_rest(target, taps), np.ones(target.size)])
        values = np.column_stack(list(signals.values()))
        found = np.linalg.lstsq(past, values, rcond=RANK)[0]
        return cls(taps, dict(zip(signals, found.T, strict=True)))

    def to(self, target: np.ndarray, name: str) -> np.ndarray:
        """Response of a signal to the target that the responses were estimated with."""
        target = target - target.mean()
        *coefficients, level = self.coefficients[name]
        response = np.full(target.size, level)
        for lag, coefficient in zip(self.taps, coefficients, strict=True):
            response[lag:] += coefficient * target[: target.size - lag]
        return response


def coherent_part(signals: Signals, group: Group, name: str) -> np.ndarray | None:
    """Part of a signal, run by run, that is caused from outside the loop.

    With repeats the mean of the other runs; with a periodic target and one run the excited lines;
    otherwise the response to the target by a finite impulse response. None where there is no way:
    what remains would be correlated with the noise of its own run.
    """
    if group.n_runs > 1:
        values = signals.named(name)[group.rows]
        return (values.sum(axis=0) - values) / (group.n_runs - 1)
    if group.lines is not None:
        return on_lines(signals.named(name)[group.rows], group)
    if "f_t" not in signals.channels:
        return None
    return response_to_target(signals, group, name)


def response_to_target(signals: Signals, group: Group, name: str) -> np.ndarray:
    """Response of a signal of the only run of a group to the target."""
    target = signals.channels["f_t"][group.rows[0]]
    return signals.target_responses[int(group.runs[0])].to(target, name)[None]


def on_lines(values: np.ndarray, group: Group) -> np.ndarray:
    """Part of signals at the excited lines."""
    spectrum = fft.rfft(values, axis=-1)
    kept = np.zeros_like(spectrum)
    kept[..., group.lines] = spectrum[..., group.lines]
    return fft.irfft(kept, group.n_samples, axis=-1)


def lagged_from_rest(signal: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Columns signal(t - lag), zero before the signal begins."""
    out = np.zeros((taps.size, signal.size))
    for row, lag in zip(out, taps, strict=True):
        row[lag:] = signal[: signal.size - lag]
    return out.T


def bandwidth(signal: np.ndarray, dt: float, share_of_power: float = 0.99) -> float:
    """Frequency (rad/s) below which signals (rows) have most of their power."""
    power = (np.abs(fft.rfft(signal - signal.mean(axis=1, keepdims=True))) ** 2).sum(axis=0)
    share = np.cumsum(power) / power.sum() if power.any() else np.ones(power.size)
    return 2 * np.pi * max(int(np.searchsorted(share, share_of_power)), 1) / (signal.shape[1] * dt)


def tap_spacing(signal: np.ndarray, dt: float) -> int:
    """Samples between taps that resolve a signal within its bandwidth."""
    return max(int(0.7 / (bandwidth(signal, dt) * dt)), 1)
