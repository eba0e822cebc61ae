"""Functions of studies that are identified by a declared name and version, not by their source."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

ATTRIBUTE = "_study_identity"

# What manifests written before the package's functions had identities say about them: module, name
# and digest of the source.
BEFORE = {
    ("skhoid: delays and bias", 1): [
        "skhoid.lab.studies.montecarlo.delays.delays_and_bias",
        "f3a7f95b3a272aab",
    ],
    ("skhoid: forgetting VAF", 1): [
        "skhoid.lab.studies.montecarlo.forgetting.forgetting_vaf",
        "f368af3a55639875",
    ],
    ("skhoid: parameter paths", 1): [
        "skhoid.lab.studies.montecarlo.paths.parameter_paths",
        "82d0d23079898355",
    ],
    ("skhoid: frequency responses", 1): [
        "skhoid.lab.studies.montecarlo.responses.responses_of",
        "c3a6f8a17ff3211d",
    ],
}


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
    >>> from skhoid.lab.studies.montecarlo import MonteCarloStudy, identified_as
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
