"""What the user chose: which column is what, its unit, and the model to fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

__all__ = ["KINDS", "NOT_USED", "Choices"]

NOT_USED = ""
KINDS = {
    NOT_USED: "not used",
    "time": "time",
    "run": "run",
    "subject": "subject",
    "condition": "condition",
    "session": "session",
    "block": "block",
    "e": "error e",
    "u": "output u, what the person did",
    "x": "x, output of the controlled element",
    "f_t": "target f_t",
    "dist": "disturbance",
    "motion": "motion",
    "other": "other channel",
}
CORES = ("operator", "arx")
DISPLAYS = ("compensatory", "pursuit", "preview")
LONGEST = 200  # characters of a unit


@dataclass(frozen=True)
class Choices:
    """All that is needed, beside the files, to make X, y and the model of them.

    ``named`` is what the command line says of columns, for the guess; ``kinds`` and ``units`` are
    by column, as corrected in the page, and None as long as the guess is left as it is.
    """

    named: dict[str, Any] = field(default_factory=dict)
    kinds: dict[str, str] | None = None
    units: dict[str, str] | None = None
    dt: float | None = None
    subject: str | None = None
    condition: str | None = None
    resample: bool = False
    remove_means: bool = False
    run_in: float | None = None
    core: str = "operator"
    delay: float | None = None
    na: int | None = None
    nb: int | None = None
    nk: int | None = None
    display: str | None = None
    controlled_element: str | None = None
    effects: list[str] | None = None
    max_effects: int | None = None
    lost_control: str = "leave_out"

    @property
    def clock(self) -> float | None:
        """The sampling time where no column is the time; of a resampled one it is the new."""
        return None if self.resample else self.dt

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, found: Mapping[str, Any]) -> Choices:
        """Choices of a session; what this version does not know is left out."""
        known = {one.name for one in fields(cls)}
        return cls(**{name: value for name, value in found.items() if name in known})

    def corrected(self, asked: Mapping[str, Any], columns: list[str]) -> Choices:
        """These choices with what the page sends, which is checked.

        ``columns`` are those of the files, the only ones that may be named.
        """
        kinds = asked.get("kinds", self.kinds)
        units = asked.get("units", self.units)
        return replace(
            self,
            kinds=None if kinds is None else _by_column(kinds, columns, "kind", KINDS),
            units=None if units is None else _by_column(units, columns, "unit", None),
            dt=_number(asked.get("dt", self.dt), "The sampling time"),
            core=_one_of(asked.get("core", self.core), CORES, "core"),
            display=_one_of(
                asked.get("display", self.display) or None, (None, *DISPLAYS), "display"
            ),
            remove_means=bool(asked.get("remove_means", self.remove_means)),
            resample=bool(asked.get("resample", self.resample)),
        )


def _by_column(
    given: Any, columns: list[str], what: str, allowed: Mapping[str, str] | None
) -> dict[str, str]:
    if not isinstance(given, Mapping):
        raise ValueError(f"The {what}s of the columns must be an object; got {given!r:.80}.")
    for column, value in given.items():
        if column not in columns:
            raise ValueError(f"The files have no column {column!r:.200}.")
        if not isinstance(value, str) or (allowed is not None and value not in allowed):
            raise ValueError(f"Column {column!r:.200} cannot be {value!r:.80}.")
        if len(value) > LONGEST:
            raise ValueError(f"The {what} of column {column!r:.200} is too long: {len(value)}.")
    return {str(column): value.strip() for column, value in given.items()}


def _number(value: Any, what: str) -> float | None:
    if value is None or value == "":
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{what} must be a number above 0, in seconds; got {value!r:.80}.")
    return number


def _one_of(value: Any, allowed: tuple[Any, ...], what: str) -> Any:
    if value not in allowed:
        raise ValueError(f"There is no {what} {value!r:.80}.")
    return value
