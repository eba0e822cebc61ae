"""Checks of effects of your own."""

from .checks import check_effect
from .records import synthetic_record

__all__ = ["check_effect", "synthetic_record"]
