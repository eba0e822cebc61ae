"""What plots of people in conditions share: the label of an axis."""

from __future__ import annotations

from ._axes import parameter_symbol, with_unit
from .operator_parameters import SYMBOLS


def axis_label(parameter: str, unit: str) -> str:
    return with_unit(SYMBOLS.get(parameter, parameter_symbol(parameter)), unit or None)
