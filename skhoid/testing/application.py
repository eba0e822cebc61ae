"""Checks of ``Effect.apply``: results, neutral values, symmetries."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..effects.base import Effect
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.record import Record, differentiated
from .descriptions import expect, name_of, same
from .records import parts_of, signal_at, started_later


def _tried(effect: Effect, record: Record) -> Iterator[dict[str, float]]:
    """Values to apply the effect at: the starts, and the first start with each finite limit."""
    own = [
        {k: v for k, v in s.items() if not k.startswith("+")} | effect.fixed
        for s in effect.starts(record)
    ]
    yield from own
    for key, bounds in effect.limits(record).items():
        if key not in effect.fixed:
            yield from ({**own[0], key: b} for b in bounds if np.isfinite(b))


def _applied(effect: Effect, record: Record, values: dict[str, float]) -> Any:
    try:
        return effect.apply(signal_at(effect.place, record), record, **values)
    except Exception as error:
        raise AssertionError(
            f"{name_of(effect)}.apply fails at {shown(values)}: {type(error).__name__}: {error}. "
            "It is called as apply(signal, record, <each parameter by name>)."
        ) from error


def shown(values: Mapping[str, float]) -> str:
    return ", ".join(f"{k} = {v:.4g}" for k, v in values.items()) or "no parameters"


def check_apply(effect: Effect, record: Record) -> None:
    who = name_of(effect)
    before_effect = copy.deepcopy(effect.__dict__)
    for values in _tried(effect, record):
        given = signal_at(effect.place, record)
        kept = copy.deepcopy(given)
        channels = {k: v.copy() for k, v in record.channels.items()}
        with np.errstate(all="ignore"):  # non-finite values are reported below
            _applied(effect, record, values)
            out = effect.apply(given, record, **values)
        at = f"{who}.apply at {shown(values)}"
        _check_kind(out, effect.place, record, at)
        expect(
            _equal(given, kept),
            f"{at} changes the signal that it is given: return a new one (signal + ..., not "
            "signal += ...).",
        )
        expect(
            all(np.array_equal(channels[k], record.channels[k]) for k in channels),
            f"{at} changes a channel of the record: work on a copy.",
        )
        with np.errstate(all="ignore"):
            again = effect.apply(signal_at(effect.place, record), record, **values)
        expect(
            _equal(out, again),
            f"{at} gives a different result the second time: it must neither draw random numbers "
            "nor remember calls.",
        )
    expect(
        effect.__dict__.keys() == before_effect.keys() and same(effect.__dict__, before_effect),
        f"{who}.apply changes the effect itself: store nothing on self.",
    )


def _check_kind(out: Any, place: str, record: Record, at: str) -> None:
    kinds: dict[str, type] = {"gain": Gains, "path": Command, "command": Command}
    kinds |= {"spring": Spring, "inside": Spring}
    kind = kinds.get(place)
    shape = record.known.shape
    if kind is not None:
        expect(
            isinstance(out, kind),
            f"{at} must return {kind.__name__}, as signal.plus(...), signal.times(...), "
            f"signal.stiffer(...) or signal._replace(...) do; got {type(out).__name__}.",
        )
    for name, values in parts_of(out).items():
        which = f"{at}, {name}," if name else at
        needed: tuple[int, ...] | None = shape
        if place in ("spring", "inside"):
            needed = values.shape if name in ("terms", "curves") else ()
        elif place == "delay" or kind is Gains or name == "delay":
            needed = None  # anything that broadcasts over samples and runs
        if needed is None:
            try:
                fits = np.broadcast_shapes(values.shape, shape) == shape
            except ValueError:
                fits = False
            expect(
                fits,
                f"{which} must give a shape that broadcasts to (n_samples, n_runs) = {shape}; got "
                f"{values.shape}.",
            )
        else:
            expect(
                values.shape == needed,
                f"{which} must give shape {needed}"
                + (" (n_samples, n_runs)" if needed else ", a number")
                + f"; got {values.shape}.",
            )
        expect(
            np.isfinite(values).all(),
            f"{which} gives values that are not finite: check for divisions by zero and roots of "
            "negative numbers, or narrow the limits low and high of the parameters.",
        )


def _equal(one: Any, other: Any) -> bool:
    a, b = parts_of(one), parts_of(other)
    return a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in a)


def _compared_arrays(signal: Any, record: Record) -> dict[str, np.ndarray]:
    """Arrays of a signal; for a command its sum, since effects may move its rate into position.

    For a spring its forces, since one of size zero may be written down too.
    """
    parts = parts_of(signal)
    if isinstance(signal, Command):
        total = parts["position"] + differentiated(parts["rate"], record.dt)
        return {"command": total, "delay": parts["delay"]}
    if isinstance(signal, Spring):
        at = np.linspace(-3.0, 3.0, 61)
        forces = [signal.force(output, rate) for output, rate in ((at, 0.0 * at), (0.0 * at, at))]
        return {"force": np.concatenate(forces), "stops": np.array(signal.stops)}
    return parts


def check_neutral(effect: Effect, record: Record) -> None:
    if not effect.neutral:
        return
    for start in effect.starts(record):
        values = {k: v for k, v in start.items() if not k.startswith("+")}
        values |= {**effect.fixed, **effect.neutral}
        given = signal_at(effect.place, record)
        out = _compared_arrays(_applied(effect, record, values), record)
        for name, expected in _compared_arrays(given, record).items():
            expect(
                np.allclose(out[name], expected, rtol=1e-9, atol=1e-9),
                f"{name_of(effect)}.apply at its neutral values ({shown(effect.neutral)}) must "
                "return what it is given: neutral values are those at which the effect does "
                "nothing.",
            )


def check_symmetries(effect: Effect, record: Record) -> None:
    """Runs in another order, and a later start, give the same result."""
    who = name_of(effect)
    order = np.array([2, 0, 1])
    values = {k: v for k, v in effect.starts(record)[0].items() if not k.startswith("+")}
    values |= effect.fixed
    out = parts_of(_applied(effect, record, values))
    permuted = parts_of(_applied(effect, replace(record.part(order, 1)), values))
    n = record.known.shape[0]
    shift = round(1.0 / record.dt)
    later = parts_of(_applied(effect, started_later(record, shift), values))
    for name, expected in out.items():
        if expected.shape == record.known.shape:
            expect(
                np.allclose(permuted[name], expected[:, order], rtol=1e-9, atol=1e-9),
                f"{who}.apply does not treat runs alike: with the runs (columns) in another "
                "order, the result must have the same columns in that order. Work along axis 0 "
                "only.",
            )
        if expected.ndim == 2 and expected.shape[0] == n and effect.smooth:
            expect(
                np.allclose(later[name][shift:], expected, rtol=1e-6, atol=1e-6),
                f"{who}.apply depends on when the recording began: with a second of silence "
                "before it, the result must be the same, a second later. Take time from record.t, "
                "not from the sample number.",
            )
