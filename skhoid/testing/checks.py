"""``check_effect``: whether an effect obeys the rules on which models and searches rely."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects.base import Effect
from ..effects.composition import PLACES, Effects
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.parameter import CoreKind, Parameter
from ..effects.paths import Bias
from ..effects.record import Record, differentiated
from ..model.cores import ARXCore, OperatorCore
from ..model.operator_regressor import OperatorRegressor
from ..model.simulated_arx import SimulatedARX
from ..model.simulator import Simulator
from ..text import Estimate
from .records import DELAY, OPERATOR, signal_at, split_parts, started_later, synthetic_record


def check_effect(
    effect: Effect,
    *,
    core: CoreKind | str = CoreKind.OPERATOR,
    channels: Sequence[str] = (),
    recovers: Mapping[str, float] | None = None,
) -> None:
    """Check that an effect obeys the rules on which models and searches rely.

    The effect is documented; ``clone``, ``pickle``, ``get_params`` and ``set_params`` work on it;
    its starts lie within its limits, and there and at the limits ``apply`` gives finite values of
    the right kind and shape. ``apply`` modifies none of its arguments, is repeatable, treats all
    runs alike, takes time from ``record.t``, and does nothing at ``neutral`` values. The effect can
    be simulated alone and with other effects. All this holds for each of its ``variants``.

    Parameters
    ----------
    effect : Effect
        An instance.
    core : {"operator", "arx"} or CoreKind, default="operator"
        Kind of model in which it acts.
    channels : sequence of str, default=()
        Columns that the effect needs besides e, x, f_t, motion_acc, dist and speed.
    recovers : dict of str to float or None, default=None
        Parameter values with which to simulate runs; a model must recover them from as little as 24
        s. There the error e has a standard deviation of 1, and the output one of about 0.8. None
        leaves this check out.

    Raises
    ------
    AssertionError
        If a check fails; the message says what is wrong and how to fix it.

    See Also
    --------
    skhoid.effects.Effect : The base of all effects, and what it needs.

    Examples
    --------
    >>> from skhoid.effects import DeadZone
    >>> from skhoid.testing import check_effect
    >>> check_effect(DeadZone(form="gap"), recovers={"width": 0.4})
    """
    if core not in (CoreKind.OPERATOR, CoreKind.ARX):
        raise ValueError(f'core must be "operator" or "arx"; got {core!r}.')
    expect(
        isinstance(effect, Effect),
        f"{effect!r} is not an instance of skhoid.effects.Effect"
        + (": pass an instance, not the class." if isinstance(effect, type) else "."),
    )
    record = synthetic_record(channels)
    check_description(effect)
    check_estimator(effect)
    reason = effect.refusal(record, CoreKind(core))
    expect(
        reason is None,
        f"{find_name(effect)} does not apply to the runs on which it is checked: {reason}. They "
        f"have the columns {', '.join(record.channels)}; name others with channels=[...].",
    )
    variants = effect.variants(record)
    expect(
        isinstance(variants, list) and len(variants) > 0,
        f"{find_name(effect)}.variants must return a list of at least one effect; got "
        f"{variants!r}.",
    )
    for variant in variants:
        expect(
            isinstance(variant, Effect) and variant.name == effect.name,
            f"{find_name(effect)}.variants must return effects of the same name; got {variant!r}.",
        )
        check_description(variant)
        check_estimator(variant)
        check_starts(variant, record)
        check_apply(variant, record)
        check_neutral(variant, record)
        check_symmetries(variant, record)
        check_simulation(variant, record, CoreKind(core))
    if recovers is not None:
        check_recovery(variants[0], record, CoreKind(core), dict(recovers))


def expect(condition: Any, message: str) -> None:
    if not condition:
        raise AssertionError(message)


def find_name(effect: Effect) -> str:
    return type(effect).__name__


def check_description(effect: Effect) -> None:
    who = find_name(effect)
    name, place = getattr(effect, "name", None), getattr(effect, "place", None)
    expect(
        isinstance(name, str) and name.isidentifier() and "__" not in name,
        f'{who}.name must be a word without spaces or "__", such as "dead_zone", for tables and '
        f"scripts; got {name!r}.",
    )
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
    expect(set(effect.neutral) <= set(names), f"{who}.neutral names what is no parameter.")
    for p in effect.parameters:
        expect(
            p.meaning.strip() and p.starts and all(p.low <= s <= p.high for s in p.starts),
            f"Parameter {p.name!r} of {who} needs a meaning, for tables, and starts between "
            f"low = {p.low} and high = {p.high}; got {p.starts}.",
        )


def check_estimator(effect: Effect) -> None:
    who = find_name(effect)
    params = effect.get_params()
    missing = [p.name for p in effect.parameters if p.name not in params]
    expect(not missing, f"{who}.__init__ must take {missing} by keyword, with the default None.")
    try:
        copied = clone(effect).get_params()
    except (RuntimeError, TypeError, AttributeError) as error:
        raise AssertionError(
            f"{who}.__init__ must only store its arguments, as self.width = width does, each with "
            f"a default ({error})."
        ) from error
    expect(same(copied, params), f"{who} does not survive clone: {copied} instead of {params}.")


def same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    return one.keys() == other.keys() and all(
        type(one[k]) is type(other[k]) and np.array_equal(one[k], other[k]) for k in one
    )


def own_values(start: Mapping[str, float]) -> dict[str, float]:
    """Those of the effect in a start, which may change the model too."""
    return {k: v for k, v in start.items() if not k.startswith("+")}


def check_starts(effect: Effect, record: Record) -> None:
    limits, names = effect.limits(record), {p.name for p in effect.parameters}
    for start in map(own_values, effect.starts(record)):
        expect(
            start.keys() == limits.keys() == names,
            f"{find_name(effect)}.starts and limits must give each parameter: {sorted(names)}; got "
            f"{sorted(start)} and {sorted(limits)}.",
        )
        for key, value in start.items():
            low, high = limits[key]
            expect(
                np.isfinite(value) and low <= value <= high,
                f"{find_name(effect)}.starts gives {key} = {value:.4g}, which is not within its "
                f"limits, {low:.4g} to {high:.4g}.",
            )


def _tried(effect: Effect, record: Record) -> Iterator[dict[str, float]]:
    """Values to apply the effect at: the starts, and the first start with each finite limit."""
    own = [own_values(start) | effect.fixed for start in effect.starts(record)]
    yield from own
    for key, bounds in effect.limits(record).items():
        if key not in effect.fixed:
            yield from ({**own[0], key: b} for b in bounds if np.isfinite(b))


def _applied(effect: Effect, record: Record, values: dict[str, float]) -> Any:
    try:
        return effect.apply(signal_at(effect.place, record), record, **values)
    except Exception as error:
        raise AssertionError(
            f"{find_name(effect)}.apply fails at {shown(values)}: {type(error).__name__}: {error}. "
            "It is called as apply(signal, record, <each parameter by name>)."
        ) from error


def shown(values: Mapping[str, float]) -> str:
    return ", ".join(f"{k} = {v:.4g}" for k, v in values.items()) or "no parameters"


def check_apply(effect: Effect, record: Record) -> None:
    who = find_name(effect)
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
    for name, values in split_parts(out).items():
        which = f"{at}, {name}," if name else at
        # Delay and gains may be anything that broadcasts over samples and runs.
        broad = place == "delay" or kind is Gains or name == "delay"
        needed: tuple[int, ...] = shape
        if place in ("spring", "inside"):
            needed = values.shape if name in ("terms", "curves") else ()
        fits = values.shape == needed
        if broad:
            padded = (1,) * (len(shape) - values.ndim) + values.shape
            fits = values.ndim <= 2 and all(n in (1, m) for n, m in zip(padded, shape, strict=True))
        expect(
            fits,
            f"{which} must give shape {needed}, (n_samples, n_runs)"
            f"{' or what broadcasts to it' if broad else ''}; got {values.shape}.",
        )
        expect(
            np.isfinite(values).all(),
            f"{which} gives values that are not finite: check for divisions by zero and roots of "
            "negative numbers, or narrow the limits low and high of the parameters.",
        )


def _equal(one: Any, other: Any) -> bool:
    a, b = split_parts(one), split_parts(other)
    return a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in a)


def _compared_arrays(signal: Any, record: Record) -> dict[str, np.ndarray]:
    """Arrays of a signal; for a command its sum, since effects may move its rate into position.

    For a spring its forces, since one of size zero may be written down too.
    """
    parts = split_parts(signal)
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
        values = own_values(start) | {**effect.fixed, **effect.neutral}
        given = signal_at(effect.place, record)
        out = _compared_arrays(_applied(effect, record, values), record)
        for name, expected in _compared_arrays(given, record).items():
            expect(
                np.allclose(out[name], expected, rtol=1e-9, atol=1e-9),
                f"{find_name(effect)}.apply at its neutral values ({shown(effect.neutral)}) must "
                "return what it is given: neutral values are those at which the effect does "
                "nothing.",
            )


def check_symmetries(effect: Effect, record: Record) -> None:
    """Runs in another order, and a later start, give the same result."""
    who = find_name(effect)
    order = np.array([2, 0, 1])
    values = own_values(effect.starts(record)[0]) | effect.fixed
    out = split_parts(_applied(effect, record, values))
    permuted = split_parts(_applied(effect, record.part(order, 1), values))
    n = record.known.shape[0]
    shift = round(1.0 / record.dt)
    later = split_parts(_applied(effect, started_later(record, shift), values))
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


ARX = {"a1": -1.6, "a2": 0.68, "b0": 0.05, "b1": 0.03}
NOISE = 0.02  # of the output's standard deviation
SURE = 5.0  # standard errors by which an estimate may be off
CLOSE = 0.03  # share of its value by which it may be off, however small its standard error


def _core(core: CoreKind) -> tuple[Any, list[float]]:
    if core == CoreKind.ARX:
        return ARXCore(2, 2, 10), list(ARX.values())
    return OperatorCore(DELAY), list(OPERATOR.values())


def _simulated(steps: Effects, values: Mapping[str, float], record: Record, core: CoreKind) -> Any:
    """Output of a core with effects, at values of the parameters of one of them."""
    model, own = _core(core)
    simulator = Simulator(model, steps, record)
    theta = [*own, *(values[n] for n in simulator.names[len(own) :])]
    return simulator.run(np.array(theta))


def check_simulation(effect: Effect, record: Record, core: CoreKind) -> None:
    alone, beside = Effects.of(effect), Bias(level=0.1) + effect + Bias(level=0.2)
    twice = effect + clone(effect)
    start = own_values(effect.starts(record)[0])
    values = {f"{n}__{k}": v for n in beside.names + twice.names for k, v in start.items()}
    for together in (alone, beside, twice):
        out = _simulated(together, values, record, core)
        expect(
            np.isfinite(out).all(),
            f"A simulation with {' + '.join(together.names)} is not finite at {shown(start)}: "
            "check the sign and the size of starts.",
        )


def check_recovery(effect: Effect, record: Record, core: CoreKind, truth: dict) -> None:
    """Simulate, estimate, compare."""
    who = find_name(effect)
    names = {p.name for p in effect.free}
    expect(
        truth.keys() == names,
        f"recovers must give a value for each estimated parameter: {sorted(names)}; got "
        f"{sorted(truth)}.",
    )
    quiet = _simulated(
        Effects.of(effect), {f"{effect.name}__{k}": v for k, v in truth.items()}, record, core
    )
    noise = np.random.default_rng(1).standard_normal(quiet.shape)
    output = quiet + NOISE * quiet.std() * noise
    X, y = _as_dataset(record, output)
    element = record.controlled_element
    if core == CoreKind.ARX:
        model: Any = SimulatedARX(2, 2, 10, effects=effect, controlled_element=element)
    else:
        free = effect.refusal(record, CoreKind.OPERATOR_FREE_DELAY) is None
        delay = None if free else DELAY
        model = OperatorRegressor(delay, effects=effect, controlled_element=element)
    fitted = model.fit(X, y)
    for key, value in truth.items():
        row = fitted.parameters_.loc[f"{effect.name}__{key}"]
        off = abs(row["value"] - value)
        expect(
            off <= max(SURE * np.nan_to_num(row["sd"]), CLOSE * abs(value), 1e-3),
            f"{who}: {key} was simulated as {value:.4g} and estimated as {Estimate.of(row)}. "
            "Give more starts, closer to usual values; set smooth = False if the output does not "
            "change smoothly with the parameters. Or the parameters cannot be told apart.",
        )


def _as_dataset(record: Record, output: np.ndarray) -> tuple[pd.DataFrame, pd.Series]:
    """X and y with the known samples of each run."""
    frames = []
    for j in range(record.n_runs):
        known = record.known[:, j]
        frame = pd.DataFrame({name: v[known, j] for name, v in record.channels.items()})
        frame["u"] = output[known, j]
        time = np.round(record.t[known, 0], 9)
        frame.index = pd.MultiIndex.from_arrays(
            [np.full(time.size, j), time], names=["run", "time"]
        )
        frames.append(frame)
    table = pd.concat(frames)
    return table.drop(columns="u"), table["u"]
