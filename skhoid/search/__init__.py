"""The search for physical effects that a model is missing: ``EffectSearchCV`` and its parts."""

from .data import control_of as control_of
from .data import without_output as without_output
from .effect_search import EffectSearchCV
from .evidence import COLUMNS as EVIDENCE_COLUMNS  # noqa: F401
from .evidence import evidence_of as evidence_of
from .judging import LEAST_GAIN as LEAST_GAIN
from .judging import THRESHOLD as THRESHOLD
from .memory import pack_result as pack_result
from .memory import unpack_result as unpack_result
from .probability import log_factor as log_factor
from .probability import log_lead as log_lead
from .results import SearchResult
from .results import with_effects as with_effects
from .shape import BY_HAND as BY_HAND
from .shape import Shape
from .share import Share
from .sketch import checked_name as checked_name
from .statuses import TRIED as TRIED
from .statuses import Reason, Status, Verdict
from .telling import HOW_TO_GO_ON as HOW_TO_GO_ON
from .telling import limits_table as limits_table
from .telling import parameters_table as parameters_table
from .telling import tell_baseline as tell_baseline
from .telling import tell_candidates as tell_candidates
from .telling import tell_headline as tell_headline
from .telling import tell_limit as tell_limit
from .telling import tell_no_name as tell_no_name
from .telling import tell_search as tell_search
from .telling import tell_stand_ins as tell_stand_ins
from .telling import tell_step as tell_step
from .telling import tell_verdict as tell_verdict
from .telling import unexplained_by as unexplained_by

__all__ = ["EffectSearchCV", "Reason", "SearchResult", "Shape", "Share", "Status", "Verdict"]
