"""The search for physical effects that a model is missing: ``EffectSearchCV`` and its parts."""

from .effect_search import EffectSearchCV
from .shape import Shape

__all__ = ["EffectSearchCV", "Shape"]
