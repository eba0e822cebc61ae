"""The search for physical effects that a model is missing: ``EffectSearchCV`` and its parts."""

from .effect_search import EffectSearchCV

__all__ = ["EffectSearchCV"]
