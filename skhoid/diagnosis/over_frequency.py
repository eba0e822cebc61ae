"""The residual over frequency, at and between excited lines; measured response; distortion."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
from scipy import fft
from scipy.signal.windows import hann
from scipy.stats import f as f_distribution

from .ceiling import Ceiling, Route
from .repeats import Group
from .signals import Signals
from .tests_table import FALSE_ALARM, Test, correct_for_several

N_BANDS = 16  # at most
WIDTH = 1.4  # ratio of the ends of a band, at least
HANN = 35 / 18  # 1 + 2 (2/3)^2 + 2 (1/6)^2: correlation of bins under a Hann window
SHARED = 0.95  # of the lines, that several targets must have in common
LINES_SHARE_NOISE = 10  # neighbourhoods of the density that lines over all frequencies draw on
FEW = 60  # excited lines; more of them are taken together in bands
COLUMNS = (
    "omega", "kind", "n_bins", "psd_output", "psd_residual", "psd_noise", "share", "coherence",
    "measured_gain", "measured_phase", "sd_gain", "sd_phase", "model_gain", "model_phase",
    "p", "exceeds",
)  # fmt: skip


def by_frequency(signals: Signals, ceiling: Ceiling) -> pd.DataFrame:
    """Residual at the excited lines (or in bands), and between them."""
    n = min(group.n_samples for group in signals.groups)
    parts = [_GroupSpectra.of(signals, group, n) for group in signals.groups]
    total = sum(float(np.sum(signals.y[rows] ** 2)) for g in signals.groups for rows in g.rows)
    omega = 2 * np.pi * fft.rfftfreq(n, signals.dt)
    noise, density = ceiling.noise, signals.dt / np.pi
    S, known = noise.at(omega), noise.known(omega)
    n_runs = sum(part.group.n_runs for part in parts)
    rows = []
    for kind, bins in _sets_of_bins(parts, omega):
        weight = np.where((bins == omega.size - 1) & (omega.size > 1), 1.0, 2.0)
        U2 = sum(np.sum(np.abs(part.output[:, bins]) ** 2, axis=0) for part in parts)
        R2 = sum(np.sum(np.abs(part.residual[:, bins]) ** 2, axis=0) for part in parts)
        has_noise = ceiling.route.separates
        row = {
            "omega": float(np.exp(np.mean(np.log(omega[bins])))),
            "kind": kind,
            "n_bins": bins.size,
            "psd_output": float(np.mean(U2)) / n_runs * density,
            "psd_residual": float(np.mean(R2)) / n_runs * density,
            "psd_noise": float(np.mean(S[bins])) * density if has_noise else np.nan,
            "share": 100 * float(np.sum(weight * R2)) / total,
            "p": np.nan,
            **dict.fromkeys(COLUMNS[7:14], np.nan),
        }
        if kind in ("excited", "band") and parts[0].F is not None:
            row |= _response(omega[bins], bins, parts, S[bins], bool(known[bins].all()), noise.free)
        elif ceiling.route is Route.REPEATS and known[bins].all():
            row["p"] = _repeatable(bins, parts, S[bins], noise.free)
        rows.append(row)
    table = pd.DataFrame(rows).sort_values(["omega", "kind"], ignore_index=True)
    for kind in ("measured_phase", "model_phase"):
        known = table[kind].notna().to_numpy()
        table.loc[known, kind] = np.rad2deg(np.unwrap(np.deg2rad(table.loc[known, kind])))
    tested = table["p"].notna().to_numpy()
    table.loc[tested, "p"] = correct_for_several(table.loc[tested, "p"].to_numpy())
    table["exceeds"] = table["p"] < FALSE_ALARM
    return table[list(COLUMNS)]


class _GroupSpectra:
    """Transforms of the signals of a group, by run.

    A target without lines leaks: a Hann window leaves neighbouring bins correlated.
    """

    def __init__(self, group: Group, signals: dict[str, np.ndarray], lines: np.ndarray | None):
        self.group = group
        self.lines = lines
        self.correlated = 1.0 if lines is not None else HANN
        self.F = signals.get("f_t")
        self.E = signals.get("driving")
        self.U, self.M = signals["u"], signals["model"]
        self.R = self.U - self.M
        self.output, self.residual = self.U, self.R

    @classmethod
    def of(cls, signals: Signals, group: Group, n: int) -> _GroupSpectra:
        rows = group.rows[:, :n]
        values = {"u": signals.y, "model": signals.predicted}
        if "f_t" in signals.channels:
            values["f_t"] = signals.channels["f_t"]
        if signals.driving is not None:
            values["driving"] = signals.channels[signals.driving]
        lines = group.lines if group.n_samples == n else None
        window = np.ones(n)
        if lines is None:
            window = hann(n, sym=False)
            window /= np.sqrt(np.mean(window**2))
        spectra = {
            k: fft.rfft(
                (v[rows] - v[rows].mean(axis=1, keepdims=True)) * window, axis=1, norm="ortho"
            )
            for k, v in values.items()
        }
        part = cls(group, spectra, lines)
        if lines is None:  # powers are those of the signals as they are
            part.output = fft.rfft(signals.y[rows], axis=1, norm="ortho")
            part.residual = fft.rfft(signals.residual[rows], axis=1, norm="ortho")
        return part


def _sets_of_bins(parts: list[_GroupSpectra], omega: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Bins that a row of the table is about, with their kind."""
    all_bins = np.arange(1, omega.size)
    lines = _common_lines([part.lines for part in parts])
    if lines is None:
        return [("band", bins) for bins in _bands(all_bins, np.ones(omega.size, bool))]
    if lines.size <= FEW:
        sets = [("excited", np.array([line])) for line in lines]
    else:
        member = np.isin(np.arange(omega.size), lines)
        sets = [("excited", bins) for bins in _bands(lines, member)]
    base = int(np.gcd.reduce(lines))
    rest = np.setdiff1d(all_bins, lines)
    harmonic = rest % base == 0
    if np.all(lines // base % 2 == 1):  # odd lines: distortion of even order falls beside them
        odd = harmonic & (rest // base % 2 == 1)
        kinds = {"odd": rest[odd], "even": rest[harmonic & ~odd], "between": rest[~harmonic]}
    else:
        kinds = {"between": rest}
    for kind, bins in kinds.items():
        if bins.size:
            sets += [(kind, b) for b in _bands(bins, np.isin(np.arange(omega.size), bins))]
    return sets


def _common_lines(of_groups: list[np.ndarray | None]) -> np.ndarray | None:
    """Excited lines of all groups; None if they do not share nearly all of them."""
    common = of_groups[0]
    for own in of_groups:
        if common is None or own is None:
            return None
        most = max(common.size, own.size)
        common = np.intersect1d(common, own)
        if common.size < SHARED * most:
            return None
    if common is None:
        return None
    # Mains hum beside a multisine of odd lines does not make it one of all lines.
    odd = common[common // np.gcd.reduce(common) % 2 == 1]
    return odd if odd.size >= SHARED * common.size else common


def distortion_tests(signals: Signals, ceiling: Ceiling) -> list[Test]:
    """Tests for power, at excited lines or beside them, that no linear response can make.

    Odd orders (cubic) distort the odd harmonics of odd lines, even orders the even harmonics.
    """
    n = min(group.n_samples for group in signals.groups)
    lines = _common_lines(
        [group.lines if group.n_samples == n else None for group in signals.groups]
    )
    if lines is None or not ceiling.route.separates:
        return []
    parts = [_GroupSpectra.of(signals, group, n) for group in signals.groups]
    omega = 2 * np.pi * fft.rfftfreq(n, signals.dt)
    S, known = ceiling.noise.at(omega), ceiling.noise.known(omega)
    total = sum(float(np.sum(signals.y[rows] ** 2)) for g in signals.groups for rows in g.rows)
    free = ceiling.noise.free
    base = int(np.gcd.reduce(lines))
    odd = bool(np.all(lines // base % 2 == 1))
    tests = []
    used = lines[known[lines]]
    if len(parts) > 1 and used.size and parts[0].F is not None:
        F = np.stack([part.F[0, used] for part in parts])  # type: ignore[index]
        R = np.stack([part.R[:, used].mean(axis=0) for part in parts])
        runs = np.array([part.group.n_runs for part in parts])[:, None]
        c = np.sum(runs * F.conj() * R, axis=0) / np.sum(runs * np.abs(F) ** 2, axis=0)
        left = np.sum(runs * np.abs(R - c * F) ** 2, axis=0)
        count = used.size * (len(parts) - 1)
        statistic = float(np.sum(left / S[used])) / count
        tests.append(
            Test(
                "distortion",
                "odd lines" if odd else "lines",
                statistic,
                float(f_distribution.sf(statistic, 2 * count, free * LINES_SHARE_NOISE)),
                size=statistic,
                cost=100 * 2 * max(float(np.sum(left)) - count * float(S[used].mean()), 0) / total,
                description="power at the excited lines that changes from target to target, over "
                "the noise there",
            )
        )
    if ceiling.route is Route.REPEATS:
        rest = np.setdiff1d(np.flatnonzero(known)[1:], lines)
        even = rest[rest // base % 2 == 0]
        kinds = {"odd harmonics": rest[rest // base % 2 == 1], "even harmonics": even}
        for name, bins in kinds.items() if odd else [("between lines", rest)]:
            if not bins.size:
                continue
            p = _repeatable(bins, parts, S[bins], free)
            power = sum(
                part.group.n_runs * float(np.sum(np.abs(part.R[:, bins].mean(axis=0)) ** 2))
                for part in parts
                if part.group.n_runs > 1
            )
            n_groups = sum(part.group.n_runs > 1 for part in parts)
            expected = n_groups * float(np.sum(S[bins]))
            tests.append(
                Test(
                    "distortion",
                    name,
                    power / expected,
                    p,
                    size=power / expected,
                    cost=100 * 2 * max(power - expected, 0.0) / total,
                    description="power beside the excited lines that repeats over runs, over the "
                    "noise there",
                )
            )
    return tests


def _bands(bins: np.ndarray, member: np.ndarray) -> list[np.ndarray]:
    """Bins in bands of equal width on a logarithmic scale, four bins at least."""
    low, high = max(int(bins[0]), 1), int(bins[-1]) + 1
    n_bands = int(np.clip(np.log(high / low) / np.log(WIDTH), 1, N_BANDS))
    edges = np.geomspace(low, high, n_bands + 1)
    sets: list[np.ndarray] = []
    held = np.array([], dtype=int)
    for low, high in itertools.pairwise(edges):
        inside = np.arange(int(np.ceil(low)), int(np.ceil(high)))
        held = np.concatenate([held, inside[member[inside]]])
        if held.size >= 4:
            sets.append(held)
            held = np.array([], dtype=int)
    if held.size:
        sets = [*sets[:-1], np.concatenate([*sets[-1:], held])]
    return sets


def _response(
    omega: np.ndarray,
    bins: np.ndarray,
    parts: list[_GroupSpectra],
    S: np.ndarray,
    known: bool,
    free: float,
) -> dict[str, float]:
    """Response in a band by way of the target, and a test of the residual's.

    It is that at the frequencies where the target has power, and ``omega`` is their mean: the
    middle of a band may lie between two lines.
    """
    weight = np.zeros(bins.size)
    FF = FE = FU = FM = FR = U2 = spread = 0.0 + 0.0j
    for part in parts:
        F = part.F[:, bins]  # type: ignore[index]
        FF += np.sum(np.abs(F) ** 2)
        spread += part.correlated * np.sum(np.abs(F) ** 2 * S)
        weight += np.sum(np.abs(F * part.E[:, bins]), axis=0)  # type: ignore[index]
        FE += np.sum(F.conj() * part.E[:, bins])  # type: ignore[index]
        FU += np.sum(F.conj() * part.U[:, bins])
        FM += np.sum(F.conj() * part.M[:, bins])
        FR += np.sum(F.conj() * part.R[:, bins])
        U2 += np.sum(np.abs(part.U[:, bins]) ** 2)
    row: dict[str, float] = {}
    if spread.real > 0 and known:
        row["p"] = float(f_distribution.sf(abs(FR) ** 2 / spread.real, 2, free))
    if abs(FE) > 0 and FF.real > 0:
        measured, model = FU / FE, FM / FE
        sd = float(np.sqrt(spread.real / 2) / abs(FE))
        row |= {
            "omega": float(np.exp(np.average(np.log(omega), weights=weight))),
            "coherence": float(abs(FU) ** 2 / (FF.real * U2.real)) if U2.real else np.nan,
            "measured_gain": float(abs(measured)),
            "measured_phase": float(np.rad2deg(np.angle(measured))),
            "sd_gain": sd,
            "sd_phase": float(np.rad2deg(sd / abs(measured))) if abs(measured) else np.nan,
            "model_gain": float(abs(model)),
            "model_phase": float(np.rad2deg(np.angle(model))),
        }
    return row


def _repeatable(bins: np.ndarray, parts: list[_GroupSpectra], S: np.ndarray, free: float) -> float:
    """P-value of what repeats over runs, at bins that hold no line."""
    statistic, n = 0.0, 0
    for part in parts:
        if part.group.n_runs > 1:
            mean = part.R[:, bins].mean(axis=0)
            statistic += float(np.sum(part.group.n_runs * np.abs(mean) ** 2 / S))
            n += bins.size
    if not n:
        return np.nan
    # The density is that of so many bins or of those of the band, whichever are more.
    free = max(free, 2 * bins.size * sum(part.group.n_runs - 1 for part in parts))
    return float(f_distribution.sf(statistic / n, 2 * n, free))
