"""The search for physical effects that a model is missing: ``EffectSearchCV`` and its parts."""

from .effect_search import EffectSearchCV
from .evidence import COLUMNS as EVIDENCE_COLUMNS  # noqa: F401
from .evidence import evidence_of as evidence_of
from .explanations import with_effects as with_effects
from .left_out import control_of as control_of
from .left_out import without_output as without_output
from .shape import Shape
from .sketch import checked_name as checked_name
from .statuses import Reason, Status, Verdict

__all__ = ["EffectSearchCV", "Reason", "Shape", "Status", "Verdict"]
