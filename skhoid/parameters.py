"""The one table of a model's parameters, which fits, reports, sliders and files read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd

from .exceptions import did_you_mean

NORMAL_95 = 1.96
COLUMNS = ("value", "sd", "low", "high", "unit", "meaning")
BOUND = 1e-3  # of its size, within which a value is at a bound


class Kind(StrEnum):
    """Where the value of a parameter comes from."""

    ESTIMATED = "estimated"
    GIVEN = "given"
    DERIVED = "derived"  # follows from others, such as a ratio
    COEFFICIENT = "coefficient"  # estimated, of a curve that is shown as a whole


@dataclass(frozen=True)
class ModelParameter:
    """One number of a model.

    Attributes
    ----------
    name : str
        Name; of an effect ``<effect>__<parameter>``.
    value : float
        Estimated or given value; before a fit, the value that it starts from.
    unit : str
        Unit of the data; "-" for none.
    meaning : str
        What it is.
    kind : Kind
        ``"estimated"``, ``"given"``, ``"derived"`` from others, or a ``"coefficient"`` of a curve.
    sd : float
        Standard error: 0 where the value was given, NaN at a bound or where the data do not
        determine it.
    low, high : float
        95 % interval; the whole range where the data do not determine the value.
    min, max : float
        Bounds: what is physically possible.
    start : float
        Value to start the next fit from; NaN for those of the model.
    """

    name: str
    value: float = np.nan
    unit: str = "-"
    meaning: str = ""
    kind: Kind = Kind.ESTIMATED
    sd: float = np.nan
    low: float = np.nan
    high: float = np.nan
    min: float = -np.inf
    max: float = np.inf
    start: float = np.nan

    @property
    def free(self) -> bool:
        """Whether a fit estimates it."""
        return self.kind in (Kind.ESTIMATED, Kind.COEFFICIENT)

    @property
    def at_bound(self) -> str:
        """``"lower"`` or ``"upper"``, if the value is at a bound; else ``""``."""
        for bound, side in ((self.min, "lower"), (self.max, "upper")):
            if np.isfinite(bound) and abs(self.value - bound) <= BOUND * max(abs(bound), 1e-300):
                return side
        return ""

    @property
    def is_vague(self) -> bool:
        """Whether the standard error of a size, which is never below zero, exceeds the size."""
        return self.free and self.min >= 0.0 and self.sd > self.value

    def checked(self, value: Any) -> float:
        """A value that is possible for it; an error says why another is not."""
        if not isinstance(value, Real) or not np.isfinite(float(value)):
            raise ValueError(f"{self.name} must be a finite number; got {value!r}.")
        if not self.min <= float(value) <= self.max:
            raise ValueError(
                f"{self.name} = {float(value):.6g} is outside its range of {self.min:.6g} to "
                f"{self.max:.6g}: beyond it the model is not physical, or the effect is too small "
                "to matter."
            )
        return float(value)

    def given(self, value: float) -> ModelParameter:
        """The same, not estimated, at a value."""
        return replace(self, kind=Kind.GIVEN, value=value, sd=0.0, low=value, high=value)

    def moved_to(self, value: float) -> ModelParameter:
        """The same at another value, which has no standard error."""
        return replace(self, value=value, sd=np.nan, low=np.nan, high=np.nan)


class ParameterTable(Mapping[str, ModelParameter]):
    """Parameters of a model or of an effect by name, in order.

    It never changes: :meth:`fix` and :meth:`vary` return another table, which
    ``model.with_table(table)`` makes a model of.

    Parameters
    ----------
    parameters : iterable of ModelParameter
        Its rows.

    See Also
    --------
    skhoid.OperatorRegressor : Has the table of its estimates as ``parameter_table_``.

    Examples
    --------
    >>> from skhoid import OperatorRegressor, make_tracking_runs
    >>> X, y = make_tracking_runs("C1", 2, remnant_intensity=0.05, random_state=1)
    >>> table = OperatorRegressor(effects=["bias"]).fit(X, y).parameter_table_
    >>> table["tau_e"].min, table["tau_e"].max, table["tau_e"].unit
    (0.1, 1.5, 's')
    >>> fixed = table.fix("bias__level", 0.02)
    >>> fixed["bias__level"].free, table["bias__level"].free
    (False, True)
    """

    def __init__(self, parameters: Iterable[ModelParameter]):
        self._rows = {one.name: one for one in parameters}

    def __getitem__(self, name: str) -> ModelParameter:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        return self.frame().to_string()

    def _repr_html_(self) -> str:
        return str(self.frame().to_html())

    def frame(self) -> pd.DataFrame:
        """All but coefficients of curves, as a DataFrame indexed by parameter.

        Returns
        -------
        frame : DataFrame
            Columns value, sd, low, high, unit, meaning, min, max, free and start.
        """
        columns = [*COLUMNS, "min", "max", "free", "start"]
        shown = [one for one in self.values() if one.kind != Kind.COEFFICIENT]
        rows = [[getattr(one, column) for column in columns] for one in shown]
        index = pd.Index([one.name for one in shown], name="parameter", dtype=object)
        return pd.DataFrame(rows, columns=columns, index=index)

    def estimates(self) -> pd.DataFrame:
        """The same without bounds and starts, as ``parameters_`` of a model shows it."""
        return self.frame()[list(COLUMNS)]

    def fix(self, name: str, value: float | None = None) -> ParameterTable:
        """Another table in which a parameter is given.

        Parameters
        ----------
        name : str
            Which.
        value : float or None, default=None
            Its value; None keeps the present one.
        """
        one = self._settable(name)
        value = one.checked(one.value if value is None else value)
        return self._with(one.given(value))

    def vary(self, name: str, start: float | None = None) -> ParameterTable:
        """Another table in which a parameter is estimated.

        Parameters
        ----------
        name : str
            Which.
        start : float or None, default=None
            Value to start from; None means the present one.
        """
        one = self._settable(name)
        start = one.checked(one.value if start is None else start)
        kind = one.kind if one.free else Kind.ESTIMATED
        return self._with(replace(one.moved_to(one.value), kind=kind, start=start))

    def checked(self, values: Mapping[str, Any], known: Sequence[str]) -> dict[str, float]:
        """Values for some of the ``known`` parameters, each possible; an error says what is not."""
        return {name: self._known(name, known).checked(value) for name, value in values.items()}

    def _known(self, name: str, known: Sequence[str]) -> ModelParameter:
        if name not in known:
            raise ValueError(
                f"{name!r} is no parameter that can be set. These can: {', '.join(known)}."
                f"{did_you_mean(name, known)}"
            )
        return self[name]

    def _settable(self, name: str) -> ModelParameter:
        return self._known(name, [n for n, one in self.items() if one.kind != Kind.DERIVED])

    def moved(self, values: Mapping[str, float], given: Iterable[str]) -> ParameterTable:
        """The table at other values; those ``given`` by hand, and what changed, have no errors."""
        given = set(given)
        return ParameterTable(
            one.moved_to(values[name])
            if name in values and (name in given or values[name] != one.value)
            else one
            for name, one in self.items()
        )

    def _with(self, changed: ModelParameter) -> ParameterTable:
        return ParameterTable({**self._rows, changed.name: changed}.values())
