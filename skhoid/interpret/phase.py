"""Unwrapping the phase of frequency responses at sparse lines."""

from __future__ import annotations

import numpy as np

LONGEST_DELAY, DELAY_STEP = 1.0, 0.005  # s


def aligning_delay(omega: np.ndarray, response: np.ndarray) -> float:
    """The delay, up to 1 s, without which the phases of neighbouring lines agree best."""
    phasors = _phasors(np.atleast_2d(response))
    steps = np.nan_to_num(phasors[:, 1:] * phasors[:, :-1].conj()).sum(axis=0)
    candidates = np.arange(0.0, LONGEST_DELAY + DELAY_STEP / 2, DELAY_STEP)
    turns = np.exp(1j * np.outer(candidates, np.diff(omega)))
    return float(candidates[np.argmax((turns @ steps).real)])


def phase_without_jumps(omega: np.ndarray, response: np.ndarray, delay: float) -> np.ndarray:
    """Phase in rad, without jumps after a delay is removed; runs follow their mean."""
    turn = omega * delay
    together = np.nan_to_num(_phasors(np.atleast_2d(response))).sum(axis=0)
    known = together != 0
    phase = np.full(omega.shape, np.nan)
    if known.any():
        phase[known] = np.unwrap(np.angle((together * np.exp(1j * turn))[known])) - turn[known]
        phase -= 2 * np.pi * np.ceil(phase[known][0] / (2 * np.pi) - 0.5)
    return phase + np.angle(response * np.exp(-1j * phase))


def _phasors(response: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return response / np.abs(response)
