"""Simulation of a core with effects in stages; only stages after a change run again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter

from ..arx.base import ESTIMATE, REST, first_measured
from ..effects.base import Effect
from ..effects.composition import PLACES, Effects
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.parameter import CoreKind, Parameter, ScaledParameter
from ..effects.record import Record
from .cores import ARXCore, Core, Prior, Usual, neutral_gains
from .effort import spend
from .initial import LASTING, find_horizon, fit_pulses, fit_start, make_free_responses


class StageSignals(NamedTuple):
    """The signals known after a stage."""

    error: np.ndarray
    delay: Any
    gains: Gains
    command: Any
    spring: Spring
    output: Any
    answer: Any = None


@dataclass(frozen=True)
class Stage:
    """One step of the simulation, and the positions of its parameters."""

    run: Callable[[StageSignals, Any], StageSignals]
    positions: tuple[int, ...]


def list_parameters(
    core: Core, effects: Iterable[tuple[str, Effect]], record: Record
) -> list[ScaledParameter]:
    """What a core and effects leave to be estimated, in the units of a record."""
    composed, on_arx = Effects(list(effects)), record.core == CoreKind.ARX
    found = [p.on(record) for p in core.parameters]
    for name, effect in composed:
        found += list_own(name, effect, effect.free, record, composed.before(name, on_arx))
    return found


def list_own(
    name: str,
    effect: Effect,
    parameters: Iterable[Parameter],
    record: Record,
    behind: tuple[str, ...],
) -> list[ScaledParameter]:
    """Some parameters of an effect in the units of a record, and of the signal behind others."""
    limits, found = effect.limits(record), []
    for p in parameters:
        one = p.on(record, effect.place, f"{name}__{p.name}", limits[p.name])
        of_signal = one.dimension.e or (one.dimension.u and effect.place in ("command", "output"))
        if behind and of_signal:
            meaning = f"{p.meaning} (of the signal behind {' and '.join(behind)})"
            one = replace(one, behind=behind, meaning=meaning)
        found.append(one)
    return found


class Simulator:
    """Free runs of a core with effects on a record.

    ``effects`` have all their choices made (see ``Effect.variants``). ``parameters`` lists what is
    estimated, in the order of the vector theta that ``run`` takes. Runs of a large record are
    simulated a few at a time, see :meth:`parts`, and only their output is kept.
    """

    exact = True  # whether differences of ``run_with_change`` are those of ``run``

    def __init__(self, core: Core, effects: Effects, record: Record):
        self.core, self.effects, self.record = core, effects, record
        self.parameters = list_parameters(core, list(effects), record)
        self.names = [p.name for p in self.parameters]
        self.low = np.array([p.min for p in self.parameters])
        self.high = np.array([p.max for p in self.parameters])
        self.scale = np.array([p.scale for p in self.parameters])
        self.smooth = all(effect.smooth for _, effect in effects)
        self.prior = self._prior()
        self._stages = self._build()
        self._begins = [
            min((i for i, s in enumerate(self._stages) if j in s.positions), default=0)
            for j in range(len(self.parameters))
        ]
        self._theta: np.ndarray | None = None
        self._states: list[StageSignals] = []
        self._whole: np.ndarray | None = None

    def _prior(self) -> Prior:
        """What effects know of their parameters before any data."""
        known: list[tuple[int, Usual]] = []
        for name, effect in self.effects:
            own = {p.name: self.names.index(f"{name}__{p.name}") for p in effect.free}
            spreads = effect.spreads({n: float(self.scale[i]) for n, i in own.items()})
            known += [(own[n], Usual(0.0, spread)) for n, spread in spreads.items()]
        return Prior(tuple(known))

    @cached_property
    def _parts(self) -> list[tuple[slice, Any]]:
        if not all(effect.runs_apart for _, effect in self.effects):
            return []
        few_at_a_time = self.record.few_runs()
        return [(columns, self.beside(self.record.columns(columns))) for columns in few_at_a_time]

    def beside(self, record: Record) -> Any:
        """The same simulator, with the same bounds, on a few of the runs or with other signals."""
        part = Simulator.__new__(Simulator)  # copy.copy would work out all bounds anew
        part.__dict__.update(self.__dict__)
        part.__dict__.pop("_parts", None)
        part.record, part._theta, part._states, part._whole = record, None, [], None
        part._stages = part._build()
        return part

    def parts(self) -> Iterator[tuple[slice, Any]]:
        """Simulators of a few runs each, with their columns; for a small record, this one."""
        if not self._parts:
            yield slice(None), self
        for columns, part in self._parts:
            yield columns, part
            part._theta, part._states = None, []
            part.record.forget()

    def __reduce__(self) -> tuple:
        return Simulator, (self.core, self.effects, self.record)

    def with_soft_corners(self, amount: float, only: str | None = None) -> Any:
        """With soft corners of effects that jump, or of one, that have them; else this itself."""
        softened = {
            name: effect.softened(amount)
            for name, effect in self.effects
            if not effect.smooth and only in (None, name)
        }
        if not any(softened.values()):
            return self
        steps = [(name, softened.get(name) or effect) for name, effect in self.effects]
        return Simulator(self.core, Effects(steps), self.record)

    def on_record(self, record: Record) -> Any:
        """The same core and effects on another record."""
        return Simulator(self.core, self.effects, record)

    def _build(self) -> list[Stage]:
        core, record = self.core, self.record
        core_names = [p.name for p in core.parameters]
        gain = tuple(i for i, n in enumerate(core_names) if n in core.gains)
        delay = tuple(i for i, n in enumerate(core_names) if n in core.delays)
        dynamic = tuple(i for i in range(len(core_names)) if i not in gain + delay)

        def values(theta: dict[int, float], positions: tuple[int, ...]) -> dict[str, float]:
            return {core_names[i]: theta[i] for i in positions}

        def start_delay(s: StageSignals, theta: Any) -> StageSignals:
            return s._replace(delay=core.delay(values(theta, delay)))

        def delayed(s: StageSignals, theta: Any) -> StageSignals:
            late = s.delay
            least = core.least_delay(record.dt)
            if np.ndim(late) or late != 0.0 or least > 0.0:
                late = np.maximum(late, least)
                return s._replace(error=record.delayed(s.error, late), delay=late)
            return s

        def command(s: StageSignals, theta: Any) -> StageSignals:
            gains = delay_gains(s.gains, s.delay, record)
            given = values(theta, gain)
            seen = core.find_seen(record, s.delay)
            position, rate = core.command(s.error, gains, given, record.dt, seen)
            return s._replace(command=Command(position, rate, s.error, s.delay))

        def respond(s: StageSignals, theta: Any) -> StageSignals:
            given = values(theta, dynamic)
            output = core.response(s.command, s.gains, s.spring, given, record.dt)
            return s._replace(output=output, answer=output)

        stages = [*self._stages_at("input", "error"), Stage(start_delay, delay)]
        stages += [*self._stages_at("delay", "delay"), Stage(delayed, ())]
        stages += [*self._stages_at("gain", "gains"), Stage(command, gain)]
        stages += self._stages_at("path", "command")
        stages += self._stages_at("command", "command")
        stages += self._stages_at("spring", "spring")
        stages += self._stages_at("inside", "spring")
        behind = [*self._stages_at("sum", "output"), *self._stages_at("output", "output")]
        stages += [Stage(respond, dynamic), *behind]
        apart = record.initial in (REST, LASTING)
        if apart and not (self.lasts and (self.estimates_start or record.begun)):
            return stages
        additive = all(effect.place != "output" for _, effect in self.effects)

        def passed_on(s: StageSignals, theta: Any, signal: np.ndarray) -> np.ndarray:
            state = s._replace(output=signal)
            for stage in behind:
                state = stage.run(state, theta)
            return state.output

        def begun_inside(
            core: ARXCore, s: StageSignals, theta: Any, reach: int, states: int
        ) -> np.ndarray:
            given = values(theta, dynamic)
            held = core.held_pulses(s.command, given, record.dt, reach, record.levels)

            def begun(pulses: np.ndarray) -> np.ndarray:
                answer = core.response(s.command, s.gains, s.spring, given, record.dt, pulses)
                return passed_on(s, theta, answer)

            return fit_pulses(record, begun, held, states) if self.estimates_start else begun(held)

        def start(s: StageSignals, theta: Any) -> StageSignals:
            given = values(theta, dynamic)
            forgets = self._forgetting(theta)
            denominator = np.ones(1) if apart else core.denominator(given, record.dt)
            n = find_horizon(denominator, len(s.answer))
            reach = min(n + core.memory, len(s.answer))
            if isinstance(core, ARXCore) and s.spring.terms:
                return s._replace(output=begun_inside(core, s, theta, reach, denominator.size - 1))
            answer = s.answer.copy()
            if not apart:
                held = core.held_pulses(s.command, given, record.dt, reach, record.levels)
                answer[:reach] += lfilter([1.0], denominator, held, axis=0)

            def last(signal: np.ndarray) -> np.ndarray:
                return passed_on(s, theta, signal)

            if self.estimates_start:
                denominator = np.convolve(denominator, forgets)
                free = make_free_responses(denominator, find_horizon(denominator, len(answer)))
                return s._replace(output=fit_start(record, answer, free, last, additive))
            if record.begun:
                pulse = np.r_[record.begun, np.zeros(len(answer) - 1)]
                answer += lfilter([1.0], forgets, pulse)[:, None]
            return s._replace(output=last(answer))

        return [*stages, Stage(start, dynamic)]

    @property
    def lasts(self) -> bool:
        """Whether something in it remembers for long how a run began."""
        return len(self.core.forgetting) > 1 or any(effect.lasts for _, effect in self.effects)

    @property
    def estimates_start(self) -> bool:
        """Whether runs begin as fits the measured output best."""
        initial = self.record.initial
        estimated = initial == ESTIMATE or (initial == LASTING and self.lasts)
        return estimated and self.record.y is not None

    def _forgetting(self, theta: Any) -> np.ndarray:
        """How all that lasts forgets what preceded a run, as one difference equation."""
        found = np.array(self.core.forgetting)
        for name, effect in self.effects:
            if effect.lasts:
                at = {p.name: self.names.index(f"{name}__{p.name}") for p in effect.free}
                values = {**effect.fixed, **{n: float(theta[i]) for n, i in at.items()}}
                found = np.convolve(found, effect.forgetting(self.record.dt, **values))
        return found

    def _stages_at(self, place: str, signal: str) -> list[Stage]:
        assert place in PLACES
        position = {p.name: i for i, p in enumerate(self.parameters)}
        made = []
        for name, effect in self.effects:
            if effect.place != place:
                continue
            free = {p.name: position[f"{name}__{p.name}"] for p in effect.free}
            made.append(_make_effect_stage(effect, self.record, free, signal))
        return made

    def _start(self) -> StageSignals:
        return StageSignals(self.record.input, 0.0, neutral_gains(), None, Spring(), None)

    def run(self, theta: np.ndarray) -> np.ndarray:
        """Output for parameters, of shape (n_samples, n_runs); its stages are kept."""
        if self._theta is not None and np.array_equal(theta, self._theta):
            return self._states[-1].output if self._whole is None else self._whole
        if self._parts:
            self._theta, self._whole = theta.copy(), self._of_parts(theta)
            return self._whole
        spend(self.record.known.size)
        begin = 0
        if self._theta is not None:
            changed = np.flatnonzero(theta != self._theta)
            begin = min(self._begins[j] for j in changed)
        self._states = self._states[: begin + 1] or [self._start()]
        for stage in self._stages[begin:]:
            self._states.append(stage.run(self._states[-1], theta))
        self._theta = theta.copy()
        return self._states[-1].output

    def _of_parts(self, theta: np.ndarray) -> np.ndarray:
        output = np.empty_like(self.record.known, dtype=float)
        for columns, part in self.parts():
            output[:, columns] = Simulator.run(part, theta)
        return output

    def run_with_change(self, position: int, value: float) -> np.ndarray:
        """Output of the last ``run`` with one parameter changed."""
        assert self._theta is not None
        theta = self._theta.copy()
        theta[position] = value
        if self._parts:
            return self._of_parts(theta)
        spend(self.record.known.size)
        begin = self._begins[position]
        state = self._states[begin]
        for stage in self._stages[begin:]:
            state = stage.run(state, theta)
        return state.output

    def run_ahead(self, theta: np.ndarray) -> np.ndarray:
        """Output whose runs begin as their first seconds show, not as fits all rows best."""
        if not self.estimates_start:
            return self.run(theta)
        early = first_measured(self.record.known, self.record.dt)
        return np.asarray(self.beside(replace(self.record, known=early, remembered={})).run(theta))

    @property
    def last_state(self) -> StageSignals:
        """Signals of the last run."""
        if not self._parts:
            return self._states[-1]
        state = self._start()
        for stage in self._stages:
            state = stage.run(state, self._theta)
        return state

    def size(self, position: int, value: float) -> float:
        """How large a change of a parameter would change the output by its own size."""
        own = self.core.sizes.get(self.names[position])
        return max(abs(value), 0.05 * self.scale[position]) if own is None else own


def delay_gains(gains: Gains, delay: Any, record: Record) -> Gains:
    """The gains at the time of the error that is responded to now, so delayed as the error is."""
    error, rate = gains.error, gains.rate
    if len(error) > 1:
        error = record.delayed(error, delay)
    if rate is gains.error:
        rate = error
    elif len(rate) > 1:
        rate = record.delayed(rate, delay)
    return gains._replace(error=error, rate=rate)


def _make_effect_stage(effect: Effect, record: Record, free: dict[str, int], signal: str) -> Stage:
    fixed = effect.fixed

    def run(state: StageSignals, theta: Any) -> StageSignals:
        values = {**fixed, **{name: float(theta[i]) for name, i in free.items()}}
        return state._replace(**{signal: effect.apply(getattr(state, signal), record, **values)})

    return Stage(run, tuple(free.values()))
