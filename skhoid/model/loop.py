"""A core with effects in its closed loop: simulations that the remnant does not enter.

In the loop the remnant travels through the controlled element into the error, so a response to the
error is also a response to earlier remnant. A free run from the measured error contains that part;
a model may fit it, and its estimates are biased. A run of the closed loop does not: with the
controlled element G known, the error that a model would have made is

    e(t) - G (u_model - u)(t),

whatever the target and the disturbance are, recorded or not, since they are in the measured e.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import fftconvolve, lfilter

from ..arx.base import REST
from ..effects.composition import Effects
from ..effects.parameter import CoreKind
from ..effects.record import Record, differentiated
from ..human.linear_element import LinearElement
from .cores import Core
from .simulator import Simulator

SWEEPS = 20
SLOW, PATIENCE = 0.8, 3  # sweeps that leave more than this share, and how many end the search
SMALL_STEP = 0.4
SAME = 1e-4  # of the error's standard deviation
SOLVED = 0.02  # of it, above which a loop counts as not solved
LARGEST = 300.0  # times it, of an error
MEMORY = 12.0  # s, of the loop's answer to a short pulse, at first
PULSE = 0.5  # standard deviations of the error
QUIET = 1e-3  # of a pulse, in the last sixth of the memory; a loop that rings more has a longer one
RINGS = 0.5  # of a pulse, there: no loop that settles
MOVED = 0.1  # relative change of a parameter, after which that answer is computed anew
CURVED = 0.02  # of the output, by which the answer to a remnant and to its opposite differ
FOLLOWS = 0.7  # share of a channel that x may leave, at most, if it moves with x
ROUGH = 3  # differences that tell a rough signal from a smooth one
SMOOTHED = 0.07  # s, over which averages are taken: between samples a sensor's error is rougher
SETTLING = 3.0  # s, in which what preceded the record is forgotten
MISSING = 0.005  # share of the output, at most


@dataclass(frozen=True)
class Loop:
    """The way back from output to error.

    ``b`` and ``a`` are the pulse transfer function of the controlled element at the rate of the
    record; the loop is closed from the sample ``begin`` on, before which the measured error holds,
    as what preceded the record is not known. ``remnant``, of shape (n_samples, n_runs, n_draws),
    is drawn along where the model is not linear: thresholds answer it.
    """

    b: np.ndarray
    a: np.ndarray
    begin: int
    remnant: np.ndarray | None = None

    def moved(self, change: np.ndarray) -> np.ndarray:
        """Change of the controlled output caused by a change of the output."""
        change = change.copy()
        change[: self.begin] = 0.0
        return lfilter(self.b, self.a, change, axis=0)


class LoopSimulator:
    """Runs of the closed loop, with the interface of a :class:`Simulator`.

    The loop is solved in sweeps: what is left of e - (e_measured - G (u - u_measured)) is taken
    through the loop's own sensitivity, which for a linear model ends after two sweeps. The same
    sensitivity turns derivatives of the open answer into derivatives of the loop. An integral
    begins in the loop where it does beside the measured error.
    """

    exact = False  # one sensitivity stands for all times and amplitudes
    estimates_start = False

    def __init__(self, core: Core, effects: Effects, record: Record, loop: Loop):
        assert record.y is not None
        self.core, self.effects, self.record, self.loop = core, effects, record, loop
        open_loop = Simulator(core, effects, record)
        self.parameters = open_loop.parameters
        self.names, self.scale = open_loop.names, open_loop.scale
        self.low, self.high, self.smooth = open_loop.low, open_loop.high, open_loop.smooth
        self.size, self.prior = open_loop.size, open_loop.prior
        self._open_loop, self._measured = open_loop, None
        if open_loop.lasts:
            self._measured = open_loop
            self._open_loop = open_loop.beside(replace(record, initial=REST))
        self._spread = record.sd("e")
        self._theta: np.ndarray | None = None
        self._pulse: tuple[np.ndarray, Response | None] | None = None
        self._follow = record.once("follow", lambda: find_followers(record))
        self._set_draws(None)

    def parts(self) -> Iterator[tuple[slice, Any]]:
        """All runs at once, as their loop is solved together."""
        yield slice(None), self

    def with_soft_corners(self, amount: float, only: str | None = None) -> Any:
        """The same loop, with soft corners of effects that jump."""
        soft = self._open_loop.with_soft_corners(amount, only)
        if soft is self._open_loop:
            return self
        return LoopSimulator(self.core, soft.effects, self.record, self.loop)

    def on_record(self, record: Record) -> Any:
        """The same loop on another record."""
        return LoopSimulator(self.core, self.effects, record, self.loop)

    def _set_draws(self, remnant: np.ndarray | None) -> None:
        """Columns of all runs, once or for each draw of the remnant."""
        record = self.record
        self._draws = 1 if remnant is None else remnant.shape[2]
        self._columns = record
        self._noise: float | np.ndarray = 0.0
        if remnant is not None:
            runs = np.tile(np.arange(record.n_runs), self._draws)
            self._columns = record.part(runs, 1)
            self._noise = np.concatenate(list(np.moveaxis(remnant, 2, 0)), axis=1)
        self._error = self._inside = self._columns.input
        self._chosen = False

    def _open(self, error: np.ndarray) -> Simulator:
        return self._open_loop.beside(move_channels(self._columns, error, self._follow))

    def _begun(self, theta: np.ndarray) -> np.ndarray:
        """What an integral adds to the output, since runs do not begin at rest."""
        if self._measured is None:
            return np.zeros((1, self.record.n_runs))
        return self._measured.run(theta) - self._open_loop.run(theta)

    def run_ahead(self, theta: np.ndarray) -> np.ndarray:
        """The same as :meth:`run`: the loop begins where the measured one did."""
        return self.run(theta)

    def run(self, theta: np.ndarray) -> np.ndarray:
        """Output in the loop, the mean over draws of the remnant; NaN where none is found."""
        if self._theta is not None and np.array_equal(theta, self._theta):
            return self._output
        self._solve(theta)
        if not self._chosen and np.isfinite(self._output).all():
            self._chosen = True
            if self.loop.remnant is not None and self.is_curved(theta):
                self._set_draws(self.loop.remnant)
                self._chosen = True
                self._solve(theta)
        self._theta = theta.copy()
        return self._output

    def _solve(self, theta: np.ndarray) -> None:
        """Solve the loop from the last solution, else from the measured error with its sensitivity.

        As long as nothing was found, in small steps too.
        """
        if self._solved(theta, self._inside):
            return
        self._pulse = None
        if not self._solved(theta, self._error) and self._inside is self._error:
            self._solved(theta, self._error, SMALL_STEP)

    def _solved(self, theta: np.ndarray, error: np.ndarray, step: float = 1.0) -> bool:
        assert self._columns.y is not None
        sensitivity = self._sensitivity(theta, error)
        begun = self._begun(theta)
        added: Any = self._noise + np.tile(begun, self._draws)
        stuck = 0
        best: tuple[float, np.ndarray, np.ndarray, Simulator] | None = None
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(round(SWEEPS / step)):
                simulator = self._open(error)
                answer = simulator.run(theta)
                change = answer + added
                change -= self._columns.y  # in place, as room for signals takes time too
                left = self._error - self.loop.moved(change)
                left -= error
                size = float(np.sqrt(np.vdot(left, left) / left.size)) / self._spread
                size = size if np.isfinite(size) else np.inf
                worse = best is not None and size > SLOW**step * best[0]
                if best is None or size < best[0]:
                    best = size, error, answer, simulator
                stuck = stuck + 1 if worse else 0
                if size < SAME or not np.isfinite(size) or stuck == PATIENCE:
                    break
                change = left if sensitivity is None else sensitivity.of(left)
                change *= step
                change += error
                most = LARGEST * self._spread
                error = np.clip(change, -most, most, out=change)
        assert best is not None
        size, inside, self._answer, self._last = best
        found = size <= SOLVED
        nothing = np.full_like(self.record.input, np.nan)
        self._output = self._mean(self._answer) + begun if found else nothing
        if found:
            self._inside = inside
        return found

    def _mean(self, signal: np.ndarray) -> np.ndarray:
        if self._draws == 1:
            return signal
        return signal.reshape(len(signal), self._draws, -1).mean(axis=1)

    def _sensitivity(self, theta: np.ndarray, error: np.ndarray) -> Response | None:
        """Answer of the error to a pulse, (1 + G H)^-1; None where it does not settle."""
        if self._pulse is not None:
            before, found = self._pulse
            if np.all(np.abs(theta - before) <= MOVED * (np.abs(before) + 1e-3 * self.scale)):
                return found
        n, at = len(error), len(error) // 3
        pulse = np.zeros_like(error)
        pulse[at] = PULSE * self._spread
        above, below = (self._open(error + s * pulse).run(theta) for s in (1, -1))
        with np.errstate(all="ignore"):
            answer = ((above - below) / (2 * pulse[at, 0])).mean(axis=1)[at:]
        length = min(round(MEMORY / self.record.dt), n - at)
        while True:
            rung, rings = self._around(answer[:length])
            if length == n - at or not QUIET < rings < RINGS:
                break
            length = min(2 * length, n - at)
        sensitivity = Response.on(rung, n) if rings < RINGS else None
        self._pulse = theta.copy(), sensitivity
        return sensitivity

    def _around(self, answer: np.ndarray) -> tuple[np.ndarray, float]:
        """What a pulse becomes in the loop, and what of it is left in the last sixth."""
        unit = np.r_[1.0, np.zeros(answer.size - 1)]
        with np.errstate(all="ignore"):
            around = fftconvolve(lfilter(self.loop.b, self.loop.a, unit), answer)[: answer.size]
            around[0] += 1.0
            if not np.isfinite(around).all():
                return around, np.inf
            found = lfilter([1.0], around, unit)
        left = float(np.abs(found[-answer.size // 6 :]).max())
        return found, left if np.isfinite(left) else np.inf

    def is_curved(self, theta: np.ndarray) -> bool:
        """Whether open-loop responses to a remnant and its opposite differ from that to none."""
        assert self.loop.remnant is not None
        remnant = self.loop.remnant[:, :, 0]
        size = 0.3 * self._spread / max(float(np.std(remnant)), 1e-300)
        error = self.record.input
        both = [
            self._open_loop.beside(
                move_channels(self.record, error + s * size * remnant, self._follow)
            ).run(theta)
            for s in (0, 1, -1)
        ]
        bend = (both[1] + both[2]) / 2 - both[0]
        return bool(np.std(bend) > CURVED * np.std(both[0]))

    def run_with_change(self, position: int, value: float) -> np.ndarray:
        """Output of the last ``run`` with one parameter changed, by the loop's sensitivity."""
        change = self._mean(self._last.run_with_change(position, value) - self._answer)
        if self._measured is not None:
            assert self._theta is not None
            theta = self._theta.copy()
            theta[position] = value
            change += self._begun(theta) - self._begun(self._theta)
        return self._output + self.closed(change)

    def closed(self, change: np.ndarray) -> np.ndarray:
        """What the loop leaves of a change of the open-loop response."""
        assert self._pulse is not None
        inside = change.copy()
        inside[: self.loop.begin] = 0.0
        sensitivity = self._pulse[1]
        inside = inside if sensitivity is None else sensitivity.of(inside)
        inside[: self.loop.begin] = change[: self.loop.begin]
        return inside

    @property
    def last_state(self) -> Any:
        """Signals of the last run."""
        return self._last.last_state


def find_followers(record: Record) -> dict[str, np.ndarray]:
    """Channels that the loop moves: what each is of x, its rate and its acceleration.

    Motion that the person feels is that of the controlled element; a channel that x hardly explains
    has other causes, and stays as measured.
    """
    names = record.with_role("x")
    if not names:
        return {}
    known, found = record.known, {names[0]: np.array([1.0, 0.0, 0.0])}
    table = np.stack(
        [s[known] for s in differentiate_motion(record.channels[names[0]], record.dt)], axis=1
    )
    table = table - table.mean(axis=0)
    size = np.sqrt((table**2).sum(axis=0)) + 1e-300
    for name in record.with_role("motion"):
        signal = record.channels[name][known]
        signal = signal - signal.mean()
        shares = np.linalg.lstsq(table / size, signal, rcond=1e-9)[0] / size
        left = signal - table @ shares
        if left @ left < FOLLOWS * (signal @ signal):
            found[name] = shares
    return found


def differentiate_motion(signal: np.ndarray, dt: float) -> list[np.ndarray]:
    """A signal, its rate and its acceleration."""
    rate = differentiated(signal, dt)
    return [signal, rate, differentiated(rate, dt)]


def move_channels(record: Record, error: np.ndarray, follow: dict[str, np.ndarray]) -> Record:
    """The record with another error, and with what moves then."""
    channels = {record.inputs[0]: error}
    moved = (
        differentiate_motion(record.input - error, record.dt)
        if len(follow) > 1
        else [record.input - error]
    )
    for name, shares in follow.items():
        change = sum(share * signal for share, signal in zip(shares, moved, strict=False))
        channels[name] = record.channels[name] + change
    return record.changed(channels)


@dataclass(frozen=True)
class Response:
    """An impulse response, for signals of one length: its spectrum with as many zeros as it needs.

    The spectrum is of ``n_padded`` samples.
    """

    spectrum: np.ndarray
    n_padded: int

    @classmethod
    def on(cls, response: np.ndarray, n_samples: int) -> Response:
        """The response to signals of ``n_samples``."""
        n_padded = next_fast_len(n_samples + len(response) - 1, real=True)
        return cls(rfft(response, n_padded)[:, None], n_padded)

    def of(self, signal: np.ndarray) -> np.ndarray:
        """The answer to a signal of shape (n_samples, n_runs)."""
        answer = rfft(signal, self.n_padded, axis=0)
        answer *= self.spectrum
        return np.asarray(irfft(answer, self.n_padded, axis=0)[: len(signal)])


def draw_remnant(residual: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Remnant like a residual: its spectrum in each run with other phases, in both signs.

    Of shape (n_samples, n_runs, 2). Phases are the same for every call.
    """
    random = np.random.default_rng(0)
    centred = np.where(known, residual, 0.0)
    spectrum = np.abs(np.fft.rfft(centred, axis=0))
    spectrum /= np.sqrt(np.maximum(known.mean(axis=0), 1e-3))
    phases = random.uniform(0, 2 * np.pi, spectrum.shape)
    found = np.fft.irfft(spectrum * np.exp(1j * phases), len(centred), axis=0)
    return np.stack([found, -found], axis=2)


def find_loop(record: Record) -> Loop | None:
    """The loop of a record, closed after SETTLING; None where it is not known.

    It takes a measured output without gaps, an input of role e, and a known controlled element.
    """
    element = record.controlled_element
    if element is None or record.y is None or record.roles.get(record.inputs[0]) != "e":
        return None
    if record.core == CoreKind.ARX:
        return None
    begin = round(SETTLING / record.dt)
    if begin >= len(record.known):  # it is never closed
        return None
    missing = ~record.known[begin:] & (record.y[begin:] == 0.0)
    after = np.cumsum(record.known[::-1], axis=0)[::-1][begin:] > 0
    if (missing & after).mean() > MISSING:
        return None
    b, a = choose_pulse_response(element, record, begin)
    return Loop(b, a, begin)


def choose_pulse_response(
    element: LinearElement, record: Record, begin: int
) -> tuple[np.ndarray, np.ndarray]:
    """Pulse transfer function of an element, given what the output does between samples.

    Steps before or after a sample, or a straight line: whichever leaves the smoothest remainder of
    the measured x, since a disturbance is smoother than a remnant. Steps where x is not measured.
    """
    names = record.with_role("x")
    plain = element.discrete(record.dt)
    if not names or element.dt is not None or element.direct:
        return plain
    held = [plain, element.discrete(record.dt, "foh")]
    if len(element.numerator) < len(element.denominator):
        held.append(replace(element, direct=True).discrete(record.dt))
    together = max(1, round(SMOOTHED / record.dt))
    n = (len(record.known) - begin) // together
    whole = np.s_[begin : begin + n * together]

    def averages(signal: np.ndarray) -> np.ndarray:
        return np.asarray(signal[whole].reshape(n, together, -1).mean(axis=1))

    known = np.all(averages(record.known) == 1.0, axis=1)
    known = known[ROUGH:] & known[:-ROUGH]

    def roughness(b: np.ndarray, a: np.ndarray) -> float:
        assert record.y is not None
        rest = averages(record.channels[names[0]] - lfilter(b, a, record.y, axis=0))
        return float(np.sum(np.diff(rest, n=ROUGH, axis=0)[known] ** 2))

    return min(held, key=lambda found: roughness(*found))
