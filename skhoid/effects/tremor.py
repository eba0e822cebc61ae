"""Tremor: noise from a trembling hand, recognised in the residual of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.special import chdtrc

from .base import Effect
from .parameter import HZ, Parameter, U
from .record import Record, Signature

__all__ = ["Tremor"]

TREMBLING = (6.5, 14.0)  # Hz
UNLIKELY = 1e-4  # probability that chance makes such a line anywhere in the band
HIGH = 2.5  # times the neighbouring spectrum
LEAST_TREMOR = 2e-3  # of the output's variance
SKIRT = 1.0  # Hz to either side, in which the ends of a run smear a line
BESIDE = 2.0  # Hz to either side of that, whose level is no line's
PERIODS, N_SHOWN = 4.0, 800  # of a realisation


class Tremor(Effect):
    """A periodic movement of the hand of unknown phase: noise, which no input explains.

    Its phase cannot be known in advance: the tremor is named and measured, but the free run does
    not change.
    """

    name = "tremor"
    place = "sum"
    physics = "The hand trembles at a constant frequency."
    machine_physics = "The output carries a vibration of constant frequency."
    formula = "u + amplitude sin(2 pi frequency t + phase), the phase unknown"
    tex = (
        r"u' = u + \mathrm{amplitude}\,\sin(2\pi\,\mathrm{frequency}\; t + \varphi),"
        r" \quad \varphi \text{ unknown}"
    )
    source = "Elble and Randall (1978)"
    noise = "a sine"
    parameters = (
        Parameter("frequency", HZ, 5.0, 15.0, (9.0,), "frequency of the tremor"),
        Parameter("amplitude", U, 0.0, 5.0, (0.1,), "amplitude of the tremor"),
    )

    citation = "Elble and Randall, Mechanistic components of normal hand tremor (1978): 8-12 Hz."
    examples = ({"amplitude": 0.05, "frequency": 9.0},)

    def apply(
        self, signal: np.ndarray, record: Record, frequency: float, amplitude: float
    ) -> np.ndarray:
        return signal

    def signature(self, residual: np.ndarray, record: Record) -> Signature | None:
        found = _line(record, residual)
        return None if found is None else found.signature

    def noise_part(self, residual: np.ndarray, record: Record) -> np.ndarray | None:
        found = _line(record, residual)
        if found is None:
            return None
        assert record.y is not None
        part, generator = np.zeros_like(residual), np.random.default_rng(0)
        for j in range(record.n_runs):  # each has a phase of its own
            rows = np.flatnonzero(record.known[:, j])
            # Of the output, since the model may already follow the line that comes back in e.
            spectrum = fft.rfft(record.y[rows, j])
            off = np.abs(fft.rfftfreq(rows.size, record.dt) - found.frequency)
            reach = max(SKIRT, found.reach)
            beside = spectrum[(off > reach) & (off < reach + BESIDE)]
            band = off <= reach
            # Noise as beside it stays: a noise model would take a hole for certainty, and a
            # resonance would follow what has the phase of the line.
            level = np.sqrt(np.median(np.abs(beside) ** 2) / (2 * np.log(2)))
            real, imaginary = level * generator.standard_normal((2, int(band.sum())))
            spectrum[~band] = 0.0
            spectrum[band] -= real + 1j * imaginary
            part[rows, j] = fft.irfft(spectrum, rows.size)
        return part

    def realisation(
        self, values: dict[str, float], t: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        if t is None:
            t = np.linspace(0.0, PERIODS / values["frequency"], N_SHOWN)
        return t, values["amplitude"] * np.sin(2 * np.pi * values["frequency"] * t)


@dataclass(frozen=True)
class _Line:
    """A line of a spectrum: its frequency, how far it reaches to either side (Hz), what is seen."""

    frequency: float
    reach: float
    signature: Signature


def _line(record: Record, residual: np.ndarray) -> _Line | None:
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
    best: _Line | None = None
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
        chance = float(chdtrc(degrees, ratio[at] * degrees)) * band.sum()
        reach = max(2 * width, 3.0 / (n * record.dt))
        near = np.abs(hertz - hertz[band][at]) < reach
        excess = float(np.sum(power[near] - floor[at])) * 2 / n
        share = excess / float(np.var(record.y[record.known]))
        clear = chance < UNLIKELY and share > LEAST_TREMOR and ratio[at] > HIGH
        if clear and (best is None or share > best.signature.share):
            frequency = float(hertz[band][at])
            amplitude = float(np.sqrt(2 * max(excess, 0.0)))
            seen = Signature(
                "frequency",
                share,
                f"a line at {frequency:.1f} Hz, {100 * share:.1f} % of the output",
                f"frequency = {frequency:.2f} Hz, amplitude = {amplitude:.3g}",
            )
            best = _Line(frequency, reach, seen)
    return best
