"""Checks of effects of your own."""

from __future__ import annotations

import copy
import pickle
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from .effects.base import Effect
from .effects.composition import PLACES, Effects
from .effects.core_kind import CoreKind
from .effects.offsets import Bias
from .effects.operator_signals import Command, Gains, Spring
from .effects.parameter import Parameter
from .effects.record import Record, differentiated
from .greybox.cores import ARXCore, OperatorCore, neutral_gains
from .greybox.simulator import Simulator
from .human.controlled_element import ControlledElement
from .runs.roles import OTHER
from .summaries import Estimate

__all__ = ["check_effect", "synthetic_record"]

DT = 0.02  # s
DURATION = 24.0  # s
N_RUNS = 3
SILENT = 2.0  # s of zeros at the start, so that starting later is the same but for the time
DELAY = 0.2  # s
OPERATOR = {"K_e": 0.8, "K_edot": 0.3, "omega_nm": 9.0, "zeta_nm": 0.4}
ARX = {"a1": -1.6, "a2": 0.68, "b0": 0.05, "b1": 0.03}
NOISE = 0.02  # of the output's standard deviation
SURE = 5.0  # standard errors that an estimate may be off
CLOSE = 0.03  # of its value that it may be off however small its standard error


def check_effect(
    effect: Effect,
    *,
    core: CoreKind | str = CoreKind.OPERATOR,
    channels: Sequence[str] = (),
    recovers: Mapping[str, float] | None = None,
) -> None:
    """Check that an effect keeps the rules which models and searches rely on.

    It is documented; an estimator that ``clone``, ``pickle``, ``get_params`` and ``set_params``
    work on; its starts lie within its limits, and there and at the limits ``apply`` gives finite
    values of the right kind and shape. ``apply`` changes nothing, gives the same for the same,
    treats runs alike and time by ``record.t``, and does nothing at ``neutral`` values. It simulates
    alone and beside other effects. All this holds for each of its ``variants``.

    Parameters
    ----------
    effect : Effect
        An instance.
    core : {"operator", "arx"} or CoreKind, default="operator"
        Model that it is to act in.
    channels : sequence of str, default=()
        Columns that the effect needs besides e, x, f_t, motion_acc, dist and speed.
    recovers : dict of str to float or None, default=None
        Values of its parameters to simulate runs with, of which a model must estimate the same
        from as little as 24 s. The error e has a standard deviation of 1 there, and the
        output one of about 0.8. None does not try.

    Raises
    ------
    AssertionError
        Says what is wrong, and how to mend it.

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
    _expect(
        isinstance(effect, Effect),
        f"{effect!r} is no instance of skhoid.effects.Effect"
        + (": pass an instance, not the class." if isinstance(effect, type) else "."),
    )
    record = synthetic_record(channels)
    _check_description(effect)
    _check_estimator(effect)
    reason = effect.refusal(record, CoreKind(core))
    _expect(
        reason is None,
        f"{_name(effect)} does not apply to the runs that it is checked on: {reason}. They have "
        f"the columns {', '.join(record.channels)}; name others by channels=[...].",
    )
    variants = effect.variants(record)
    _expect(
        isinstance(variants, list) and len(variants) > 0,
        f"{_name(effect)}.variants must return a list with one effect at least; got {variants!r}.",
    )
    for variant in variants:
        _expect(
            isinstance(variant, Effect) and variant.name == effect.name,
            f"{_name(effect)}.variants must return effects of the same name; got {variant!r}.",
        )
        _check_description(variant)
        _check_estimator(variant)
        _check_starts(variant, record)
        _check_apply(variant, record)
        _check_neutral(variant, record)
        _check_symmetries(variant, record)
        _check_simulation(variant, record, CoreKind(core))
    if recovers is not None:
        _check_recovery(variants[0], record, CoreKind(core), dict(recovers))


def synthetic_record(channels: Sequence[str] = (), seed: int = 0) -> Record:
    """Runs of smooth random channels, silent at the beginning, the last one shorter.

    Parameters
    ----------
    channels : sequence of str, default=()
        Names of further channels, which get no role.
    seed : int, default=0
        Of the random phases.

    Returns
    -------
    record : Record

    Examples
    --------
    >>> from skhoid.testing import synthetic_record
    >>> record = synthetic_record(["heat"])
    >>> list(record.channels), record.n_runs
    (['e', 'x', 'f_t', 'motion_acc', 'dist', 'speed', 'heat'], 3)
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(DURATION / DT)) * DT

    def smooth() -> np.ndarray:
        omega = rng.uniform(0.3, 7.0, (12, 1, N_RUNS)) * 2 * np.pi / 6
        phase = rng.uniform(-np.pi, np.pi, omega.shape)
        waves = np.sin(omega * (t[:, None] - SILENT) + phase) / np.sqrt(6 * (1 + omega / 6))
        begin = np.clip((t - SILENT) / 1.0, 0.0, 1.0)[:, None]
        return begin**2 * (3 - 2 * begin) * waves.sum(axis=0)

    roles = {"e": "e", "x": "x", "f_t": "f_t", "motion_acc": "motion_acc", "dist": "dist"}
    roles |= dict.fromkeys(["speed", *channels], OTHER)
    values = {name: smooth() for name in roles}
    values["e"] /= values["e"].std()
    values["f_t"] = values["e"] + values["x"]
    known = np.ones((t.size, N_RUNS), dtype=bool)
    known[-round(4.0 / DT) :, -1] = False
    for channel in values.values():
        channel[~known] = 0.0
    y = differentiated(values["e"], DT) * 0.2 + 0.5 * values["e"]
    return Record(
        dt=DT,
        t=t[:, None],
        channels=values,
        roles=roles,
        inputs=("e",),
        known=known,
        y=y,
        controlled_element=(5.0, 1.0),
        prediction=0.9 * y,
    )


def _expect(condition: Any, message: str) -> None:
    if not condition:
        raise AssertionError(message)


def _name(effect: Effect) -> str:
    return type(effect).__name__


def _check_description(effect: Effect) -> None:
    who = _name(effect)
    name = getattr(effect, "name", None)
    _expect(
        isinstance(name, str) and name.isidentifier() and "__" not in name,
        f'{who}.name must be a word without spaces or "__", such as "dead_zone", for tables and '
        f"scripts; got {name!r}.",
    )
    place = getattr(effect, "place", None)
    _expect(place in PLACES, f"{who}.place must be one of {', '.join(PLACES)}; got {place!r}.")
    for attribute in ("physics", "formula"):
        text = getattr(effect, attribute)
        _expect(
            isinstance(text, str) and text.strip(),
            f"{who}.{attribute} is empty: write what the effect is, for summaries.",
        )
    _expect(
        isinstance(effect.parameters, tuple)
        and all(isinstance(p, Parameter) for p in effect.parameters),
        f"{who}.parameters must be a tuple of skhoid.effects.Parameter (mind the comma of a tuple "
        f"of one); got {effect.parameters!r}.",
    )
    names = [p.name for p in effect.parameters]
    _expect(len(set(names)) == len(names), f"{who}.parameters has a name twice: {names}.")
    for p in effect.parameters:
        _expect(
            p.meaning.strip(),
            f"Parameter {p.name!r} of {who} has no meaning: say what it is, for tables.",
        )
        _expect(
            p.low < p.high,
            f"Parameter {p.name!r} of {who} must have low < high; got {p.low} and {p.high}.",
        )
        _expect(
            len(p.starts) > 0 and all(p.low <= s <= p.high for s in p.starts),
            f"Parameter {p.name!r} of {who} needs starts between low = {p.low} and high = "
            f"{p.high}; got {p.starts}.",
        )


def _check_estimator(effect: Effect) -> None:
    who = _name(effect)
    params = effect.get_params()
    for p in effect.parameters:
        _expect(
            p.name in params,
            f"{who}.__init__ must take {p.name} as a keyword argument with the default None.",
        )
    _expect(
        all(k in params and isinstance(v, tuple) and v for k, v in effect.choices.items()),
        f"{who}.choices must give arguments of __init__ tuples of what there is to choose from, "
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
        _expect(
            _same(copied.get_params(), params),
            f"{who} does not survive {how}: {copied.get_params()} in place of {params}. __init__ "
            "must only store its arguments.",
        )
    for p in effect.parameters:
        value = 0.5 * (max(p.low, -1e3) + min(p.high, 1e3))
        changed = clone(effect).set_params(**{p.name: value})
        _expect(
            changed.fixed.get(p.name) == value and p.name not in [f.name for f in changed.free],
            f"{who}.set_params({p.name}={value}) must fix the parameter: keep it in self.{p.name}.",
        )


def _pickled(effect: Effect) -> Effect:
    """Through pickle, which finds classes by name; of one defined in a function, the arguments."""
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
            f"{_name(effect)} cannot be pickled, which parallel searches need: pass it numbers, "
            f"words and arrays, not functions made on the spot ({error})."
        ) from error


def _same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    return one.keys() == other.keys() and all(
        type(one[k]) is type(other[k]) and np.array_equal(one[k], other[k]) for k in one
    )


def _check_starts(effect: Effect, record: Record) -> None:
    who = _name(effect)
    limits, starts = effect.limits(record), effect.starts(record)
    names = {p.name for p in effect.parameters}
    _expect(
        limits.keys() == names,
        f"{who}.limits must have each parameter: {sorted(names)}; got {sorted(limits)}.",
    )
    _expect(len(starts) > 0, f"{who}.starts must return one start at least.")
    for start in starts:
        own = {k: v for k, v in start.items() if not k.startswith("+")}
        _expect(
            own.keys() == names,
            f"{who}.starts must give each parameter: {sorted(names)}; got {sorted(own)}.",
        )
        for key, value in own.items():
            low, high = limits[key]
            _expect(
                np.isfinite(value) and low <= value <= high,
                f"{who}.starts gives {key} = {value:.4g}, which is not within its limits, "
                f"{low:.4g} to {high:.4g}.",
            )
    unknown = effect.neutral.keys() - names
    _expect(not unknown, f"{who}.neutral names {sorted(unknown)}, which are no parameters.")


def _signal_at(place: str, record: Record, delay: float = DELAY) -> Any:
    """What an effect of a place is given."""
    if place == "delay":
        return delay
    if place == "gain":
        return neutral_gains()
    if place == "spring":
        return Spring()
    late = record.delayed(record.input, delay)
    if place in ("path", "command"):
        return Command(OPERATOR["K_e"] * late, OPERATOR["K_edot"] * late, late, delay)
    return record.input.copy() if place == "input" else 0.7 * late


def _parts(signal: Any) -> dict[str, np.ndarray]:
    """The arrays in a signal, by name."""
    if isinstance(signal, (Gains, Command, Spring)):
        return {k: np.asarray(v, dtype=float) for k, v in signal._asdict().items()}
    return {"": np.asarray(signal, dtype=float)}


def _tried(effect: Effect, record: Record) -> Iterator[dict[str, float]]:
    """Values to apply the effect at: the starts, and each finite limit beside the first."""
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
        return effect.apply(_signal_at(effect.place, record), record, **values)
    except Exception as error:
        raise AssertionError(
            f"{_name(effect)}.apply fails at {_text(values)}: {type(error).__name__}: {error}. It "
            "is called as apply(signal, record, <each parameter by name>)."
        ) from error


def _text(values: Mapping[str, float]) -> str:
    return ", ".join(f"{k} = {v:.4g}" for k, v in values.items()) or "no parameters"


def _check_apply(effect: Effect, record: Record) -> None:
    who = _name(effect)
    before_effect = copy.deepcopy(effect.__dict__)
    for values in _tried(effect, record):
        given = _signal_at(effect.place, record)
        kept = copy.deepcopy(given)
        channels = {k: v.copy() for k, v in record.channels.items()}
        with np.errstate(all="ignore"):  # what is not finite is told below
            _applied(effect, record, values)
            out = effect.apply(given, record, **values)
        at = f"{who}.apply at {_text(values)}"
        _check_kind(out, effect.place, record, at)
        _expect(
            _equal(given, kept),
            f"{at} changes the signal that it is given: return a new one, signal + ... and not "
            "signal += ... .",
        )
        _expect(
            all(np.array_equal(channels[k], record.channels[k]) for k in channels),
            f"{at} changes a channel of the record: work on a copy.",
        )
        with np.errstate(all="ignore"):
            again = effect.apply(_signal_at(effect.place, record), record, **values)
        _expect(
            _equal(out, again),
            f"{at} gives another answer the second time: it must not draw random numbers nor "
            "remember calls.",
        )
    _expect(
        effect.__dict__.keys() == before_effect.keys() and _same(effect.__dict__, before_effect),
        f"{who}.apply changes the effect itself: store nothing on self.",
    )


def _check_kind(out: Any, place: str, record: Record, at: str) -> None:
    kinds: dict[str, type] = {"gain": Gains, "path": Command, "command": Command, "spring": Spring}
    kind = kinds.get(place)
    shape = record.known.shape
    if kind is not None:
        _expect(
            isinstance(out, kind),
            f"{at} must return {kind.__name__}, as signal.plus(...), signal.times(...), "
            f"signal.stiffer(...) or signal._replace(...) do; got {type(out).__name__}.",
        )
    for name, values in _parts(out).items():
        which = f"{at}, {name}," if name else at
        needed: tuple[int, ...] | None = shape
        if place == "spring":
            needed = ()
        elif place == "delay" or kind is Gains or name == "delay":
            needed = None  # anything that spreads over samples and runs
        if needed is None:
            try:
                fits = np.broadcast_shapes(values.shape, shape) == shape
            except ValueError:
                fits = False
            _expect(
                fits,
                f"{which} must give a shape that spreads over (n_samples, n_runs) = {shape}; got "
                f"{values.shape}.",
            )
        else:
            _expect(
                values.shape == needed,
                f"{which} must give shape {needed}"
                + (" (n_samples, n_runs)" if needed else ", a number")
                + f"; got {values.shape}.",
            )
        _expect(
            np.isfinite(values).all(),
            f"{which} gives values that are not finite: mind divisions by zero and roots of "
            "negative numbers, or narrow low and high of the parameters.",
        )


def _equal(one: Any, other: Any) -> bool:
    a, b = _parts(one), _parts(other)
    return a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in a)


def _whole(signal: Any, record: Record) -> dict[str, np.ndarray]:
    """Arrays of a signal; of a command its sum, since effects may put its rate into position."""
    parts = _parts(signal)
    if isinstance(signal, Command):
        total = parts["position"] + differentiated(parts["rate"], record.dt)
        return {"command": total, "delay": parts["delay"]}
    return parts


def _check_neutral(effect: Effect, record: Record) -> None:
    if not effect.neutral:
        return
    for start in effect.starts(record):
        values = {k: v for k, v in start.items() if not k.startswith("+")}
        values |= {**effect.fixed, **effect.neutral}
        given = _signal_at(effect.place, record)
        out = _whole(_applied(effect, record, values), record)
        for name, expected in _whole(given, record).items():
            _expect(
                np.allclose(out[name], expected, rtol=1e-9, atol=1e-9),
                f"{_name(effect)}.apply at its neutral values ({_text(effect.neutral)}) must "
                "return what it is given; they are those at which it does nothing.",
            )


def _check_symmetries(effect: Effect, record: Record) -> None:
    """Runs in another order, and a later start, give the same."""
    who = _name(effect)
    order = np.array([2, 0, 1])
    values = {k: v for k, v in effect.starts(record)[0].items() if not k.startswith("+")}
    values |= effect.fixed
    out = _parts(_applied(effect, record, values))
    permuted = _parts(_applied(effect, replace(record.part(order, 1)), values))
    n = record.known.shape[0]
    shift = round(1.0 / record.dt)
    later = _parts(_applied(effect, _later(record, shift), values))
    for name, expected in out.items():
        if expected.shape == record.known.shape:
            _expect(
                np.allclose(permuted[name], expected[:, order], rtol=1e-9, atol=1e-9),
                f"{who}.apply does not treat runs alike: with the runs (columns) in another order "
                "the answer must have the same columns in that order. Work along axis 0 only.",
            )
        if expected.ndim == 2 and expected.shape[0] == n and effect.smooth:
            _expect(
                np.allclose(later[name][shift:], expected, rtol=1e-6, atol=1e-6),
                f"{who}.apply depends on when the recording began: with a second of silence before "
                "it, the answer must be the same later. Take time from record.t, not from the "
                "number of the sample.",
            )


def _later(record: Record, shift: int) -> Record:
    """The record with some samples of silence before it, at times before."""

    def padded(values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros_like(values[:shift]), values])

    before = record.t[0] - record.dt * np.arange(shift, 0, -1)[:, None]
    return replace(
        record,
        t=np.concatenate([before, record.t]),
        channels={k: padded(v) for k, v in record.channels.items()},
        known=padded(record.known),
        y=None if record.y is None else padded(record.y),
        prediction=None,
        _derived={},
    )


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


def _check_simulation(effect: Effect, record: Record, core: CoreKind) -> None:
    who = _name(effect)
    alone, beside = Effects.of(effect), Bias(level=0.1) + effect + Bias(level=0.2)
    _expect(
        beside.names == ["bias", effect.name, "bias-2"] or effect.name == "bias",
        f"{who} + Bias() must give a composition; got {beside.names}.",
    )
    twice = effect + clone(effect)
    _expect(
        twice.names == [effect.name, f"{effect.name}-2"],
        f"{who} twice must be called {effect.name} and {effect.name}-2; got {twice.names}.",
    )
    start = {k: v for k, v in effect.starts(record)[0].items() if not k.startswith("+")}
    values = {f"{n}__{k}": v for n in beside.names + twice.names for k, v in start.items()}
    for together in (alone, beside, twice):
        out = _simulated(together, values, record, core)
        _expect(
            np.isfinite(out).all(),
            f"A simulation with {' + '.join(together.names)} is not finite at {_text(start)}: "
            "check the sign and the size of starts.",
        )


def _check_recovery(effect: Effect, record: Record, core: CoreKind, truth: dict) -> None:
    """Simulate, estimate, compare."""
    from .arx.batch import ARXRegressor
    from .greybox.operator_regressor import OperatorRegressor

    who = _name(effect)
    names = {p.name for p in effect.free}
    _expect(
        truth.keys() == names,
        f"recovers must give a value of each parameter that is estimated: {sorted(names)}; got "
        f"{sorted(truth)}.",
    )
    quiet = _simulated(
        Effects.of(effect), {f"{effect.name}__{k}": v for k, v in truth.items()}, record, core
    )
    noise = np.random.default_rng(1).standard_normal(quiet.shape)
    output = quiet + NOISE * quiet.std() * noise
    X, y = _table(record, output)
    assert record.controlled_element is not None
    element = ControlledElement(*record.controlled_element)
    if core == CoreKind.ARX:
        model: Any = ARXRegressor(2, 2, 10, effects=effect, controlled_element=element)
    else:
        free = effect.refusal(record, CoreKind.OPERATOR_FREE_DELAY) is None
        delay = None if free else DELAY
        model = OperatorRegressor(delay, effects=effect, controlled_element=element)
    fitted = model.fit(X, y)
    for key, value in truth.items():
        row = fitted.parameters_.loc[f"{effect.name}__{key}"]
        off = abs(row["value"] - value)
        _expect(
            off <= max(SURE * np.nan_to_num(row["sd"]), CLOSE * abs(value), 1e-3),
            f"{who}: {key} was simulated as {value:.4g} and estimated as {Estimate.of(row)}. "
            "Give more starts, closer to what is usual; set smooth = False if "
            "small changes of the parameters do not change the output smoothly; or the parameters "
            "cannot be told apart.",
        )


def _table(record: Record, output: np.ndarray) -> tuple[pd.DataFrame, pd.Series]:
    """Rows of the known samples of each run."""
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
