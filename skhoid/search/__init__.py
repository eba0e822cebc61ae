"""The search for physical effects that a model is missing: ``EffectSearchCV`` and its parts."""

from .effect_search import EffectSearchCV
from .shape import Shape
from .sketch import checked_name as checked_name
from .statuses import Reason, Status, Verdict

__all__ = ["EffectSearchCV", "Reason", "Shape", "Status", "Verdict"]
