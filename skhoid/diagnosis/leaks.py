"""Test whether a prediction is the output rebuilt from the controlled element's response.

The element's output is a function of its input, x = G (u + d). A model that sees x without delay
can compute G^-1 x = u + d: it knows the output at once, and a disturbance that nobody could see.
No person responds to a disturbance within about 0.1 s; such a prediction does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import fft

from ..runs.roles import with_target

LEAST_INSTRUMENT = 0.05  # of the power of the element's rate, explained by the target
ORDER = 8  # of the low-pass filter
N_INSTRUMENTS = 24  # taps of the target from which the element is estimated
EXTERNAL = ("target", "disturbance")


def band_edge(outputs: Sequence[np.ndarray], dt: float, power_share: float) -> float:
    """Frequency (Hz) below which outputs have a share of their power; 0 of those that rest."""
    longest = max(output.size for output in outputs)
    power = np.zeros(longest // 2 + 1)
    for output in outputs:
        power += np.abs(fft.rfft(output - output.mean(), longest)) ** 2
    if not power.any():
        return 0.0
    share = np.cumsum(power) / power.sum()
    return float(fft.rfftfreq(longest, dt)[max(int(np.searchsorted(share, power_share)), 1)])


def count_independent(output: np.ndarray, dt: float) -> float:
    """Number of independent values in an output: twice its bandwidth times its duration."""
    return 2 * band_edge([output], dt, 0.9) * output.size * dt if output.size else 0.0


def can_have_learnt(p: int, n: float, worse: float) -> bool:
    """Whether p parameters, fitted to n independent values, can have learnt as much noise.

    They raise the squared error of other rows by (n + p) / (n - p); ``worse`` is by how much it is
    higher, and half of that is to be noise that was learnt.
    """
    learnt = 2 * p / (n - p) if n > p else np.inf
    return learnt > (worse - 1) / 2


def low_passed(signal: np.ndarray, dt: float, edge: float) -> np.ndarray:
    """A signal below the edge (Hz), without delay; odd reflections continue both ends."""
    n = signal.size
    pad = min(n - 1, int(2 / (edge * dt)) + 1)
    before, after = 2 * signal[0] - signal[pad:0:-1], 2 * signal[-1] - signal[-2 : -pad - 2 : -1]
    longer = np.concatenate([before, signal, after])
    size = fft.next_fast_len(longer.size, real=True)
    gain = 1 / (1 + (fft.rfftfreq(size, dt) / edge) ** ORDER)
    # What an offset at one end leaves in the transform would ring: it is taken out, and put back.
    level = longer.mean()
    return fft.irfft(fft.rfft(longer - level, size) * gain, size)[pad : pad + n] + level


def estimated_inverse(
    low: Sequence[Mapping[str, np.ndarray]], dt: float, taps: int
) -> list[np.ndarray] | str:
    """The inverse of an element of second order at most, u = c2 x'' + c1 x' + c0 x + c.

    By two-stage least squares: u answers the disturbance in the loop, and the target owes nothing
    to it. A recorded disturbance acts beside u.
    """
    rows, n = triangle(_instruments_rates_output(piece, dt, taps) for piece in low)
    n_rates = 4 + ("disturbance" in low[0])
    Z, D, u = rows[:, : -n_rates - 1], rows[:, -n_rates - 1 : -1], rows[:, -1]
    if n <= 2 * Z.shape[1]:
        return "the runs are too short to estimate the controlled element"
    caused = Z @ np.linalg.lstsq(Z, D, rcond=1e-9)[0]
    ones = D[:, 3]
    caused_rate, rate = (each[:, 1] - ones * (ones @ each[:, 1]) / n for each in (caused, D))
    if not caused_rate @ caused_rate > LEAST_INSTRUMENT * (rate @ rate):
        return "the controlled element's response to the target is too weak to estimate it from"
    scale = np.sqrt(np.sum(caused**2, axis=0) / n)
    scale[scale == 0] = 1.0
    c = np.linalg.lstsq(caused / scale, u, rcond=1e-6)[0] / scale
    return [_rates(piece["x"], dt) @ c[:4] for piece in low]


def _instruments_rates_output(piece: Mapping[str, np.ndarray], dt: float, taps: int) -> np.ndarray:
    """What the element answers, what it does, and the output, in rows where all are known."""
    lags = np.arange(-2, N_INSTRUMENTS - 2) * taps
    beside = [piece["disturbance"]] if "disturbance" in piece else []
    outside = [lagged(piece[name], lags) for name in EXTERNAL if name in piece]
    table = np.column_stack(
        [*outside, np.ones_like(piece["x"]), *beside, _rates(piece["x"], dt), *beside, piece["u"]]
    )
    return table[np.isfinite(table[:, : len(lags) * len(outside)]).all(axis=1)]


def _rates(x: np.ndarray, dt: float) -> np.ndarray:
    """Derivatives of the element's output, itself, and ones."""
    rate = np.gradient(x, dt)
    return np.column_stack([np.gradient(rate, dt), rate, x, np.ones_like(x)])


def triangle(tables: Iterable[np.ndarray]) -> tuple[np.ndarray, int]:
    """R of the QR factorisation of tables one below the other, and the number of their rows."""
    R: Any = None
    n = 0
    for table in tables:
        n += len(table)
        R = np.linalg.qr(table if R is None else np.concatenate([R, table]), mode="r")
    return R, n


def lagged(signal: np.ndarray, lags: Any) -> np.ndarray:
    """Columns signal(t - lag), NaN where the signal is not known."""
    n = signal.size
    out = np.full((n, len(lags)), np.nan)
    for column, lag in enumerate(lags):
        if abs(lag) < n:
            out[max(lag, 0) : n + min(lag, 0), column] = signal[max(-lag, 0) : n - max(lag, 0)]
    return out


def with_target_and_x(
    channels: Mapping[str, np.ndarray],
) -> tuple[np.ndarray, np.ndarray] | None:
    """Target and output of the element, where they are known or follow from the error."""
    known = with_target(dict(channels))
    if "x" not in known and {"e", "f_t"} <= known.keys():
        known["x"] = known["f_t"] - known["e"]
    if {"x", "f_t"} <= known.keys():
        return known["f_t"], known["x"]
    return None


LEAST_DELAY = 0.1  # s; no person answers sooner
EARLY = 0.05  # s by which a zero-phase filter or a held sample may put an answer before its cause
STEP = 0.025  # s between the lags at which an immediate answer is looked for
WINDOWS = 8  # of a run, each with an element of its own
LEFT_BY_CHANGE = 0.35  # of a disturbance that is an element's change, at most, is left by them
SLOPE = 0.3  # of the unseen disturbance, at least, that a leak holds
SIGMAS = 3.0  # standard errors by which the slope exceeds half of that
LEAST_DISTURBANCE = 0.1  # rms, of that of the output; less is no probe
POWER = 0.99  # of the output, below the band's edge
WIDER = 2.0  # times that edge: a disturbance is faster than the answer to it
HONEST = "No more than a delayed response would contain: "
REBUILT = ": the model rebuilds the output from the element's response instead of predicting it"
LEAST_ROWS = 16  # of a run
LEAST_PERIODS = 20  # of the edge of the band, of all runs
AHEAD, BEHIND = 3, 5  # taps of the target, on either side
OF_OUTPUT = (0, 1, 2, 4)  # taps of the output


@dataclass(frozen=True)
class LeakTest:
    """Whether a prediction contains a disturbance that the controller could not see.

    ``leaks`` is None where the data cannot tell, for the reason ``unknown``. ``slope`` is the part
    of the unseen disturbance d = G^-1 x - u that the prediction holds at once (regression at lags
    from -0.05 s to ``least_delay``, with the output and the target held fixed): 1 for the inverse,
    0 or less for a delayed response; ``sd`` its standard error with the long-run variance of the
    remainder. In the band of the output, the prediction and the measured output (``reference``)
    correlate with G^-1 x = u + d, and the residual with d (-1 for the inverse).
    """

    leaks: bool | None
    correlation_with_inverse: float
    reference: float
    residual_with_disturbance: float
    slope: float
    sd: float
    least_delay: float = LEAST_DELAY
    unknown: str = ""

    @property
    def reason(self) -> str:
        """What was seen, as a sentence."""
        if self.leaks is None:
            return f"Leaks cannot be tested: {self.unknown}."
        before, rebuilt = ("", REBUILT) if self.leaks else (HONEST, "")
        return (
            f"{before}{100 * self.slope:.0f} ± {100 * self.sd:.0f} % of the unseen disturbance is "
            f"in the prediction within {self.least_delay:g} s{rebuilt}; it correlates "
            f"{self.correlation_with_inverse:.2f} with the input that the element's inverse gives "
            f"(the measured output {self.reference:.2f}), its residual "
            f"{self.residual_with_disturbance:+.2f} with that disturbance."
        )


def leak_test(
    u: np.ndarray,
    u_hat: np.ndarray,
    channels: Mapping[str, np.ndarray],
    dt: float,
    runs: Sequence[Any] | None = None,
    *,
    told: Callable[[str], bool],
    least_delay: float,
    most: float = SLOPE,
    opposed: float = np.inf,
) -> LeakTest | None:
    """Test whether a prediction knows the disturbance that only the element's response shows.

    Of ``u`` (NaN in rows that do not count), ``u_hat`` and ``channels`` by role, of shape (n_rows,)
    with the rows of each run, or (n_rows, n_runs). None where less than two of e, x and f_t are
    known. ``told`` says whether the model has a recorded disturbance as an input: what follows it
    linearly is then not unseen. It leaks where the slope exceeds ``most`` surely, and the residual
    correlates with the disturbance by less than ``opposed``.
    """
    known = with_target_and_x(channels)
    if known is None:
        return None
    target, x = known
    recorded = next((role for role in channels if role.startswith("dist")), None)
    disturbance = None if recorded is None else channels[recorded]
    pieces = _pieces(runs, u, u_hat, x, target, disturbance)
    edge = band_edge([piece["u"] for piece in pieces], dt, POWER) if pieces else 0.0
    seconds = dt * sum(piece["u"].size for piece in pieces)
    if not edge or seconds * edge < LEAST_PERIODS:
        return _unknown("the runs are too short, or the output does not move")
    taps = max(round(0.15 / (edge * dt)), 1)
    edge *= WIDER
    low_all = [{name: low_passed(values, dt, edge) for name, values in p.items()} for p in pieces]
    inverse = estimated_inverse(low_all, dt, taps)
    if isinstance(inverse, str):
        return _unknown(inverse)
    unseen, low = [v - p["u"] for v, p in zip(inverse, low_all, strict=True)], low_all
    if recorded is not None and told(recorded):
        unseen = _remove_recorded(unseen, low, taps)
    else:
        low = [{k: v for k, v in p.items() if k != "disturbance"} for p in low]
    trim = max(round(0.5 / (edge * dt)), 1)
    products = np.zeros((5, 5))
    for p, v, d in zip(low, inverse, unseen, strict=True):
        products += _products([p["u"], p["u_hat"], p["u"] - p["u_hat"], v, d], trim)
    of_output, of_prediction, of_residual, of_inverse, of_unseen = range(5)
    size = float(np.sqrt(products[of_unseen, of_unseen] / products[of_output, of_output]))
    if size < LEAST_DISTURBANCE:
        return _unknown(
            f"the unseen disturbance is {100 * size:.0f} % of the output (rms), too little to tell "
            "the output from what the element received"
        )
    if _changes(low_all, dt, taps, trim) < LEFT_BY_CHANGE * size:
        return _unknown(
            "what looks like an unseen disturbance is an element that changes in time, or is not "
            "linear"
        )
    slope, sd = _immediate(low, unseen, dt, taps, trim, least_delay)
    if not np.isfinite(slope):
        return _unknown("the unseen disturbance follows the output and the target everywhere")
    with_inverse, reference, with_disturbance = (
        _correlation(products, *pair)
        for pair in (
            (of_prediction, of_inverse),
            (of_output, of_inverse),
            (of_residual, of_unseen),
        )
    )
    leaks = bool(slope > most and slope - SIGMAS * sd > most / 2 and with_disturbance < opposed)
    return LeakTest(leaks, with_inverse, reference, with_disturbance, slope, sd, least_delay)


def _changes(low: list[dict[str, np.ndarray]], dt: float, taps: int, trim: int) -> float:
    """Unseen disturbance, over the output (rms), that elements of their own in windows leave."""
    found: list[list[np.ndarray]] = [[] for _ in low]
    for window in range(WINDOWS):
        parts = []
        for piece in low:
            n = piece["u"].size
            rows = slice(window * n // WINDOWS, (window + 1) * n // WINDOWS)
            parts.append({name: values[rows] for name, values in piece.items()})
        received = estimated_inverse(parts, dt, taps)
        if isinstance(received, str):
            return np.inf
        for of_piece, v, part in zip(found, received, parts, strict=True):
            of_piece.append(v - part["u"])
    products = np.zeros((2, 2))
    for of_piece, piece in zip(found, low, strict=True):
        products += _products([np.concatenate(of_piece), piece["u"]], trim)
    return float(np.sqrt(products[0, 0] / products[1, 1]))


def _products(signals: list[np.ndarray], trim: int) -> np.ndarray:
    """Sums of products of signals about their means, without the ends of the run."""
    inner = np.array([signal[trim : signal.size - trim] for signal in signals])
    inner -= inner.mean(axis=1, keepdims=True)
    return inner @ inner.T


def _unknown(why: str) -> LeakTest:
    return LeakTest(None, np.nan, np.nan, np.nan, np.nan, np.nan, unknown=why)


def _pieces(
    runs: Sequence[Any] | None,
    u: np.ndarray,
    u_hat: np.ndarray,
    x: np.ndarray,
    target: np.ndarray,
    disturbance: np.ndarray | None,
) -> list[dict[str, np.ndarray]]:
    """The signals of each run over the longest stretch in which all of them are known."""
    given = {"u": u, "u_hat": u_hat, "x": x, "target": target, "disturbance": disturbance}
    known = {k: np.asarray(v, dtype=float) for k, v in given.items() if v is not None}
    if runs is None:
        columns = {k: v.reshape(len(v), -1) for k, v in known.items()}
        n_runs = columns["u"].shape[1]
        by_run = [{k: v[:, run] for k, v in columns.items()} for run in range(n_runs)]
    else:
        by_run = [{k: v[rows] for k, v in known.items()} for rows in runs]
    pieces = []
    for signals in by_run:
        whole = np.all([np.isfinite(values) for values in signals.values()], axis=0)
        edges = np.flatnonzero(np.diff(np.r_[0, whole, 0]))
        lengths = edges[1::2] - edges[::2]
        if lengths.size and lengths.max() >= LEAST_ROWS:
            start, stop = edges[2 * int(np.argmax(lengths)) :][:2]
            piece = {k: values[start:stop] for k, values in signals.items()}
            # A transient of the free run far beyond the output would outweigh all that follows.
            low, high = float(piece["u"].min()), float(piece["u"].max())
            piece["u_hat"] = np.clip(piece["u_hat"], 2 * low - high, 2 * high - low)
            pieces.append(piece)
    return pieces


def _remove_recorded(
    disturbance: list[np.ndarray], low: list[dict[str, np.ndarray]], taps: int
) -> list[np.ndarray]:
    """What is left of the disturbance when all that follows the recorded one is taken out."""
    lags = np.arange(-1, BEHIND) * taps

    def past(piece: dict[str, np.ndarray]) -> np.ndarray:
        known = np.nan_to_num(lagged(piece["disturbance"], lags))
        return np.column_stack([known, np.ones(len(known))])

    rows, _ = triangle(np.column_stack([past(p), d]) for p, d in zip(low, disturbance, strict=True))
    c = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=1e-9)[0]
    return [d - past(p) @ c for d, p in zip(disturbance, low, strict=True)]


def _immediate(
    low: list[dict[str, np.ndarray]],
    unseen: list[np.ndarray],
    dt: float,
    taps: int,
    trim: int,
    least_delay: float,
) -> tuple[float, float]:
    """Largest slope of the prediction on the disturbance before an answer can come; its sd."""
    earliest, latest = -int(EARLY / dt + 1e-9), int(np.ceil(least_delay / dt - 1e-9))
    lags = range(earliest, max(latest, 1), max(round(STEP / dt), 1))
    n_free = 1 + len(lags)

    def make_table(piece: dict[str, np.ndarray], d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Prediction, disturbance and what is held fixed where all are known; and the rows."""
        columns = [piece["u_hat"][:, None], lagged(d, lags)]
        columns.append(lagged(piece["u"], [taps * k for k in OF_OUTPUT]))
        if "target" in piece:
            columns.append(lagged(piece["target"], taps * np.arange(-AHEAD, BEHIND)))
        if "disturbance" in piece:
            columns.append(lagged(piece["disturbance"], taps * np.arange(-1, BEHIND)))
        table = np.column_stack([*columns, np.ones(d.size)])
        keep = np.isfinite(table).all(axis=1)
        keep[:trim] = keep[-trim:] = False
        return table[keep], np.flatnonzero(keep)

    rows, n = triangle(make_table(*each)[0] for each in zip(low, unseen, strict=True))
    free, held = rows[:, :n_free], rows[:, n_free:]
    scale = np.sqrt(np.sum(held**2, axis=0) / max(n, 1))
    moves = scale > 0
    if n <= 2 * moves.sum() + len(lags):
        return np.nan, np.nan
    U, s, Wt = np.linalg.svd(held[:, moves] / scale[moves], full_matrices=False)
    kept = s > 1e-6 * s[0]
    U, s, Wt = U[:, kept], s[kept], Wt[kept]
    explained = np.zeros((held.shape[1], n_free))
    explained[moves] = (Wt.T / s) @ (U.T @ free) / scale[moves, None]
    all_power = np.sum(free[:, 1:] ** 2, axis=0)
    free = free - U @ (U.T @ free)
    prediction, probes = free[:, 0], free[:, 1:]
    power = np.sum(probes**2, axis=0)
    if np.any(power <= 1e-6 * all_power):
        return np.nan, np.nan
    slopes = probes.T @ prediction / power
    best = int(np.argmax(slopes))
    spread = 0.0
    for piece, d in zip(low, unseen, strict=True):
        table, at = make_table(piece, d)
        left = table[:, :n_free] - table[:, n_free:] @ explained
        probe = left[:, 1 + best]
        sums = np.bincount(at // max(4 * taps, 1), (left[:, 0] - slopes[best] * probe) * probe)
        spread += float(np.sum(sums**2))
    return float(slopes[best]), float(np.sqrt(spread) / power[best])


def _correlation(products: np.ndarray, a: int, b: int) -> float:
    scale = float(np.sqrt(products[a, a] * products[b, b]))
    return float(products[a, b]) / scale if scale > 0 else 0.0
