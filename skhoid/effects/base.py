"""The base class of all effects: what an effect of your own must and may define."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from sklearn.base import BaseEstimator, clone

from ..exceptions import did_you_mean
from ..parameters import Kind, ParameterTable
from .composition import Composable
from .entry import Argument, complete
from .error_scan import ErrorScan
from .parameter import CoreKind, Dimension, Parameter
from .record import Record, Signature


class Effect(Composable, BaseEstimator):
    """Base class of all effects; subclass it for an effect of your own.

    A subclass is an entry and a function: the entry lists ``parameters``, ``choices`` and words,
    and ``apply`` does what it says. ``__init__``, which takes each parameter and choice by keyword
    with default None, and the docstring follow from the entry.

    Attributes
    ----------
    name, title : str
        Fixed id, used in tables, JSON and scripts; and the name for people ("": the id without its
        underscores).
    place : str
        Where it acts: ``"input"`` maps the error, ``"delay"`` the delay, ``"gain"`` the gains on
        error and error rate, ``"path"`` adds to the command, ``"command"`` maps the command before
        the neuromuscular system, ``"spring"`` stiffens it, ``"sum"`` adds to the output and
        ``"output"`` maps it. ``"inside"`` is a force of the output and its rate against the
        input of an ARX model, or a stop, in the recursion.
    physics, machine_physics : str
        One sentence, of a person and of a machine ("" where the wording is the same).
    formula, tex : str
        The same as a formula, and in LaTeX with the names of parameters as they are.
    source, citation : str
        Where it comes from, and the same in full, for the docstring ("" where ``source`` says all).
    parameters : tuple of Parameter
        Its numbers: of a class those of all forms, of an object those of its own.
    choices, unless_given : dict
        Arguments that are choices, such as ``form``, with their options; one that is None is open,
        and all are tried. Where nothing is tried it means the first, or what ``unless_given`` says.
    arguments : dict of str to Argument
        Further arguments of ``__init__``, and those whose default or description is not the usual.
    options : dict of str to tuple
        What such arguments may be, besides None, where that is not free.
    smooth, kinks : bool
        Whether the response changes smoothly with the parameters (otherwise they are searched on a
        grid of their starts), and whether it has kinks that move with them, so that a fit may end
        in any of several neighbouring minima.
    shades : bool
        Whether the choices of ``form`` are variants of the first: a search tries the others only
        where the first explains something.
    runs_apart : bool
        Whether its result for a run depends on that run alone: the runs of a large record are then
        simulated a few at a time.
    keeps_unit : bool
        Whether a signal that holds still comes out as it went in, as through a delay, a hold, a lag
        or a rate limit. Numbers of effects behind any other are told as "behind" it.
    lasts : bool
        Whether what preceded a run lasts in it, such as an integral. It begins anywhere in each
        run, and a search compares it with a model that does so too; see ``forgetting``.
    n_hidden : int
        How many numbers it finds in the data besides its parameters, such as the ends of intervals.
        The BIC counts them as parameters.
    noise : str
        What it adds to the output, such as "a sine", where that is noise to a free run, since no
        input explains it. A search recognises it by its ``signature``; its ``realisation`` is for
        plots.
    domains : tuple of str
        What it applies to and is tried on: ``"human"`` operators, ``"machine"``, or both.
    neutral, unseen_at : dict of str to float
        Values of parameters at which it does nothing; and those, which are bounds, at which nothing
        shows of what its name says (``inf``: the highest), so that a search does not name it there.
    free_form : bool
        Whether its shape is estimated: see :class:`FreeForm`.
    within : tuple of str
        Ids of effects of which it is a special case, or nearly one: a search names these only where
        what they have beyond it counts as well.
    told_apart : dict of str to str
        What to record to tell it from other effects, by their ids.
    examples, hidden : tuple of dict, dict
        Arguments, one of each form, with numbers for a person in condition C1, who sees errors of
        up to 2 deg and has a stick of 0.3 deg; and those of an effect that matters there, which
        ``skhoid demo`` hides (empty where a simulated loop cannot have it).

    See Also
    --------
    Parameter : One number of an effect.
    CoreKind : The kinds of core that ``refusal`` is asked about.
    skhoid.testing.check_effect : Checks of an effect of your own.

    Examples
    --------
    A response that grows ever more slowly with the error:

    >>> import numpy as np
    >>> from skhoid.effects import Dimension, Effect, Parameter
    >>> class Compressed(Effect):
    ...     name = "compressed"
    ...     place = "input"
    ...     physics = "The response to large errors is less than proportional."
    ...     formula = "e' = knee asinh(e / knee)"
    ...     parameters = (
    ...         Parameter(
    ...             "knee", Dimension(e=1), 0.01, 10.0, (1.0,), meaning="knee of the response"
    ...         ),
    ...     )
    ...
    ...     def apply(self, signal, record, knee):
    ...         return knee * np.arcsinh(signal / knee)
    >>> Compressed(knee=2.0)
    Compressed(knee=2.0)
    """

    name: ClassVar[str]
    title: ClassVar[str] = ""
    place: ClassVar[str]
    physics: ClassVar[str] = ""
    formula: ClassVar[str] = ""
    tex: ClassVar[str] = ""
    source: ClassVar[str] = ""
    citation: ClassVar[str] = ""
    domains: ClassVar[tuple[str, ...]] = ("human", "machine")
    machine_physics: ClassVar[str] = ""
    parameters: tuple[Parameter, ...] = ()
    choices: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    unless_given: ClassVar[Mapping[str, str]] = {}
    arguments: ClassVar[Mapping[str, Argument]] = {}
    options: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    smooth: bool = True
    kinks: ClassVar[bool] = False
    shades: ClassVar[bool] = False
    runs_apart: ClassVar[bool] = True
    keeps_unit: ClassVar[bool] = False
    lasts: ClassVar[bool] = False
    n_hidden: int = 0
    noise: ClassVar[str] = ""
    neutral: Mapping[str, float] = {}
    unseen_at: Mapping[str, float] = {}
    free_form: ClassVar[bool] = False
    within: ClassVar[tuple[str, ...]] = ()
    told_apart: ClassVar[Mapping[str, str]] = {}
    examples: ClassVar[tuple[Mapping[str, Any], ...]] = ()
    hidden: ClassVar[Mapping[str, Any]] = {}

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        complete(cls)

    if TYPE_CHECKING:  # arguments, which __init__ makes of the entry

        def __init__(self, **given: Any) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

    else:

        def __init__(self) -> None:
            """Take no arguments; those of a subclass are made of its entry."""

        __init__.of_entry = True

    @classmethod
    def chosen_by_default(cls, argument: str) -> str:
        """What a choice that is None means where nothing is tried."""
        return cls.unless_given.get(argument, cls.choices[argument][0])

    def chosen(self, argument: str) -> str:
        """The option of a choice, or what None means."""
        given: str | None = getattr(self, argument, None)
        return self.chosen_by_default(argument) if given is None else given

    def resolved(self, parameter: Parameter) -> Parameter:
        """A parameter of the entry in the units of the channel that is chosen."""
        channel = getattr(self, "channel", None)
        if channel is None or not parameter.dimension.channels:
            return parameter
        return replace(parameter, dimension=parameter.dimension.with_channel(channel))

    def check_choices(self) -> None:
        """Raise a ValueError where an argument is none of its options, or not a number."""
        for argument, options in {**self.choices, **self.options}.items():
            given = getattr(self, argument, None)
            if given is not None and given not in options:
                raise ValueError(
                    f"{type(self).__name__}: {argument} must be {_or(options)} or None; got "
                    f"{given!r}.{did_you_mean(str(given), [str(option) for option in options])}"
                )
        told = {name for name, one in self.arguments.items() if one.kind.startswith("float")}
        for argument in sorted(told | {p.name for p in self.parameters}):
            given = getattr(self, argument, None)
            if given is not None and not (isinstance(given, Real) and given == given):
                raise ValueError(
                    f"{type(self).__name__}: {argument} must be a number, or None where it is to "
                    f"be estimated; got {given!r}."
                )

    def apply(self, signal: Any, record: Record, *args: Any, **values: Any) -> Any:
        """Output of the effect for the input ``signal``, at values of the parameters."""
        raise NotImplementedError(f"{type(self).__name__} must implement apply.")

    def forgetting(self, dt: float, **values: float) -> np.ndarray:
        """How an effect that ``lasts`` forgets what preceded a run: by default never.

        The coefficients [1, a_1, ...] of the difference equation of its free response.
        """
        return np.array([1.0, -1.0])

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        """Why the effect does not apply to a record and a kind of core, or None."""
        return None

    def refusal_in(self, record: Record, core: CoreKind) -> str | None:
        """Why a search in the domain of the record does not try the effect, or None."""
        if record.domain not in self.domains:
            return f"for {self.domains[0]}s: domain={self.domains[0]!r}"
        return self.refusal(record, core)

    def physics_in(self, domain: str) -> str:
        """``physics`` worded for a domain, ``"human"`` or ``"machine"``."""
        return (domain == "machine" and self.machine_physics) or self.physics

    def variants(self, record: Record) -> list[Effect]:
        """The effect with its open choices made: one object for each combination.

        The choices are those of ``choices``; a subclass adds others that depend on the record.
        """
        made: list[Effect] = [self]
        for argument, options in self.choices.items():
            made = [variant for one in made for variant in one.copy_for_each(argument, options)]
        return made

    def alternatives(self, record: Record) -> list[Effect]:
        """Variants that a search tries, keeping the likeliest; by default the effect alone."""
        return [self]

    def starts(self, record: Record) -> list[dict[str, float]]:
        """Starting values of the parameters, in the units of the data."""
        found: list[dict[str, float]] = [{}]
        for p in self.parameters:
            scale = p.find_scale(record, self.place)
            found = [{**f, p.name: s * scale} for f in found for s in p.starts]
        return found

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Starts found by the effect's own search; none by default.

        ``error_of(values, seconds)`` is what the best multiple of the simulated output leaves of
        the first seconds of the runs; see :class:`ErrorScan` for what else it offers.
        """
        return []

    def scanned_beside(
        self, error_of: ErrorScan, values: dict[str, float]
    ) -> list[dict[str, float]]:
        """Starts near the values found, where the response is not smooth; none by default."""
        return []

    def within_cube(
        self, values: dict[str, float], at: np.ndarray, record: Record
    ) -> dict[str, float]:
        """Parameters at a point of the unit cube, which holds all that may be true.

        ``values`` are those of a local minimum, ``at`` has a number from 0 to 1 for each free
        parameter. Only for effects that are not smooth: choose coordinates along which the response
        changes slowly. By default up to four times as small or large, in logarithms.
        """
        free = [p.name for p in self.free]
        return {n: values[n] * 4.0 ** (2 * x - 1) for n, x in zip(free, at, strict=True)}

    def adjusted(self, error_of: Callable[[Effect], float], record: Record) -> Effect:
        """The effect with its choices adjusted after a first fit; by default the effect itself.

        ``error_of(effect)`` is what the model leaves with another effect of this kind in its place.
        """
        return self

    def softened(self, amount: float) -> Effect | None:
        """A smooth effect that becomes this one as ``amount`` goes from 0.2 to zero, or None.

        A search follows these where the effect itself is not smooth.
        """
        return None

    def signature(self, residual: np.ndarray, record: Record) -> Signature | None:
        """What a model's residual (n_samples, n_runs) shows of ``noise``; None if nothing."""
        return None

    def noise_part(self, residual: np.ndarray, record: Record) -> np.ndarray | None:
        """Its ``noise`` in the record's output; None if a residual (n_samples, n_runs) shows none.

        An operator's output is searched without it, since effects would be fitted to it.
        """
        return None

    def realisation(
        self, values: dict[str, float], t: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Times in seconds, by default a stretch that shows it well, and the ``noise`` at them."""
        raise NotImplementedError(f"{type(self).__name__} is noise and must implement realisation.")

    def limits(self, record: Record) -> dict[str, tuple[float, float]]:
        """Bounds of the parameters in the units of the data."""
        bounds = {}
        for p in self.parameters:
            scale = p.find_scale(record, self.place)
            bounds[p.name] = (p.low * scale, p.high * scale)
        return bounds

    def table(
        self, record: Record, units: Mapping[str, str | None] | None = None
    ) -> ParameterTable:
        """Parameters in the units of the data: bounds, and given values or the first start.

        ``units`` are those of the output, ``"u"``, the input, ``"e"``, and channels.
        """
        limits, start = self.limits(record), self.starts(record)[0]
        rows = []
        for p in self.parameters:
            one = p.on(record, self.place, bounds=limits[p.name])
            given = getattr(self, p.name)
            kind = Kind.ESTIMATED if given is None else Kind.GIVEN
            value = start[p.name] if given is None else float(given)
            unit = one.dimension.label(units)
            rows.append(replace(one, value=value, start=value, kind=kind, unit=unit))
        return ParameterTable(rows)

    def spreads(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Standard deviations about zero of parameters that are known to be small; none by default.

        ``scales`` has the scale of each parameter, in the units of the data.
        """
        return {}

    def with_values(self, values: Mapping[str, float]) -> Any:
        """A copy with its estimated parameters set."""
        return self.with_choices(**values)

    def derived(self, values: dict[str, float]) -> dict[str, tuple[float, Dimension, str]]:
        """Further results of a fitted effect: value, dimension and meaning by name.

        ``values`` holds the parameters of the core and, by their plain names, those of the effect.
        """
        return {}

    @property
    def free(self) -> list[Parameter]:
        """Parameters that are estimated."""
        return [p for p in self.parameters if getattr(self, p.name) is None]

    @property
    def fixed(self) -> dict[str, float]:
        """Parameters that are fixed."""
        return {
            p.name: float(getattr(self, p.name))
            for p in self.parameters
            if getattr(self, p.name) is not None
        }

    def with_choices(self, **choices: Any) -> Any:
        """A copy with some arguments set."""
        return clone(self).set_params(**choices)

    def copy_for_each(self, argument: str, options: tuple[str, ...]) -> list[Any]:
        """A copy for each option of an argument, or for the one that is given."""
        given = getattr(self, argument)
        chosen = options if given is None else (given,)
        return [self.with_choices(**{argument: option}) for option in chosen]


def _or(options: tuple[Any, ...]) -> str:
    return ", ".join(repr(option) for option in options)
