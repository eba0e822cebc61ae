"""Identity of a study: descriptions and digests that do not depend on process or date."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import CodeType
from typing import Any

import joblib
import numpy as np
import pandas as pd

PLAIN = (bool, int, float, str, bytes, tuple, type(None))
OF_MODULE = ("__name__", "__file__", "__cached__", "__package__", "__doc__")


def described(value: Any, within: tuple[int, ...] = ()) -> Any:
    """A value in a form that JSON can hold; equal values give equal descriptions, in any process.

    Numbers and text describe themselves; dataclasses and mappings are described by their parts,
    functions by their name, source and enclosed variables, estimators by their parameters and
    fitted attributes, arrays and all else by a digest of their contents. The module of an object
    does not count. ``within`` are the objects around it, which stops recursion in objects that
    refer to themselves.
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
        if hasattr(value, "__dict__"):
            return [kind, *source, part(vars(value))]
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
    return _sha256(value).hex()[:16]


def spawn_key(value: Any) -> tuple[int, ...]:
    """Spawn key for the random numbers of an object with this description: four whole numbers."""
    return tuple(np.frombuffer(_sha256(value)[:16], dtype="<u4").tolist())


def _sha256(value: Any) -> bytes:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).digest()


def differing_parts(one: Any, two: Any, where: str = "") -> list[str]:
    """Where two descriptions differ, as text; the second is the current one."""
    if isinstance(one, dict) and isinstance(two, dict):
        parts = [(f".{key}" if where else str(key), key) for key in {**one, **two}]
        pairs = [(name, one.get(key), two.get(key)) for name, key in parts]
    elif isinstance(one, list) and isinstance(two, list) and len(one) == len(two):
        pairs = [(f"[{i}]", a, b) for i, (a, b) in enumerate(zip(one, two, strict=True))]
    elif isinstance(one, list) and isinstance(two, list) and where == "cells":
        return [f"cells: {len(one)} there, {len(two)} here"]
    else:
        return [] if one == two else [f"{where}: {_short(one)} there, {_short(two)} here"]
    return [text for name, a, b in pairs for text in differing_parts(a, b, where + name)]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
