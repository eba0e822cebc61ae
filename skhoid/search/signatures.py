"""What an output alone shows of effects that act behind the remnant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.stats import chi2

from ..effects.record import Record
from ..effects.traces import fastest_of, step_of, stop_of

TREMBLING = (6.5, 14.0)  # Hz
UNLIKELY = 1e-4  # probability of a line as high by chance, in all of the band
HIGH = 2.5  # times the spectrum beside it
LEAST_TREMOR = 2e-3  # of the output's variance


@dataclass(frozen=True)
class Signature:
    """A line in the residual: its share of the output, its numbers, and both in words."""

    share: float
    numbers: dict[str, float]
    words: str


def traces_of(record: Record) -> dict[str, str]:
    """Traces of stops, rate limits and levels in the measured output, in words by effect."""
    step = step_of(record)
    if step is not None:
        return {"quantised": f"the output takes few values, {step:.3g} apart"}
    found = {}
    stop = stop_of(record)
    if stop is not None:
        share, limit = stop
        found["saturation"] = f"{100 * share:.0f} % of the samples lie at ±{limit:.3g}"
    fastest = fastest_of(record)
    if fastest is not None:
        share, limit = fastest
        found["rate_limit"] = f"{100 * share:.0f} % of the rates lie at ±{limit:.3g} per second"
    return found


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
