"""Which physical effect a model is missing."""

from .effect_search import EffectSearchCV

__all__ = ["EffectSearchCV"]
