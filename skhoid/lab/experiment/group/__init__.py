"""Which effects people share."""

from .search import GroupEffectSearch

__all__ = ["GroupEffectSearch"]
