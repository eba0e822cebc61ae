"""Identity of a study: descriptions and digests that do not depend on process or date."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
from collections.abc import Callable, Mapping
from copyreg import dispatch_table
from dataclasses import fields, is_dataclass
from enum import Enum
from types import CodeType
from typing import Any, TypeVar

import joblib
import numpy as np
import pandas as pd

PLAIN = (bool, int, float, str, bytes, tuple, type(None))
OF_MODULE = ("__name__", "__file__", "__cached__", "__package__", "__doc__")


def described(value: Any, within: tuple[int, ...] = ()) -> Any:
    """A value in a form that JSON can hold; equal values give equal descriptions, in any process.

    Numbers and text describe themselves; dataclasses and mappings are described by their parts,
    functions by the identity they declare or else by their name, source and enclosed variables,
    estimators by their parameters and fitted attributes, arrays and all else by a digest of their
    contents. The module of an object does not count. ``within`` are the objects around it, which
    stops recursion in objects that refer to themselves.
    """
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        number = float(value)  # exact as text, and infinity and NaN are not JSON
        return int(number) if number.is_integer() else repr(number)
    if id(value) in within:
        return "itself"
    part = functools.partial(described, within=(*within, id(value)))
    if isinstance(value, Mapping):
        return {str(key): part(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [part(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return ["set", sorted((part(item) for item in value), key=repr)]
    if isinstance(value, np.ndarray):
        if value.dtype == object:
            return [f"array {value.shape}", part(value.ravel().tolist())]
        contents = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]
        return [f"array {value.dtype} {value.shape}", contents]
    if isinstance(value, (pd.DataFrame, pd.Series, pd.Index)):
        frame = value.reset_index() if not isinstance(value, pd.Index) else value.to_frame()
        columns = [part(frame.iloc[:, i].to_numpy()) for i in range(frame.shape[1])]
        return [type(value).__qualname__, part([str(name) for name in frame.columns]), columns]
    if isinstance(value, functools.partial):
        return ["partial", part(value.func), part(value.args), part(value.keywords)]
    if inspect.ismethod(value):
        return [_of_function(value.__func__, part), part(value.__self__)]
    if inspect.isfunction(value):
        return _of_function(value, part)
    if inspect.isclass(value):
        return [value.__qualname__, digest(_source(value))]
    kind = type(value).__qualname__
    if is_dataclass(value):
        return [kind, {field.name: part(getattr(value, field.name)) for field in fields(value)}]
    if hasattr(value, "get_params"):
        parameters = value.get_params(deep=False)
        learned = {key: item for key, item in vars(value).items() if key not in parameters}
        return [kind, part(parameters), *([part(learned)] if learned else [])]
    if isinstance(value, Enum):
        return [kind, value.name]
    source = [digest(_source(type(value)))] if callable(value) else []
    try:
        if _is_plain(type(value)):
            _, made_with, state, *_ = value.__reduce_ex__(2)
            return [kind, *source, part([made_with[1:], state])]
        return [kind, *source, joblib.hash(value)]
    except Exception as error:
        raise TypeError(
            f"A {kind} cannot be told apart from others of its kind ({type(error).__name__}: "
            f"{error}). "
            "A study needs this for its seeds and its folder: use numbers, text, dataclasses or "
            "functions."
        ) from error


def _of_function(function: Any, part: Any) -> list[Any]:
    """Name, source, defaults, what it encloses, and the plain values and helpers of its module."""
    declared = declared_identity(function)
    if declared is not None:
        return [declared[0], f"version {declared[1]}"]
    code = function.__code__
    # The source of a lambda is a line, which may hold several.
    source = "" if function.__name__ == "<lambda>" else _source(function)
    held: dict[str, Any] = {"defaults": [function.__defaults__, function.__kwdefaults__]}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        try:
            held[name] = cell.cell_contents
        except ValueError:  # not assigned yet
            continue
    for name in sorted(_names(code)):
        if name not in function.__globals__ or name in OF_MODULE:
            continue
        found = function.__globals__[name]
        helper = inspect.isfunction(found) and found.__module__ == function.__module__
        if helper or isinstance(found, PLAIN):
            held[f"global {name}"] = found
    return [function.__qualname__, digest([source or _of_code(code), part(held)])]


def _is_plain(kind: type) -> bool:
    """Whether its objects are defined by their attributes; others pickle in their own way."""
    own = (kind.__reduce__, kind.__reduce_ex__) != (object.__reduce__, object.__reduce_ex__)
    return not own and kind not in dispatch_table


def _source(thing: Any) -> str:
    try:
        return inspect.getsource(thing)
    except (OSError, TypeError):  # typed at a prompt, or compiled
        return ""


def _names(code: CodeType) -> set[str]:
    """Names of globals (and attributes) that a function and those within it use."""
    inner = [_names(const) for const in code.co_consts if isinstance(const, CodeType)]
    return set(code.co_names).union(*inner)


def _of_code(code: CodeType) -> list[Any]:
    """Bytecode without addresses and without the order of sets, which differ by process."""
    constants = [
        _of_code(const)
        if isinstance(const, CodeType)
        else sorted(map(repr, const))
        if isinstance(const, frozenset)
        else repr(const)
        for const in code.co_consts
    ]
    return [code.co_code.hex(), list(code.co_names), list(code.co_varnames), constants]


def digest(value: Any) -> str:
    """A short digest of a description."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


def spawn_key(value: Any) -> tuple[int, ...]:
    """Spawn key for the random numbers of an object with this description: four whole numbers."""
    raw = hashlib.sha256(json.dumps(value, sort_keys=True).encode()).digest()
    return tuple(int.from_bytes(raw[i : i + 4], "little") for i in range(0, 16, 4))


def differing_parts(one: Any, two: Any, where: str = "") -> list[str]:
    """Where two descriptions differ, as text; the second is the current one."""
    if isinstance(one, dict) and isinstance(two, dict):
        found = []
        for key in [*one, *(key for key in two if key not in one)]:
            inner = f"{where}.{key}" if where else str(key)
            found += differing_parts(one.get(key), two.get(key), inner)
        return found
    if isinstance(one, list) and isinstance(two, list) and len(one) == len(two):
        found = []
        for i, (a, b) in enumerate(zip(one, two, strict=True)):
            found += differing_parts(a, b, f"{where}[{i}]")
        return found
    if one == two:
        return []
    if isinstance(one, list) and isinstance(two, list) and where == "cells":
        return [f"cells: {len(one)} there, {len(two)} here"]
    return [f"{where}: {_short(one)} there, {_short(two)} here"]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


F = TypeVar("F", bound=Callable[..., Any])

ATTRIBUTE = "_study_identity"


def identified_as(name: str, version: int = 1) -> Callable[[F], F]:
    """Identify the function of a study by a name and a version, instead of by its source.

    The folder of a study belongs to its function: a changed source makes a different study. A
    function with a declared identity may be rewritten, renamed and moved, and its folders still
    open; in return you must raise ``version`` whenever its results change (including changes
    through functions that it calls and through its defaults).

    Parameters
    ----------
    name : str
        Different from those of your other functions.
    version : int, default=1
        Raise it by one whenever the results change.

    Returns
    -------
    decorator : callable
        Returns the function it is given.

    Raises
    ------
    TypeError
        If it decorates anything but a function.
    ValueError
        If the name is empty, the version is not a whole number of at least 1, or the function is
        defined within another one: the variables it encloses would not be part of its identity.

    See Also
    --------
    MonteCarloStudy : Where such functions are used.

    Examples
    --------
    >>> from skhoid.lab.studies import MonteCarloStudy, identified_as
    >>> @identified_as("spread of u", version=2)
    ... def spread(data):
    ...     return {"sd": data.y.std()}
    >>> MonteCarloStudy(spread, {"condition": ["C1"]}).description["function"]
    ['spread of u', 'version 2']
    """
    if not isinstance(name, str) or not name:
        raise ValueError(f"name of an identity must be non-empty text; got {name!r}.")
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise ValueError(
            f"version of {name!r} must be a whole number, at least 1; got {version!r}."
        )

    def decorator(function: F) -> F:
        if not inspect.isfunction(function):
            raise TypeError(
                f"identified_as({name!r}) is for functions; got {function!r}. Decorate the "
                "function before functools.partial."
            )
        if "<locals>" in function.__qualname__:
            raise ValueError(
                f"identified_as({name!r}): {function.__qualname__} is defined within a function, "
                "and the variables it encloses would not be part of its identity. Define it in a "
                "module, and pass values as settings or by functools.partial."
            )
        setattr(function, ATTRIBUTE, (name, version))
        return function

    return decorator


def declared_identity(function: Any) -> tuple[str, int] | None:
    """Name and version of a function that has them."""
    return getattr(function, ATTRIBUTE, None)
