"""From shape to name: a Python file with an effect of one's own, made of a shape."""

from __future__ import annotations

import json
import keyword
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..effects.catalogue import BY_NAME, FREE_FORMS
from ..effects.free_form import FreeForm
from ..effects.operator_signals import N_PLACES
from ..effects.parameter import Dimension
from ..effects.registry import titles_of
from .formulas import Fitted
from .shape import Shape

WIDTH = 100
IMPORTED = ("Dimension", "Effect", "Parameter", *(form.__name__ for form in FREE_FORMS))
OUT_OF_SIZE = 10.0  # times what was found, the bounds of a parameter


class SketchesEffects:
    """What a search with a ``shape_`` can do: write it as an effect."""

    shape_: Shape | None
    best_effects_: list[str]

    def sketch_effect(self, name: str, path: Any, *, overwrite: bool = False) -> Path:
        """Write the shape of what has no name as an effect of one's own, in a Python file.

        The effect has a short formula with parameters to estimate, where one lies within the band
        of the curve; otherwise the curve as a table, with its size to estimate. It passes
        :func:`skhoid.testing.check_effect`, and models and searches take it like any other.

        Parameters
        ----------
        name : str
            Id of the effect, such as ``"my_effect"``; its class is then ``MyEffect``.
        path : str or path-like
            File to write, or an existing folder for ``<name>.py``.
        overwrite : bool, default=False
            Whether to replace a file that exists.

        Returns
        -------
        path : Path
            Of the file.

        Raises
        ------
        ValueError
            If there is no shape, or the name cannot be that of a new effect.
        FileExistsError
            If the file exists, unless ``overwrite``.

        See Also
        --------
        skhoid.effects.Effect : What may be changed in the file.
        """
        check_is_fitted(self)
        if self.shape_ is None:
            raise ValueError(why_no_shape(self.best_effects_))
        return written(name, path, self.shape_, overwrite=overwrite)


def why_no_shape(ids: Sequence[str]) -> str:
    """Why a search has no shape, and what to do."""
    if not ids:
        return (
            "There is no shape to sketch: nothing was found that these data could show. More "
            "runs show smaller effects."
        )
    if ids[-1] != "unknown":
        return (
            f"There is no shape to sketch: what is missing has a name, {titles_of(ids)}. "
            "best_estimator_ has it; effect(name) of skhoid.effects makes it."
        )
    return (
        "There is no shape to sketch: no free form at any place explains what is missing. "
        "unexplained_ says where it shows; write an effect by hand, or record more channels."
    )


def written(name: str, path: Any, shape: Shape, *, overwrite: bool = False) -> Path:
    """Write the file of an effect."""
    checked_name(name)
    target = Path(path)
    if target.is_dir():
        target = target / f"{name}.py"
    if not target.parent.is_dir():
        raise FileNotFoundError(
            f"There is no folder {str(target.parent)!r} for the effect {name!r}: make it first, or "
            "give another path."
        )
    if target.exists() and not overwrite:
        raise FileExistsError(
            f"{str(target)!r} exists, and may have been changed by hand: give another path, or "
            "overwrite=True."
        )
    target.write_text(write_source(name, shape), encoding="utf-8", newline="\n")
    return target


def checked_name(name: Any) -> None:
    """Raise an error that says why a name cannot be that of a new effect."""
    if not isinstance(name, str):
        raise TypeError(f'An effect needs a name, such as "my_effect"; got {name!r}.')
    if not name.isidentifier() or keyword.iskeyword(name) or "__" in name or name[0] == "_":
        raise ValueError(
            f"{name!r} cannot be the name of an effect: use a word of letters, digits and single "
            'underscores that Python has not taken, such as "my_effect".'
        )
    if name in {*BY_NAME, *(form.name for form in FREE_FORMS)}:
        raise ValueError(
            f"{name!r} is in the catalogue of skhoid already: give your effect another name."
        )
    if name_class(name) in IMPORTED:
        raise ValueError(
            f"{name!r} would make a class {name_class(name)}, which skhoid.effects has already: "
            "give your effect another name."
        )


def name_class(name: str) -> str:
    """Name of the class of an effect: ``MyEffect`` for ``my_effect``."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))


def write_source(name: str, shape: Shape) -> str:
    """The file of an effect as text."""
    form, formula = shape.effect, shape.formula
    lines = ['"""' + _first_line(name), "", *_provenance(shape), '"""', ""]
    body = list(_by_formula(name, shape, formula) if formula else _by_table(name, shape))
    if formula is not None and form.place != "spring":
        body = ["", *body]  # two lines before a class
    code = "\n".join(body)
    if "np." in code:
        lines += ["import numpy as np"]
    if "expit(" in code:
        lines += ["from scipy.special import expit"]
    if "np." in code or "expit(" in code:
        lines += [""]
    used = ["Dimension", "Effect", "Parameter"]
    if formula is None:
        used.append(type(form).__name__)
    lines += [f"from skhoid.effects import {', '.join(sorted(used))}", ""]
    return "\n".join([*lines, code, ""])


def _first_line(name: str) -> str:
    return f"An effect of my own: {name.replace('_', ' ')}."


def _wrapped(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(
        text, WIDTH - 2, initial_indent=indent, subsequent_indent=indent, break_long_words=False
    )


def _provenance(shape: Shape) -> list[str]:
    """Where the effect comes from, for its docstring."""
    shown = f"{shape.gain:.1f} points of VAF on held-out rows"
    told = (
        f"Sketched by skhoid from the shape of what had no name: {shape.sentence}. There it "
        f"explained {shown} ({100 * shape.closed:.0f} % of what was left to explain), with a curve "
        f"of {shape.dof:.1f} effective degrees of freedom."
    )
    lines = _wrapped(told.replace('"', "'").replace("\\", "/"))
    if shape.formula is not None:
        near = (
            "The formula lies within the curve's simultaneous 95 % band, at a distance of "
            f"{100 * shape.formula.distance:.0f} % of its rms. The curve itself, where what the "
            f"model refits is left out, as {shape.x_label}: {shape.y_label} (band):"
        )
        lines += ["", *_wrapped(near), "", *_rows_of_curve(shape)]
    lines += ["", *_wrapped(_numbers(shape))]
    return [line.replace('"""', "'''") for line in lines]


def _numbers(shape: Shape) -> str:
    if shape.formula is not None:
        return (
            "Numbers are in the units of the data in which it was found. Give them meanings of "
            "your own, and a source; skhoid.testing.check_effect checks what you change."
        )
    return (
        "No short formula that was tried lies within the curve's band: it is kept as a table, in "
        "the units of the data in which it was found, with its size to be estimated."
    )


def _rows_of_curve(shape: Shape) -> Iterator[str]:
    knots = np.asarray(shape.effect.knots)
    grid = shape.curve.index.to_numpy(dtype=float)
    value, low, high = (
        np.interp(knots, grid, shape.curve[key].to_numpy()) for key in ("value", "low", "high")
    )
    for x, y, a, b in zip(knots, value, low, high, strict=True):
        yield f"    {x:10.4g}: {y:10.4g}  ({a:.4g} to {b:.4g})"


def _by_table(name: str, shape: Shape) -> Iterator[str]:
    form: Any = shape.effect
    beyond = f", beyond {form.at_rest:g}" if form.at_rest else ""
    comment = f"{shape.x_label}; {shape.y_label}{beyond}"
    yield f"TABLE = (  # {comment[: WIDTH - 14]}"
    for x, y in zip(form.knots, np.asarray(form.values).tolist(), strict=True):
        yield f"    ({x:.6g}, {y:.6g}),"
    yield ")"
    yield "KNOTS = tuple(x for x, _ in TABLE)"
    yield from ["", ""]
    yield from _head(name, shape, "with a curve from a table")
    yield '    neutral = {"size": 0.0}'
    yield "    parameters = ("
    meaning = "multiple of the table"
    yield f'        Parameter("size", Dimension(), -3.0, 3.0, (1.0,), meaning="{meaning}"),'
    yield "    )"
    yield ""
    yield from _refusal(form)
    yield "    def apply(self, signal, record, size):"
    yield "        values = tuple(size * y for _, y in TABLE)"
    defaults = type(form)().get_params()
    given = {k: v for k, v in form.get_params().items() if k not in ("knots", "values", "spread")}
    own = [f"{k}={_literal(v)}" for k, v in given.items() if v != defaults[k]]
    arguments = [*own, "knots=KNOTS", "values=values"]
    yield f"        form = {type(form).__name__}({', '.join(arguments)})"
    yield "        return form.apply(signal, record)"


def _literal(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def _head(name: str, shape: Shape, how: str) -> Iterator[str]:
    form = shape.effect
    sentence = shape.sentence[0].upper() + shape.sentence[1:]
    yield f"class {name_class(name)}(Effect):"
    yield from _wrapped(f'"""{_first_line(name)[:-1]}, {how}."""', "    ")
    yield ""
    yield f'    name = "{name}"'
    yield f'    place = "{form.place}"'
    yield f"    physics = {_literal(f'{sentence}.')}"
    formula = form.formula if shape.formula is None else _formula_text(form, shape.formula)
    yield f"    formula = {_literal(formula)}"
    yield '    source = "sketched from data by skhoid"'


def _formula_text(form: FreeForm, fitted: Fitted) -> str:
    """The formula with the words of its place."""
    before = {"input": "e", "output": "u", "command": "command", "delay": "tau_e", "sum": "u"}
    letter = "e" if form.place == "input" else form.over
    text = fitted.formula.text
    if fitted.formula.whole:
        return f"{letter}' = {text.removesuffix(' - x').replace('x', letter)}".replace(
            f"e{letter}p", "exp"
        )
    if form.place in ("spring", "path"):
        sign = "-" if form.place == "spring" else "+"
        return f"command {sign} {text} with x = {form.over}"
    if form.place == "gain":
        return f"K (1 + {text})" + ("" if form.over == "time" else f" with x = {form.over}")
    whole = f"{before[form.place]} + {text}"
    return whole if form.over == "time" else f"{whole} with x = {letter}"


def _refusal(form: FreeForm) -> Iterator[str]:
    """What says that a channel is missing."""
    channel = getattr(form, "channel", None)
    if channel is None:
        return
    yield "    def refusal(self, record, core):"
    yield f'        if record.has("{channel}"):'
    yield "            return None"
    yield f'        return "X has no channel {channel}"'
    yield ""


def _by_formula(name: str, shape: Shape, fitted: Fitted) -> Iterator[str]:
    form: Any = shape.effect
    names = fitted.formula.names
    if form.place == "spring":
        yield f"LOW, HIGH = {form.knots[0]:.6g}, {form.knots[-1]:.6g}  # {shape.x_label}"
        yield from ["", ""]
    yield from _head(name, shape, "with a formula whose numbers are estimated")
    if not fitted.formula.whole:
        yield '    neutral = {"size": 0.0}'
    yield "    parameters = ("
    for parameter in zip(
        names, fitted.dimensions(form), fitted.values, fitted.formula.meanings, strict=True
    ):
        yield from _parameter(*parameter, fitted)
    yield "    )"
    yield ""
    yield from _refusal(form)
    yield f"    def apply(self, signal, record, {', '.join(names)}):"
    yield from _applied(form, fitted)


def _parameter(
    name: str, dimension: Dimension, value: float, meaning: str, fitted: Fitted
) -> Iterator[str]:
    low, high = value / OUT_OF_SIZE, value * OUT_OF_SIZE
    if name == "size":
        low, high = -abs(value) * OUT_OF_SIZE, abs(value) * OUT_OF_SIZE
    elif fitted.formula.signed:
        reach = max(fitted.high[1:])
        low, high = value - reach, value + reach
    yield "        Parameter("
    yield f'            "{name}",'
    yield f"            {_dimension(dimension)},"
    yield f"            {_number(low)},"
    yield f"            {_number(high)},"
    yield f"            ({_number(value)},),"
    yield f'            meaning="{meaning}",'
    yield "            scale=Dimension(),  # in the units of the data"
    yield "        ),"


def _number(value: float) -> str:
    return repr(float(f"{value:.4g}"))


def _dimension(dimension: Dimension) -> str:
    own = {f.name: getattr(dimension, f.name) for f in fields(dimension)}
    channels = own.pop("channels")
    parts = [f"{name}={power}" for name, power in own.items() if power]
    if channels:
        inner = ", ".join(f'("{name}", {power})' for name, power in channels)
        parts.append(f"channels=({inner},)")
    return f"Dimension({', '.join(parts)})"


def _applied(form: Any, fitted: Fitted) -> Iterator[str]:
    """What the effect does with its signal."""
    code = fitted.formula.code
    if form.place == "spring":
        rate = ", of_rate=True" if form.over == "du/dt" else ""
        yield f"        x = np.linspace(LOW, HIGH, {N_PLACES})"
        yield f"        force = {code}"
        yield f"        return signal.bent(force, LOW, HIGH{rate})"
        return
    if form.place == "command":
        yield "        x = signal.position + np.gradient(signal.rate, record.dt, axis=0)"
        yield f"        position = {_whole('x', fitted)}"
        yield "        return signal._replace(position=position, rate=np.zeros_like(signal.rate))"
        return
    if form.place in ("input", "output"):
        yield "        x = signal"
        yield f"        return {_whole('x', fitted)}"
        return
    if form.place == "path":
        yield "        x = np.gradient(signal.error, record.dt, axis=0)"
        yield f"        return signal.plus({code})"
        return
    channel = getattr(form, "channel", None)
    yield "        t = record.t" if channel is None else f'        x = record.channel("{channel}")'
    if form.place != "gain":
        yield f"        return signal + {code}"
        return
    yield f"        factor = np.maximum(1.0 + {code}, 0.0)"
    which = getattr(form, "of", "both")
    if which == "both":
        yield "        return signal.times(factor)"
    else:
        yield f"        return signal._replace({which}=signal.{which} * factor)"


def _whole(signal: str, fitted: Fitted) -> str:
    """A signal with what a formula adds to it."""
    code = fitted.formula.code
    return code.removesuffix(" - x") if fitted.formula.whole else f"{signal} + {code}"
