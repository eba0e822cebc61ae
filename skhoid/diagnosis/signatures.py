"""What an output alone shows of effects that act behind the remnant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.stats import chi2

from ..effects.record import Record

PILED = 0.02  # of the samples, at least, lie at a stop
PILED_RATES = 0.10  # of the rates lie at the greatest rate
RECURRING = 0.02  # as many distinct values as this share of the samples, at most, are levels
COARSE = 0.1  # standard deviations of the output, at least, is a step
TREMBLING = (6.5, 14.0)  # Hz
UNLIKELY = 1e-4  # probability of a line as high by chance, in all of the band
HIGH = 2.5  # times the spectrum beside it
LEAST_TREMOR = 2e-3  # of the output's variance


@dataclass(frozen=True)
class Signature:
    """Trace of an effect in the output itself: how much of it, and what that says in numbers."""

    share: float
    numbers: dict[str, float]
    words: str


def signatures(record: Record) -> dict[str, Signature]:
    """Traces of stops, rate limits and levels in the measured output."""
    assert record.y is not None
    found: dict[str, Signature] = {}
    y = record.y[record.known]
    spread = float(np.std(y))
    if not spread > 0:
        return found
    step = _levels(y, spread)
    if step is not None:
        words = f"the output takes {np.unique(y).size} values only"
        return {"quantised": Signature(1.0, {"step": step}, words)}
    stop = _pile(y, spread)
    if stop is not None:
        share, limit = stop
        words = f"{100 * share:.0f} % of the samples lie at ±{limit:.3g}"
        found["saturation"] = Signature(share, {"limit": limit}, words)
    rates = np.abs(np.diff(record.y, axis=0))[record.known[1:] & record.known[:-1]] / record.dt
    top = float(np.quantile(rates, 0.998)) if rates.size else 0.0
    share = float(np.mean(np.abs(rates - top) < 2e-3 * top)) if top > 0 else 0.0
    if share > PILED_RATES:
        words = f"{100 * share:.0f} % of the rates lie at ±{top:.3g} per second"
        found["rate_limit"] = Signature(share, {"limit": top}, words)
    return found


def _levels(y: np.ndarray, spread: float) -> float | None:
    """Typical distance of the levels that an output takes, None where it takes no few."""
    rounded = np.unique(np.round(y / spread, 6))
    if rounded.size < 2 or rounded.size > RECURRING * y.size:
        return None
    step = float(np.median(np.diff(rounded)))
    return step * spread if step > COARSE else None


def _pile(y: np.ndarray, spread: float) -> tuple[float, float] | None:
    """Share of samples at a stop, and where it is."""
    best = None
    for side in (1.0, -1.0):
        top = float(np.max(side * y))
        share = float(np.mean(side * y > top - 1e-3 * spread))
        if share > PILED / 2 and (best is None or share > best[0]):
            best = (share, top)
    if best is None:
        return None
    both = float(np.mean(np.abs(y) > best[1] - 1e-3 * spread))
    return (both, abs(best[1])) if max(both, best[0]) > PILED else None


def tremor(record: Record, residual: np.ndarray) -> Signature | None:
    """A narrow line of a trembling hand in the residual's spectrum."""
    assert record.y is not None
    if 0.5 / record.dt < TREMBLING[1] + 1:
        return None
    n = int(min(record.known.sum(axis=0).min(), residual.shape[0]))
    if n * record.dt < 10:
        return None
    spectra = []
    for j in range(record.n_runs):
        rows = np.flatnonzero(record.known[:, j])
        part = residual[rows[-n:], j]
        window = np.hanning(n)
        spectra.append(np.abs(fft.rfft((part - part.mean()) * window)) ** 2 / (window @ window))
    power = np.mean(spectra, axis=0)
    hertz = fft.rfftfreq(n, record.dt)
    band = (hertz >= TREMBLING[0]) & (hertz <= TREMBLING[1])
    best: Signature | None = None
    for width in (0.1, 0.4):  # Hz: steady, and wandering
        bins = max(1, round(width * n * record.dt))
        smooth = np.convolve(power, np.ones(bins) / bins, mode="same")
        floor = np.array(
            [
                np.median(smooth[(np.abs(hertz - h) < 2.0) & (np.abs(hertz - h) > 2 * width)])
                for h in hertz[band]
            ]
        )
        ratio = smooth[band] / floor
        at = int(np.argmax(ratio))
        degrees = 2 * bins * record.n_runs / 1.5  # a Hann window correlates neighbours
        chance = float(chi2.sf(ratio[at] * degrees, degrees)) * band.sum()
        near = np.abs(hertz - hertz[band][at]) < max(2 * width, 3.0 / (n * record.dt))
        excess = float(np.sum(power[near] - floor[at])) * 2 / n
        share = excess / float(np.var(record.y[record.known]))
        clear = chance < UNLIKELY and share > LEAST_TREMOR and ratio[at] > HIGH
        if clear and (best is None or share > best.share):
            line = {
                "frequency": float(hertz[band][at]),
                "amplitude": float(np.sqrt(2 * max(excess, 0.0))),
            }
            words = f"a line at {line['frequency']:.1f} Hz, {100 * share:.1f} % of the output"
            best = Signature(share, line, words)
    return best
