"""Free forms: maps, hysteresis, gains, delays, offsets and responses of any smooth shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.signal import fftconvolve

from .. import _kernels
from ..runs.roles import OTHER
from .base import Effect
from .derived import DERIVED, dimension_of, words_of
from .entry import Argument
from .error_scan import ErrorScan
from .free_form import FEWEST, LEVEL, N_KNOTS, SLOPE, FreeForm, quantile_knots
from .machines import cores_by_signs
from .maps import PLACE_OF
from .operator_signals import N_PLACES, Command, Gains
from .parameter import ONE, CoreKind, Dimension, E, Parameter, S, U
from .record import Record, differentiated, needs_channel

__all__ = [  # in the order of the catalogue
    "FreeMap",
    "FreeHysteresis",
    "FreeGain",
    "FreeDelay",
    "FreeOffset",
    "FreePath",
    "FreeDynamics",
]

OVER = {
    "error": "e",
    "error rate": "de/dt",
    "command": "command",
    "output": "u",
    "spring": "u",
    "rate": "du/dt",
}
PLACES = {"error rate": "path", "spring": "spring", "rate": "spring"}  # where others act follows
NEAR_REST = (-0.2, -0.05, 0.0, 0.05, 0.2)  # knots of a force of the rate, in rms of the rate
ONE_SIDED = 0.05  # of the range, by which a size may fall below zero
SIGNLESS = ("error", "error rate")  # where people mostly answer either sign alike
OPPOSING = ("spring", "rate")  # places of forces against the command
# What a machine answers is its input, and it has no command of its own.
SIGNALS = {
    "human": {"error": "error", "command": "command"},
    "machine": {"error": "input", "command": "input"},
}
WORDS = {
    "error": "it acts on the {error}, as a function of its size and sign",
    "error rate": "it acts on the response to the rate of the {error}, as a function of that rate",
    "command": "it acts on the {command} before the limb, as a function of its size and sign",
    "output": "it acts on the output, as a function of its size and sign",
    "spring": "it is a force against the {command}, as a function of the output",
    "rate": "it is a force against the {command}, as a function of the output's rate",
}


class FreeMap(FreeForm):
    """A map of a signal, sample by sample, that may have any smooth shape.

    signal' = signal + curve(signal), where the curve has no linear part, which is the gain. At the
    places ``"spring"`` and ``"rate"`` the curve is a force of the output u, or of its rate, against
    the command: spring and friction of any shape. Their linear parts are stiffness and damping. An
    ARX model has it in its recursion, A(q) u = B(q) (x - curve(u)).
    """

    name = "free_map"
    physics = "A signal is mapped by a curve of unknown shape."
    formula = "signal + curve(signal)"
    tex = r"s' = s + \mathrm{curve}(s)"
    source = "Eilers and Marx (1996)"

    examples = ({"at": "output"},)
    options = {"at": tuple(OVER)}
    arguments = FreeForm.arguments | {
        "at": Argument(
            'What is mapped, or with "spring" and "rate" what a force is a function of; None means '
            "the error, and a search for shapes tries all."
        ),
        "odd": Argument(
            "Whether the curve is the same for either sign, curve(-s) = -curve(s); a search tries "
            "both of the error and of its rate.",
            "bool",
            False,
        ),
        "folded": Argument(
            "Whether the curve has a linear part too, over outputs of either sign, as an output "
            "needs whose sign a sensor may not show; None tries it where a model without the map "
            "shows less than half of the output. It is zero at the greatest output, which gives "
            "the signal its size.",
            "bool or None",
        ),
    }
    citation = (
        "Eilers and Marx, Flexible smoothing with B-splines and penalties (1996). Wood, "
        "Generalized additive models (2017)."
    )

    @property
    def where(self) -> str:
        """What is mapped."""
        return self.at or "error"

    @property
    def kept(self) -> tuple[int, ...]:  # type: ignore[override]
        if self.folded:
            return (SLOPE,)
        return () if self.odd or self.where in OPPOSING else (LEVEL,)

    @property
    def ends(self) -> tuple[float, float]:
        low, high = super().ends
        return (-high if self.odd else low), high

    @property
    def place(self) -> str:  # type: ignore[override]
        if self.at not in (None, *OVER):
            self.check_choices()
        return PLACES.get(self.where) or PLACE_OF[self.where]

    @property
    def over(self) -> str:
        return OVER[self.where]

    @property
    def abscissa(self) -> Dimension:
        return {"error": E, "error rate": E / S, "rate": U / S}.get(self.where, U)

    @property
    def ordinate(self) -> Dimension:
        return E if self.where == "error" else U

    @property
    def y_word(self) -> str:  # type: ignore[override]
        if self.folded:
            return "change of the output"
        return "force" if self.where in OPPOSING else "departure from a straight line"

    @property
    def sentence(self) -> str:
        return self.sentence_in("human")

    def sentence_in(self, domain: str) -> str:
        return WORDS[self.where].format(**SIGNALS.get(domain, SIGNALS["human"]))

    def alternatives(self, record: Record) -> list[Any]:
        """One for each place, and odd ones: ARX models have no command, controllers no limb."""
        lacking = {CoreKind.ARX: ("command",), CoreKind.CONTROLLER: OPPOSING}
        places = [at for at in OVER if at not in lacking.get(record.core, ())]
        if self.at is not None:
            return [self]
        odd = [self.with_choices(at=at, odd=True) for at in SIGNLESS]
        return [*(self.with_choices(at=at) for at in places), *odd]

    def watched(self, record: Record) -> np.ndarray:
        if self.where == "error":
            return record.input[record.known]
        if self.where == "error rate":
            return differentiated(record.input, record.dt)[record.known]
        if self.where in OPPOSING:  # of the output itself, which a hopeless model does not show
            return moved(record) if self.where == "rate" else seen(record)[record.known]
        output = record.prediction if record.prediction is not None else record.y
        assert output is not None
        return output[record.known]

    def variants(self, record: Record) -> list[Effect]:
        whole = self.knots is None and self.folded is None and self.where == "output"
        folded = self.with_choices(folded=True) if whole and hidden(record) else self
        return [folded.with_knots(record)]

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Where the output may be folded, what moves it by signs that make its size smooth."""
        if not self.folded or not self.free:
            return []
        (fold,) = self.starts(record)
        return [{**fold, **core} for core in cores_by_signs(error_of, record)]

    def starts(self, record: Record) -> list[dict[str, float]]:
        """A straight line; where the output may be folded, its size without its sign."""
        if not self.folded or not self.free:
            return super().starts(record)
        at = np.asarray(self.knots)
        return [self.coefficients(np.abs(at) - at)]

    def with_knots(self, record: Record) -> Any:
        if self.knots is None and self.folded:
            size = float(np.abs(seen(record)[record.known]).max())
            return self.with_choices(knots=tuple(np.linspace(-size, size, N_KNOTS).tolist()))
        if self.knots is None and self.odd:
            sizes = np.abs(self.watched(record))
            _, *above = quantile_knots(sizes)
            if len(above) < FEWEST - 1:  # a signal of one size, as of a relay
                above = np.linspace(0.0, float(sizes.max()), FEWEST)[1:].tolist()
            return self.with_choices(knots=(0.0, *above))
        if self.knots is not None or self.where not in OPPOSING:
            return super().with_knots(record)
        watched = self.watched(record)
        knots = wide_knots(watched)
        return self.with_choices(knots=with_rest(knots, watched) if self.where == "rate" else knots)

    @property
    def _zero(self) -> float | None:
        """Where the curve is zero: a force at rest, as its level is the model's own.

        A fold where it is greatest: the model's gain and the map's could undo each other.
        """
        if self.knots is None or not (self.folded or self.where in OPPOSING):
            return None
        return self.knots[-1] if self.folded else min(max(0.0, self.knots[0]), self.knots[-1])

    def with_values(self, values: Mapping[str, float]) -> Any:
        found, zero = super().with_values(values), self._zero
        if zero is None:
            return found
        level = float(self.curve(np.asarray(found.values), np.array([zero]))[0])
        return found.with_choices(values=tuple(value - level for value in found.values))

    def design(self, at: np.ndarray) -> np.ndarray:
        found, zero = super().design(at), self._zero
        return found if zero is None else found - super().design(np.array([zero]))

    def shaped(self, signal: Any, record: Record, curve: Callable[..., np.ndarray]) -> Any:
        level = 0.0 if self._zero is None else curve(np.array([self._zero]))
        if self.where in OPPOSING:
            assert self.knots is not None
            low, high = self.knots[0], self.knots[-1]
            force = curve(np.linspace(low, high, N_PLACES)) - level
            return signal.bent(force, low, high, of_rate=self.where == "rate")
        if self.where == "error rate":
            return signal.plus(curve(differentiated(signal.error, record.dt)) - level)
        if self.where != "command":
            return signal + curve(signal) - level
        whole = signal.position + differentiated(signal.rate, record.dt)
        return signal._replace(position=whole + curve(whole), rate=np.zeros_like(signal.rate))


def hidden(record: Record) -> bool:
    """Whether a model shows less than half of the output, about its mean."""
    if record.y is None or record.prediction is None:
        return False
    y = record.y[record.known]
    left = y - record.prediction[record.known]
    return float(left @ left) > 0.5 * float(np.var(y)) * y.size


def one_sided(record: Record) -> bool:
    """Whether the output keeps its sign and comes near zero, as a size does."""
    y = seen(record)[record.known]
    return bool(min(abs(y.min()), abs(y.max())) < ONE_SIDED * np.ptp(y))


def seen(record: Record) -> np.ndarray:
    """The measured output, or the simulated one where nothing was measured."""
    output = record.y if record.y is not None else record.prediction
    assert output is not None
    return output


def wide_knots(signal: np.ndarray) -> tuple[float, ...]:
    """Knots half-way between quantiles and equal distances, from the least to the greatest value.

    Forces of springs are greatest where the output seldom is.
    """
    levels = np.linspace(0.0, 1.0, N_KNOTS)
    equal = signal.min() + levels * np.ptp(signal)
    return tuple(((np.quantile(signal, levels) + equal) / 2).tolist())


def with_rest(knots: tuple[float, ...], rate: np.ndarray) -> tuple[float, ...]:
    """Knots with further ones about zero, as friction is steep where motion turns."""
    near = float(np.sqrt(np.mean(rate**2))) * np.array(NEAR_REST)
    if not knots[0] < near[0] < near[-1] < knots[-1]:
        return knots
    ends = knots[0], knots[-1]
    apart = (k for k in knots[1:-1] if np.abs(near - k).min() > near[-1] - near[-2])
    return tuple(sorted([*ends, *apart, *near.tolist()]))


def moved(record: Record) -> np.ndarray:
    """Rates of the output where two samples are known."""
    both = record.known[1:] & record.known[:-1]
    return (np.diff(seen(record), axis=0) / record.dt)[both]


N_PLAYS = 10
WIDEST = 0.95  # quantile of the signal's size, the half-width of the widest play


@dataclass(frozen=True)
class LoadingCurve:
    """What hysteresis takes from a signal that rises from rest for the first time, or falls.

    A polygon with corners at the half-widths of plays; beyond the widest it is constant. The
    basis has one curve for each play, in proportion to its weight.
    """

    knots: tuple[float, ...]

    @property
    def basis(self) -> np.ndarray:
        """Values at the knots of each curve of the basis, of shape (n_knots, n_plays)."""
        knots = np.asarray(self.knots)
        return -np.minimum(knots[:, None], knots[None, :])

    @property
    def roughness(self) -> np.ndarray:
        """Of each play: all are as likely."""
        return np.ones(len(self.knots))

    def weights(self, values: np.ndarray) -> np.ndarray:
        """Weights of the plays for values at the knots."""
        return np.linalg.solve(self.basis, values)

    def __call__(self, values: np.ndarray, at: np.ndarray) -> np.ndarray:
        """A curve, or several as columns, with ``values`` at the knots, at any points."""
        at = np.asarray(at, dtype=float)
        tail = (...,) + (None,) * (np.ndim(values) - 1)
        by_play = np.minimum(np.abs(at)[..., None], np.asarray(self.knots))
        return np.sign(at)[tail] * (-by_play @ self.weights(np.asarray(values)))


class FreeHysteresis(FreeForm):
    """Hysteresis of any shape that does not depend on speed: play, friction with a spring, or both.

    Prandtl and Ishlinskii's model: signal' = signal - sum of weight_i (signal - play_i), where the
    plays trail the signal by at most their half-widths. One play with weight one is
    :class:`Backlash`. Its curve is what is taken from a signal that leaves rest for the first time,
    over the signal.
    """

    name = "free_hysteresis"
    physics = "A signal depends on where it turned, by a curve of unknown shape."
    formula = "signal - sum of weight_i (signal - play_i(signal))"
    tex = r"s' = s - \sum_i w_i\,(s - \mathrm{play}_i(s))"
    source = "Brokate and Sprekels (1996)"
    y_word = "what play takes"

    examples = ({"at": "command"},)
    options = {"at": ("output", "command")}
    arguments = FreeForm.arguments | {
        "at": Argument(
            "What is mapped, the output or the command; None means the output, and a search for "
            "shapes tries both."
        ),
        "knots": Argument(
            "Half-widths of the plays, in units of the output; None means equal distances up to "
            "nearly the greatest distance of the signal from its mean.",
            "tuple of float or None",
        ),
    }
    citation = (
        "Brokate and Sprekels, Hysteresis and phase transitions (1996), sections 2.3 and 2.4."
    )

    @property
    def where(self) -> str:
        """What is mapped."""
        return self.at or "output"

    @property
    def place(self) -> str:  # type: ignore[override]
        if self.at not in (None, *PLACE_OF):
            self.check_choices()
        return PLACE_OF[self.where]

    @property
    def over(self) -> str:
        return OVER[self.where]

    @property
    def abscissa(self) -> Dimension:
        return U

    @property
    def ordinate(self) -> Dimension:
        return U

    @property
    def sentence(self) -> str:
        return "it has memory: the output depends on where the signal turned"

    @property
    def curve(self) -> Any:
        assert self.knots is not None
        return LoadingCurve(tuple(self.knots))

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        if self.values is not None or self.knots is None:
            return ()
        return tuple(
            Parameter(f"c{i}", ONE, -10.0, 10.0, (0.0,), f"weight of play {i}")
            for i in range(len(self.knots))
        )

    def alternatives(self, record: Record) -> list[Any]:
        """One for each place: an ARX model has no command of its own, a controller no limb."""
        places = ("output",) if record.core == CoreKind.ARX else ("output", "command")
        return [self.with_choices(at=at) for at in places] if self.at is None else [self]

    def watched(self, record: Record) -> np.ndarray:
        output = record.prediction if record.prediction is not None else record.y
        assert output is not None
        return output[record.known]

    def with_knots(self, record: Record) -> Any:
        if self.knots is not None:
            return self
        watched = self.watched(record)
        widest = float(np.quantile(np.abs(watched - watched.mean()), WIDEST))
        widths = widest * np.arange(1, N_PLAYS + 1) / N_PLAYS
        return self.with_choices(knots=tuple(widths.tolist()))

    def with_more_knots(self) -> FreeHysteresis:
        """The same: its knots are the plays themselves."""
        return self

    def shaped(self, signal: Any, record: Record, curve: Callable[..., np.ndarray]) -> Any:
        """With plays that have the weights of the curve."""
        gaps = np.asarray(self.knots)
        weights = self.curve.weights(curve(gaps))

        def behind(x: np.ndarray) -> np.ndarray:
            return x - _kernels.greybox.stops_summed(_kernels.gate(x), gaps, weights)

        if self.where != "command":
            return behind(signal)
        whole = signal.position + differentiated(signal.rate, record.dt)
        return signal._replace(position=behind(whole), rate=np.zeros_like(signal.rate))


TIME = "time"
N_IN_TIME = 21  # knots: four seconds of a run of 82 s, so that what swings in twelve is seen


FOLLOWED = (
    "What it follows: a channel, or one of "
    + ", ".join(f'``"{name}"``' for name in DERIVED)
    + ", computed of the channels of roles e, f_t and x; None means the time in the run."
)


class _Varying(FreeForm):
    """What curves over the time in the run, or over a channel, have in common."""

    channel: str | None
    what: ClassVar[str]
    by_channel: ClassVar[bool] = True

    @property
    def over(self) -> str:
        return self.channel or TIME

    @property
    def abscissa(self) -> Dimension:
        return S if self.channel is None else dimension_of(self.channel)

    @property
    def sentence(self) -> str:
        over = "time in the run" if self.channel is None else words_of(self.channel)
        return f"it acts on {self.what}, as a function of {over}"

    def alternatives(self, record: Record) -> list[Any]:
        """One over time, over each channel without a role, and over each signal that follows."""
        if self.channel is not None or self.knots is not None or not self.by_channel:
            return [self]
        channels = [*record.with_role(OTHER), *(name for name in DERIVED if record.has(name))]
        return [self, *(self.with_choices(channel=name) for name in dict.fromkeys(channels))]

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if self.channel is None:
            return None
        return needs_channel(self.channel, record, OTHER, "channel to follow")

    def with_knots(self, record: Record) -> Any:
        if self.knots is not None or self.channel is not None:
            return super().with_knots(record)
        seen = record.t[record.known.any(axis=1)]
        # From the start of the runs, which is not where the output begins to count.
        ends = np.linspace(float(record.t[0].min()), float(seen.max()), N_IN_TIME)
        return self.with_choices(knots=tuple(ends.tolist()))

    def watched(self, record: Record) -> np.ndarray:
        return record.channel(self.channel)[record.known]

    def along(self, record: Record, curve: Curve) -> np.ndarray:
        """The curve at each sample; where no data tell how it goes on with a channel, it holds."""
        assert self.knots is not None
        if self.channel is None:
            return curve(record.t)
        return curve(np.clip(record.channel(self.channel), self.knots[0], self.knots[-1]))


class FreeGain(_Varying):
    """Gains that change along any smooth curve, in time or with a channel.

    The gains on error and error rate are multiplied by max(1 + curve, 0); the curve has no level,
    which is the gain.
    """

    name = "free_gain"
    place = "gain"
    physics = "The gains change along a curve of unknown shape."
    formula = "K (1 + curve(t))"
    tex = r"K(t) = K\,(1 + \mathrm{curve}(t))"
    source = "Hastie and Tibshirani (1993)"
    kept = (SLOPE,)
    what = "the gains"
    y_word = "factor on the gains"
    at_rest = 1.0
    least = 0.0

    examples = ({"channel": "workload"},)
    options = {"of": ("both", "error", "rate")}
    arguments = FreeForm.arguments | {
        "channel": Argument(FOLLOWED),
        "of": Argument("Which gains change.", '{"both", "error", "rate"}', "both"),
    }
    citation = (
        "Wood, Generalized additive models (2017). Hastie and Tibshirani, Varying-coefficient "
        "models (1993)."
    )

    @property
    def ordinate(self) -> Dimension:
        return ONE

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if self.of == "rate" and core == CoreKind.ARX:
            return "a linear model has no gain on the error rate of its own"
        return super().refusal(record, core)

    def shaped(self, signal: Gains, record: Record, curve: Curve) -> Gains:
        factor = np.maximum(1 + self.along(record, curve), 0.0)
        if self.of == "both":
            return signal.times(factor)
        return signal._replace(**{self.of: getattr(signal, self.of) * factor})


class FreeDelay(_Varying):
    """A delay that changes along any smooth curve, in time or with a channel.

    delay + curve in seconds, not below the least delay of the model; the curve has no level, which
    is the delay.
    """

    name = "free_delay"
    place = "delay"
    physics = "The delay changes along a curve of unknown shape."
    formula = "tau_e + curve(t)"
    tex = r"\tau(t) = \tau_e + \mathrm{curve}(t)"
    source = "Wood (2017)"
    kept = (SLOPE,)
    what = "the delay"
    y_word = "change"
    largest = 0.5
    usual = 0.05

    examples = ({"channel": "workload"},)
    arguments = FreeForm.arguments | {
        "channel": Argument(FOLLOWED),
    }
    citation = "Wood, Generalized additive models (2017)."

    @property
    def ordinate(self) -> Dimension:
        return S

    def shaped(self, signal: Any, record: Record, curve: Curve) -> Any:
        return signal + self.along(record, curve)


class FreeOffset(_Varying):
    """An offset of the output that changes along any smooth curve in time, the same in each run."""

    name = "free_offset"
    place = "sum"
    physics = "The output has an offset that changes along a curve of unknown shape."
    formula = "u + curve(t)"
    tex = r"u' = u + \mathrm{curve}(t)"
    source = "Wood (2017)"
    within = ("free_map",)  # whose curves have a level
    what = "the level of the output"
    y_word = "offset"
    channel = None
    by_channel = False

    examples = ({},)
    citation = "Wood, Generalized additive models (2017)."

    @property
    def ordinate(self) -> Dimension:
        return U

    def shaped(self, signal: np.ndarray, record: Record, curve: Curve) -> np.ndarray:
        return signal + self.along(record, curve)


Curve = Callable[[np.ndarray], np.ndarray]
LONGEST = 1.5  # s, of a person's memory of what a channel did
SEEN_AHEAD = 1.0  # s, of a target that may have been shown in advance
SHAKEN = 0.5  # s, of a body's and a stick's memory of what shakes them
OF_TARGET = 0.02  # share of a channel by the target, above which the loop moves it
LAGS_OF_TARGET = 16
STRETCHES = 8  # of a run; every other one tells the rest, as the operator may change on the way
FROM_OUTSIDE = ("f_t", "dist")  # roles of channels that the loop does not move


class _Remembering(FreeForm):
    """What responses by a smooth impulse response have in common: the curve over the lag."""

    over = "lag"
    abscissa = S
    shrinks = True
    y_word = "impulse response"

    def first_lag(self, record: Record) -> float:
        """Of the impulse response, in seconds."""
        raise NotImplementedError

    @property
    def longest(self) -> float:
        """Of the impulse response, beyond its first lag; in units of the record's time."""
        return LONGEST

    def with_knots(self, record: Record) -> Any:
        if self.knots is not None:
            return self
        first = self.first_lag(record)
        ends = np.linspace(first, first + self.longest * record.time_unit, N_KNOTS)
        return self.with_choices(knots=tuple(ends.tolist()))


def convolved(signal: np.ndarray, curve: Curve, knots: tuple[float, ...], dt: float) -> np.ndarray:
    """Sum over lags between the outermost knots of curve(lag) signal(t - lag) dt.

    Before the first sample and after the last the signal holds.
    """
    first, last = round(knots[0] / dt), round(knots[-1] / dt)
    weights = curve(np.arange(first, last + 1) * dt) * dt
    weights[[0, -1]] /= 2
    n, before, after = signal.shape[0], max(last, 0), max(-first, 0)
    held = np.pad(signal, ((before, after), (0, 0)), mode="edge")
    whole = fftconvolve(held, weights[:, None], axes=0)
    return np.asarray(whole[before - first : before - first + n])


class FreePath(_Remembering):
    """A response to a channel with any smooth impulse response.

    command + integral of curve(lag) (channel(t - lag) - reference). To what the loop moves, a
    person responds after the least delay of the model; of a target alone, the future is tried too
    (``ahead``). Motion that the loop does not move may shake body and stick: then it adds to the
    output itself, and without a delay (``at``).
    """

    name = "free_path"
    title = "free response"
    physics = "A channel moves the output, by an impulse response of unknown shape."
    formula = "command + sum over lags of curve(lag) (channel(t - lag) - reference)"
    tex = (
        r"c' = c + \int \mathrm{curve}(\sigma)\,"
        r" (\mathrm{channel}(t - \sigma) - \mathrm{reference})\, d\sigma"
    )
    source = "Pillonetto et al. (2014)"

    examples = ({"channel": "e_y"},)
    options = {"at": ("command", "output")}
    arguments = FreeForm.arguments | {
        "channel": Argument("What is responded to; None tries every channel but the input."),
        "ahead": Argument(
            "How far the response looks ahead, in seconds, where the target was shown in advance.",
            "float",
            0.0,
        ),
        "at": Argument(
            "What it adds to: the command to the limb, or the output, without a delay. None means "
            "the command; a search tries the output for motion that does not follow the target."
        ),
        "knots": Argument(
            "Lags in seconds; None means equal distances over 1.5 s (for a machine, its own time), "
            "or over 0.5 s at the output.",
            "tuple of float or None",
        ),
        "reference": Argument(
            "Level of the channel that is not responded to, which is an offset; None takes its "
            "mean.",
            "float or None",
        ),
    }
    citation = (
        "Pillonetto et al., Kernel methods in system identification (2014). Marmarelis, Nonlinear "
        "dynamic modeling of physiological systems (2004)."
    )

    @property
    def place(self) -> str:  # type: ignore[override]
        if self.at not in (None, "command", "output"):
            self.check_choices()
        return "sum" if self.at == "output" else "path"

    @property
    def longest(self) -> float:
        return SHAKEN if self.at == "output" else LONGEST

    @property
    def ordinate(self) -> Dimension:
        return U / dimension_of(self.channel) / S

    @property
    def sentence(self) -> str:
        if self.at == "output":
            return f"{self.channel} shakes the output without a delay"
        told = words_of(self.channel or "")
        return f"the output also responds to {told}, as a function of how long ago it was"

    def refusal(self, record: Record, core: CoreKind) -> str | None:
        if self.channel is None and len(record.channels) > len(record.inputs):
            return None
        return needs_channel(self.channel, record, OTHER, "channel besides the input")

    def alternatives(self, record: Record) -> list[Any]:
        """One for each channel that is no input; one ahead for a target, one at once for motion."""
        if self.channel is not None:
            return [self]
        made = []
        for name in record.channels:
            if name not in record.inputs:
                made.append(self.with_choices(channel=name))
                if record.roles.get(name) == "f_t":
                    made.append(self.with_choices(channel=name, ahead=SEEN_AHEAD))
                if shakes(name, record):
                    made.append(self.with_choices(channel=name, at="output"))
        return made

    def variants(self, record: Record) -> list[Effect]:
        return [one.with_knots(record) for one in self.alternatives(record)]

    def with_knots(self, record: Record) -> Any:
        known = super().with_knots(record)
        if self.reference is not None:
            return known
        return known.with_choices(
            reference=float(record.channel(self.channel)[record.known].mean())
        )

    def first_lag(self, record: Record) -> float:
        if self.at == "output":
            return 0.0
        role = record.roles.get(self.channel or "", "")
        outside = role.startswith(FROM_OUTSIDE)
        return -self.ahead if outside else record.least_delay

    def shaped(self, signal: Any, record: Record, curve: Curve) -> Any:
        assert self.knots is not None
        away = record.channel(self.channel) - (self.reference or 0.0)
        more = convolved(away, curve, self.knots, record.dt)
        return signal + more if self.at == "output" else signal.plus(more)


def shakes(name: str, record: Record) -> bool:
    """Whether a channel is motion that the loop does not move, so that it may act at once.

    What the output moves carries what moves the output: the target. Without a target that is not
    known, and motion that follows from the output could return it.
    """
    if not record.roles.get(name, "").startswith("motion"):
        return False
    return record.once(("shakes", name), lambda: not _follows_target(name, record))


def _follows_target(name: str, record: Record) -> bool:
    """Whether answers to the target explain part of a channel in stretches of runs left out."""
    targets = record.with_role("f_t")
    if not targets:
        return True
    target, rows = record.channel(targets[0]), record.known
    lags = record.time_unit * np.linspace(0.0, 2 * LONGEST, LAGS_OF_TARGET)
    columns = np.stack([record.delayed(target, lag)[rows] for lag in lags])
    columns = np.concatenate([columns, np.ones((1, columns.shape[1]))])
    moved = record.channel(name)[rows]
    stretch = np.arange(len(rows)) * STRETCHES // len(rows)
    odd = np.broadcast_to(stretch[:, None] % 2 == 1, rows.shape)[rows]
    left = 0.0
    for test in (odd, ~odd):
        fitted = np.linalg.lstsq(columns[:, ~test].T, moved[~test], rcond=None)[0]
        left += float(np.sum((moved[test] - fitted @ columns[:, test]) ** 2))
    return left < (1 - OF_TARGET) * float(np.sum((moved - moved.mean()) ** 2))


class FreeDynamics(_Remembering):
    """Linear dynamics beyond the order of the model: any smooth memory of the delayed error.

    command + integral of curve(lag) e(t - delay - lag).
    """

    name = "free_dynamics"
    place = "path"
    physics = "The linear response to the error has a memory of unknown shape."
    formula = "command + sum over lags of curve(lag) e(t - delay - lag)"
    tex = r"c' = c + \int \mathrm{curve}(\sigma)\, e(t - \tau_e - \sigma)\, d\sigma"
    source = "Pillonetto et al. (2014)"

    examples = ({},)
    citation = "Pillonetto et al., Kernel methods in system identification (2014)."

    @property
    def ordinate(self) -> Dimension:
        return U / E / S

    @property
    def sentence(self) -> str:
        return self.sentence_in("human")

    def sentence_in(self, domain: str) -> str:
        error = SIGNALS.get(domain, SIGNALS["human"])["error"]
        return f"the linear response to the {error} differs, as a function of how long ago it was"

    def first_lag(self, record: Record) -> float:
        return 0.0

    def shaped(self, signal: Command, record: Record, curve: Curve) -> Command:
        assert self.knots is not None
        return signal.plus(convolved(signal.error, curve, self.knots, record.dt))
