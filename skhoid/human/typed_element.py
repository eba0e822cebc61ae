"""A controlled element as people type it."""

from __future__ import annotations

from typing import Any

from .controlled_element import ControlledElement
from .element_text import is_number
from .linear_element import LinearElement


def element_of(text: str | None) -> Any:
    """A transfer function, or the numbers K_c and omega_b; None for none."""
    if text is None:
        return None
    words = text.split()
    if len(words) == 2 and all(is_number(word) for word in words):
        return ControlledElement(float(words[0]), float(words[1]))
    return LinearElement.of(text)
