"""Functions of studies that are identified by a declared name and version, not their source."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

ATTRIBUTE = "_study_identity"

# What manifests say of the package's own functions that were written before these had identities
# of their own: module, name and digest of the source.
BEFORE = {
    ("skhoid: delays and bias", 1): [
        "skhoid.montecarlo.delays.delays_and_bias",
        "f3a7f95b3a272aab",
    ],
    ("skhoid: forgetting VAF", 1): [
        "skhoid.montecarlo.forgetting.forgetting_vaf",
        "f368af3a55639875",
    ],
    ("skhoid: parameter paths", 1): [
        "skhoid.montecarlo.paths.parameter_paths",
        "82d0d23079898355",
    ],
    ("skhoid: frequency responses", 1): [
        "skhoid.montecarlo.responses.responses_of",
        "c3a6f8a17ff3211d",
    ],
}


def identified_as(name: str, version: int = 1) -> Callable[[F], F]:
    """Identify the function of a study by a name and a version, instead of by its source.

    The folder of a study belongs to its function: another source makes another study. A function
    with a declared identity may be rewritten, renamed and moved, and its folders still open; in
    return it is up to you to raise ``version`` when it returns other numbers (also those of
    functions that it calls, and of its defaults).

    Parameters
    ----------
    name : str
        Unlike that of your other functions.
    version : int, default=1
        To be raised by one whenever the results change.

    Returns
    -------
    decorator : callable
        Gives back the function it is given.

    Raises
    ------
    TypeError
        If it decorates anything but a function.
    ValueError
        If the name is empty, the version not a whole number from 1, or the function made within
        another one: what such a function encloses would be no part of its identity.

    See Also
    --------
    MonteCarloStudy : What the function is for.

    Examples
    --------
    >>> from skhoid.montecarlo import MonteCarloStudy, identified_as
    >>> @identified_as("spread of u", version=2)
    ... def spread(data):
    ...     return {"sd": data.y.std()}
    >>> MonteCarloStudy(spread, {"condition": ["C1"]}).description["function"]
    ['spread of u', 'version 2']
    """
    if not isinstance(name, str) or not name:
        raise ValueError(f"name of an identity is text that is not empty; got {name!r}.")
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise ValueError(f"version of {name!r} is a whole number, at least 1; got {version!r}.")

    def decorator(function: F) -> F:
        if not inspect.isfunction(function):
            raise TypeError(
                f"identified_as({name!r}) is for functions; got {function!r}. Decorate the "
                "function before functools.partial."
            )
        if "<locals>" in function.__qualname__:
            raise ValueError(
                f"identified_as({name!r}): {function.__qualname__} is made within a function, and "
                "what it encloses would be no part of its identity. Define it in a module, and "
                "give values as settings or by functools.partial."
            )
        setattr(function, ATTRIBUTE, (name, version))
        return function

    return decorator


def declared_identity(function: Any) -> tuple[str, int] | None:
    """Name and version of a function that has them."""
    return getattr(function, ATTRIBUTE, None)
