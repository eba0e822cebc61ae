"""Check of rate channels (velocities) against the angles whose derivatives they should be."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .recording import Finding, RawRecording, join_names

RATE_NAMES = ("rate", "rates", "dot", "velocity", "vel", "speed", "derivative", "deriv")
ANGLE_NAMES = ("angle", "angles", "ang", "position", "pos", "displacement", "attitude")
UNIT_NAMES = ("deg", "rad", "degrees", "radians", "dps", "s", "sec", "mm", "cm", "px", "per")

LONGEST = 1.0  # s, over which changes of the angle are compared with the integral of the rate
LEAST_STEPS = 30
OUTLIER = 6.0  # robust standard deviations
UNRELATED = 0.5  # correlation, below which a channel is not the rate of the other
TOLERANCE = 1.1  # ratio of gains that a calibration may leave
ALIKE = 10.0  # ratio of spreads within which channels may come from one sensor
FACTORS = {
    180 / np.pi: "pi/180 too small: degrees were converted to radians twice, or {angle} is in "
    "degrees and {rate} in radians per second",
    np.pi / 180: "180/pi too large: {rate} is in degrees per second and {angle} in radians",
    1000.0: "1000 times too small: {angle} is in thousandths of the unit of {rate}, or time was "
    "counted in milliseconds",
    0.001: "1000 times too large: {rate} is in thousandths of the unit of {angle} per second",
    2 * np.pi: "2 pi too small: {rate} is in revolutions per second and {angle} in radians",
    np.pi / 30: "30/pi too large: {rate} is in revolutions per minute and {angle} in radians",
    6.0: "6 times too small: {rate} is in revolutions per minute and {angle} in degrees",
}


@dataclass(frozen=True)
class Gain:
    """Change of an angle for each unit of the integrated rate, over so many samples.

    ``low`` and ``high`` are the two regression lines, of magnitude; the true gain lies between them
    whichever of the channels is noisy. ``correlation`` has the sign.
    """

    low: float
    high: float
    correlation: float
    length: int

    def allows(self, factor: float) -> bool:
        return self.low / TOLERANCE <= factor <= self.high * TOLERANCE

    @property
    def middle(self) -> float:
        return float(np.sqrt(self.low * self.high))


def check_rates(recording: RawRecording) -> list[Finding]:
    """Rates that are not the derivatives of their angles."""
    wrong, right = [], []
    for angle, rate in pairs(recording.names):
        gain = _gain(recording, angle, rate)
        if gain is None:
            continue
        if gain.correlation >= UNRELATED and gain.allows(1.0):
            right.append(rate)
        else:
            wrong.append((angle, rate, gain))
    known = [*right, *(rate for _, rate, _ in wrong)]
    alone = [
        name
        for name, values in recording.values.items()
        if _rate_stem(name) is not None
        and name not in known
        and np.isfinite(values).sum() > LEAST_STEPS
    ]
    return [_wrong(recording, *found, alone) for found in wrong]


def pairs(names: list[Any]) -> Iterator[tuple[Any, Any]]:
    """Channels and their rates, by name: stem and stem + rate, in any style of writing."""
    angles = {_drop_angle(_parts(name)): name for name in names if _rate_stem(name) is None}
    for name in names:
        stem = _rate_stem(name)
        if stem in angles:
            yield angles[stem], name


def _parts(name: Any) -> list[str]:
    parts = [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", str(name))]
    while len(parts) > 1 and parts[-1] in UNIT_NAMES:
        parts.pop()
    return parts


def _rate_stem(name: Any) -> str | None:
    """A name without the part that means rate; None if it has no such part."""
    parts = _parts(name)
    if len(parts) > 1 and parts[-1] in RATE_NAMES:
        parts = parts[:-1]
    elif parts and (match := re.match(r"(.+)(dot|rate|vel|velocity)$", parts[-1])):
        parts = [*parts[:-1], match[1]]
    else:
        return None
    return _drop_angle(parts)


def _drop_angle(parts: list[str]) -> str:
    if len(parts) > 1 and parts[-1] in ANGLE_NAMES:
        parts = parts[:-1]
    elif parts and (match := re.match(r"(.+)(angle|position|pos)$", parts[-1])):
        parts = [*parts[:-1], match[1]]
    return "".join(parts)


def _gain(recording: RawRecording, angle: Any, rate: Any) -> Gain | None:
    """Gain at the duration of changes over which the channels agree best.

    A longer change averages noise, a shorter one sees more of fast motion.
    """
    best = None
    length = 1
    while length * recording.dt <= LONGEST or length <= 8:
        change, integral = _changes(recording, angle, rate, length)
        gain = _regression(change, integral, length)
        if gain is not None and (best is None or abs(gain.correlation) > abs(best.correlation)):
            best = gain
        length *= 2
    return best


def _changes(
    recording: RawRecording, angle: Any, rate: Any, length: int
) -> tuple[np.ndarray, np.ndarray]:
    """Changes of the angle over so many samples, and the integral of the rate over them."""
    of_angle, of_rate = [np.zeros(0)], [np.zeros(0)]
    for rows in recording.segments:
        a, r = recording.values[angle][rows], recording.values[rate][rows]
        if len(a) <= length:
            continue
        area = np.diff(recording.time[rows]) * (r[1:] + r[:-1]) / 2
        integral = np.append(0.0, np.cumsum(np.nan_to_num(area)))
        missing = np.append(0, np.cumsum(np.isnan(area)))
        at = np.arange(0, len(a) - length, max(length // 2, 1))
        change = a[at + length] - a[at]
        whole = (missing[at + length] == missing[at]) & np.isfinite(change)
        of_angle.append(change[whole])
        of_rate.append((integral[at + length] - integral[at])[whole])
    return np.concatenate(of_angle), np.concatenate(of_rate)


def _regression(change: np.ndarray, integral: np.ndarray, length: int) -> Gain | None:
    """Both regression lines, without outliers such as an angle that wraps round."""
    kept = np.ones(change.size, dtype=bool)
    for _ in range(3):
        if kept.sum() < LEAST_STEPS:
            return None
        a, q = change[kept] - change[kept].mean(), integral[kept] - integral[kept].mean()
        cross, power = float(a @ q), (float(a @ a), float(q @ q))
        if not min(power) > 0 or cross == 0:
            return None
        slope = cross / power[1]
        error = change - slope * integral
        error = error - np.median(error[kept])
        spread = 1.4826 * np.median(np.abs(error[kept]))
        kept = np.abs(error) <= OUTLIER * spread if spread > 0 else kept
    return Gain(
        low=abs(slope),
        high=power[0] / abs(cross),
        correlation=cross / float(np.sqrt(power[0] * power[1])),
        length=length,
    )


def _wrong(recording: RawRecording, angle: Any, rate: Any, gain: Gain, alone: list[Any]) -> Finding:
    duration = gain.length * recording.dt
    if abs(gain.correlation) < UNRELATED:
        return Finding(
            "rate unit",
            f"{rate} is not the derivative of {angle}",
            f"Changes of {angle} and the integral of {rate} correlate by {gain.correlation:.2f} "
            f"at best (over {duration:.3g} s).",
            "One of the two is not the signal that its name says, or noise hides it.",
            f"Check both channels before using {rate} as a motion cue for {angle}.",
            about=f"{rate}, {angle}",
        )
    factors = FACTORS | {
        1 / recording.dt: "differences from row to row that were not divided by the sampling time"
    }
    fitting = [factor for factor in factors if gain.allows(factor)]
    sign = "" if gain.correlation > 0 else "-"
    between = f"{gain.low:.4g} and {gain.high:.4g}"
    evidence = (
        f"Over {duration:.3g} s {angle} changes by {sign}{gain.middle:.4g} times the integral "
        f"of {rate} (regression lines of {between}, correlation {gain.correlation:.3f})."
    )
    if gain.allows(1.0):
        title = f"{rate} has the opposite sign of the derivative of {angle}"
        meaning = "The axes of the two sensors point in opposite directions, or one was negated."
        factor = "-1"
    elif fitting:
        nearest = min(fitting, key=lambda f: abs(np.log(f / gain.middle)))
        why = factors[nearest].format(angle=angle, rate=rate)
        title = f"{rate} is not the derivative of {angle}: factor {sign}{gain.middle:.3g}"
        meaning = f"The factor of this unit error would be {nearest:.4g}: {rate} is {why}."
        factor = f"{sign}{nearest:.6g}"
        if nearest == 1 / recording.dt:
            meaning = f"{rate} holds {why} (factor {nearest:.4g})."
    else:
        title = f"{rate} is not the derivative of {angle}: factor {sign}{gain.middle:.3g}"
        meaning = "No common unit conversion has this factor: the gain or calibration is wrong."
        factor = f"{sign}{gain.middle:.4g}"
    if sign and not gain.allows(1.0):
        meaning += " The sign is also opposite."
    next_step = f"Multiply {rate} by {factor}, unless {angle} is the one that is wrong."
    others = _alike(recording, rate, alone)
    if others and not gain.allows(1.0):
        next_step += (
            f" {join_names(others)} {'has' if len(others) == 1 else 'have'} no angle to be checked "
            f"against, and {'is' if len(others) == 1 else 'are'} as small or large: probably "
            "converted together, and wrong by the same factor."
        )
    return Finding(
        "rate unit",
        title,
        evidence,
        meaning,
        next_step,
        about=f"{rate}, {angle}",
    )


def _alike(recording: RawRecording, rate: Any, alone: list[Any]) -> list[Any]:
    """Rates without an angle, of the unit and the size of another."""
    spread = {name: float(np.nanstd(recording.values[name])) for name in [rate, *alone]}
    units = recording.units
    return [
        name
        for name in alone
        if units.get(name) == units.get(rate)
        and spread[rate] / ALIKE <= spread[name] <= spread[rate] * ALIKE
    ]
