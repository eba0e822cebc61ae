"""Checks of an effect as an object: its documentation, scikit-learn's contract, its starts."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from sklearn.base import clone

from ..effects.base import Effect
from ..effects.composition import PLACES
from ..effects.parameter import Parameter
from ..effects.record import Record


def expect(condition: Any, message: str) -> None:
    if not condition:
        raise AssertionError(message)


def name_of(effect: Effect) -> str:
    return type(effect).__name__


def check_description(effect: Effect) -> None:
    who = name_of(effect)
    name = getattr(effect, "name", None)
    expect(
        isinstance(name, str) and name.isidentifier() and "__" not in name,
        f'{who}.name must be a word without spaces or "__", such as "dead_zone", for tables and '
        f"scripts; got {name!r}.",
    )
    place = getattr(effect, "place", None)
    expect(place in PLACES, f"{who}.place must be one of {', '.join(PLACES)}; got {place!r}.")
    for attribute in ("physics", "formula"):
        text = getattr(effect, attribute)
        expect(
            isinstance(text, str) and text.strip(),
            f"{who}.{attribute} is empty: say what the effect is, for summaries.",
        )
    expect(
        isinstance(effect.parameters, tuple)
        and all(isinstance(p, Parameter) for p in effect.parameters),
        f"{who}.parameters must be a tuple of skhoid.effects.Parameter (mind the comma of a tuple "
        f"of one); got {effect.parameters!r}.",
    )
    names = [p.name for p in effect.parameters]
    expect(len(set(names)) == len(names), f"{who}.parameters has the same name twice: {names}.")
    for p in effect.parameters:
        expect(
            p.meaning.strip(),
            f"Parameter {p.name!r} of {who} has no meaning: say what it is, for tables.",
        )
        expect(
            p.low < p.high,
            f"Parameter {p.name!r} of {who} must have low < high; got {p.low} and {p.high}.",
        )
        expect(
            len(p.starts) > 0 and all(p.low <= s <= p.high for s in p.starts),
            f"Parameter {p.name!r} of {who} needs starts between low = {p.low} and high = "
            f"{p.high}; got {p.starts}.",
        )


def check_estimator(effect: Effect) -> None:
    who = name_of(effect)
    params = effect.get_params()
    for p in effect.parameters:
        expect(
            p.name in params,
            f"{who}.__init__ must take {p.name} as a keyword argument with the default None.",
        )
    expect(
        all(k in params and isinstance(v, tuple) and v for k, v in effect.choices.items()),
        f"{who}.choices must map arguments of __init__ to tuples of choices, "
        f'such as {{"form": ("soft", "hard")}}; got {effect.choices}.',
    )
    try:
        type(effect)()
    except TypeError as error:
        raise AssertionError(
            f"{who}() must work: give each argument a default, None for what is estimated "
            f"({error})."
        ) from error
    try:
        cloned = clone(effect)
    except (RuntimeError, AttributeError) as error:
        raise AssertionError(
            f"{who}.__init__ must only store its arguments, as self.width = width does ({error})."
        ) from error
    for how, copied in {"clone": cloned, "pickle": _pickled(effect)}.items():
        expect(
            same(copied.get_params(), params),
            f"{who} does not survive {how}: {copied.get_params()} instead of {params}. __init__ "
            "must only store its arguments.",
        )
    for p in effect.parameters:
        value = 0.5 * (max(p.low, -1e3) + min(p.high, 1e3))
        changed = clone(effect).set_params(**{p.name: value})
        expect(
            changed.fixed.get(p.name) == value and p.name not in [f.name for f in changed.free],
            f"{who}.set_params({p.name}={value}) must fix the parameter: keep it in self.{p.name}.",
        )


def _pickled(effect: Effect) -> Effect:
    """A copy through pickle, which finds classes by name; for local classes only the arguments."""
    kind = type(effect)
    found: Any = sys.modules.get(kind.__module__)
    for part in kind.__qualname__.split("."):
        found = getattr(found, part, None)
    try:
        if found is kind:
            return pickle.loads(pickle.dumps(effect))
        return kind(**pickle.loads(pickle.dumps(effect.get_params(deep=False))))
    except Exception as error:
        raise AssertionError(
            f"{name_of(effect)} cannot be pickled, which parallel searches need: pass it numbers, "
            f"strings and arrays, not local functions ({error})."
        ) from error


def same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    return one.keys() == other.keys() and all(
        type(one[k]) is type(other[k]) and np.array_equal(one[k], other[k]) for k in one
    )


def check_starts(effect: Effect, record: Record) -> None:
    who = name_of(effect)
    limits, starts = effect.limits(record), effect.starts(record)
    names = {p.name for p in effect.parameters}
    expect(
        limits.keys() == names,
        f"{who}.limits must name each parameter: {sorted(names)}; got {sorted(limits)}.",
    )
    expect(len(starts) > 0, f"{who}.starts must return at least one start.")
    for start in starts:
        own = {k: v for k, v in start.items() if not k.startswith("+")}
        expect(
            own.keys() == names,
            f"{who}.starts must give each parameter: {sorted(names)}; got {sorted(own)}.",
        )
        for key, value in own.items():
            low, high = limits[key]
            expect(
                np.isfinite(value) and low <= value <= high,
                f"{who}.starts gives {key} = {value:.4g}, which is not within its limits, "
                f"{low:.4g} to {high:.4g}.",
            )
    unknown = effect.neutral.keys() - names
    expect(not unknown, f"{who}.neutral names {sorted(unknown)}, which are not parameters.")
