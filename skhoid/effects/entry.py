"""What follows from the entry of an effect: the arguments of ``__init__``, and the docstring."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from .parameter import Parameter

WIDTH = 96
UNITS = {"[u]": "units of the output", "[e]": "units of the error", "s": "seconds"}
SECTION = re.compile(r"\n\n[A-Z][A-Za-z ]*\n---")
ESTIMATED = "None estimates it."


@dataclass(frozen=True)
class Argument:
    """What an entry says of an argument that is no parameter, or differs from what is usual.

    Parameters
    ----------
    meaning : str
        For the docstring.
    kind : str, default="str or None"
        Its type, for the docstring.
    default : object, default=None
        Its default.

    See Also
    --------
    Parameter : One number of an effect.

    Examples
    --------
    >>> from skhoid.effects import Argument
    >>> Argument("Level that is not answered.", kind="float", default=0.0).default
    0.0
    """

    meaning: str
    kind: str = "str or None"
    default: Any = None


class DeclaredParameters:
    """The parameters of an entry: of an effect, those of its form, in the units of its place."""

    def __init__(self, declared: tuple[Parameter, ...]):
        self.declared = declared

    def __get__(self, effect: Any, owner: type) -> tuple[Parameter, ...]:
        if effect is None:
            return self.declared
        chosen = {effect.chosen(argument) for argument in effect.choices}
        chosen |= {getattr(effect, argument) for argument in effect.options}
        return tuple(
            effect.resolved(p) for p in self.declared if not p.forms or chosen.intersection(p.forms)
        )


def complete(cls: Any) -> None:
    """Give a class what follows from its entry, unless it has it already."""
    declared = cls.__dict__.get("parameters")
    if isinstance(declared, tuple) and all(isinstance(p, Parameter) for p in declared):
        cls.parameters = DeclaredParameters(declared)
    if getattr(cls.__init__, "of_entry", False):
        cls.__init__ = _made_init(cls)
        told = inspect.cleandoc(cls.__doc__ or "")
        if told and "\nParameters\n---" not in told:
            first = SECTION.search(told)
            at = first.start() if first else len(told)
            cls.__doc__ = "\n".join([told[:at], *_sections(cls)]) + told[at:]


def _numbers(cls: Any) -> dict[str, list[Parameter]]:
    """The parameters of a class by name; forms may have the same name with other bounds."""
    named: dict[str, list[Parameter]] = {}
    declared = cls.parameters if isinstance(cls.parameters, tuple) else ()
    for p in declared:
        named.setdefault(p.name, []).append(p)
    return named


def _made_init(cls: Any) -> Callable[..., None]:
    names = dict.fromkeys([*_numbers(cls), *cls.arguments, *cls.choices])
    defaults = {n: cls.arguments[n].default if n in cls.arguments else None for n in names}

    def __init__(self: Any, **given: Any) -> None:
        unknown = given.keys() - defaults.keys()
        if unknown:
            raise TypeError(
                f"{type(self).__name__} has no argument {', '.join(sorted(unknown))}; it takes "
                f"{', '.join(defaults) or 'none'}."
            )
        for name, default in defaults.items():
            setattr(self, name, given.get(name, default))

    keyword, itself = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
    __init__.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter("self", itself),
            *(inspect.Parameter(n, keyword, default=default) for n, default in defaults.items()),
        ]
    )
    __init__.__qualname__ = f"{cls.__qualname__}.__init__"
    __init__.__module__ = cls.__module__
    __init__.of_entry = True  # type: ignore[attr-defined]
    return __init__


def _sections(cls: Any) -> Iterator[str]:
    """Parameters, references and an example, as numpydoc has them."""
    rows = list(_rows(cls))
    if rows:
        yield from ["", "Parameters", "----------", *rows]
    if cls.citation or cls.source:
        yield from [
            "",
            "References",
            "----------",
            *_wrapped(cls.citation or f"{cls.source}.", ""),
        ]
    if cls.examples and cls.__module__.startswith(__package__):  # where it is imported from
        given = ", ".join(f"{n}={_literal(v)}" for n, v in cls.examples[0].items())
        shown = "place" if cls.free_form else "fixed"
        yield from ["", "Examples", "--------", f">>> from skhoid.effects import {cls.__name__}"]
        yield f">>> {cls.__name__}({given}).{shown}"
        yield repr(getattr(cls(**cls.examples[0]), shown))


def _rows(cls: Any) -> Iterator[str]:
    for name, forms in _numbers(cls).items():
        if name not in cls.arguments:
            yield f"{name} : float or None, default=None"
            yield from _wrapped(f"{_told([cls().resolved(p) for p in forms])}; {ESTIMATED}")
    for name, argument in cls.arguments.items():
        if name not in cls.choices:
            yield f"{name} : {argument.kind}, default={argument.default!r}"
            yield from _wrapped(argument.meaning)
    for name, options in cls.choices.items():
        argument = cls.arguments.get(name, Argument(_tried(name, cls.chosen_by_default(name))))
        shown = ", ".join(_literal(option) for option in options)
        default = argument.default if argument.default is None else _literal(argument.default)
        yield f"{name} : {{{shown}}} or None, default={default}"
        yield from _wrapped(argument.meaning)


def _tried(name: str, usual: str) -> str:
    return f'"{usual}" unless it is given; a search tries all.'


def _told(forms: list[Parameter]) -> str:
    """What a parameter is, its unit, and which forms have it."""
    first = forms[0]
    told = first.meaning[:1].upper() + first.meaning[1:]
    labels = dict.fromkeys(p.dimension.label() for p in forms)
    unit = " or ".join(UNITS.get(label, label) for label in labels if label != "-")
    if unit:
        told += f", in {unit}"
    having = [form for p in forms for form in p.forms]
    return f"{told} ({', '.join(map(_literal, having))})" if all(p.forms for p in forms) else told


def _literal(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _wrapped(text: str, indent: str = "    ") -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent=indent, subsequent_indent=indent, break_long_words=False
    )


def catalogued_pairs(classes: Mapping[str, Any]) -> dict[frozenset[str], str]:
    """What to record to tell two effects apart, by their ids."""
    return {
        frozenset({name, other}): told
        for name, entry in classes.items()
        for other, told in entry.told_apart.items()
    }
