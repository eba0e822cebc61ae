"""Checks for effects of your own: ``check_effect``, and records on which to try effects."""

from .checks import check_effect
from .records import synthetic_record

__all__ = ["check_effect", "synthetic_record"]
