"""Every plot: one Display per file, in the pattern of scikit-learn.

A new Display is a dataclass on the base in ``_display`` and a name in the list below. What several
displays share is in the files with an underscore.
"""

from ._axes import names_as_they_are as names_as_they_are
from ._roles import PALETTE, ROLES
from .bode import BodeDisplay
from .comparison import ComparisonDisplay
from .condition_means import ConditionMeansDisplay
from .delay_loss import DelayLossDisplay
from .effect_ranking import EffectRankingDisplay
from .effect_steps import EffectStepsDisplay
from .error_path import ErrorPathDisplay
from .experiment import ExperimentDisplay
from .forgetting_profile import ForgettingProfileDisplay
from .group_effects import GroupEffectsDisplay
from .identified_effect import IdentifiedEffectDisplay
from .memory_horizon import MemoryHorizonDisplay
from .noise_ceiling import NoiseCeilingDisplay
from .operating_point import OperatingPointDisplay
from .operator_parameters import OperatorParametersDisplay
from .parameter_forest import ParameterForestDisplay
from .parameter_path import ParameterPathDisplay
from .people import PeopleDisplay
from .residual_correlation import ResidualCorrelationDisplay
from .residual_frequency import ResidualFrequencyDisplay
from .residual_map import ResidualMapDisplay
from .residual_time import ResidualTimeDisplay
from .run_comparison import RunComparisonDisplay
from .shape import ShapeDisplay
from .simulation import SimulationDisplay
from .study_boxes import StudyBoxDisplay
from .study_paths import StudyPathDisplay
from .study_responses import StudyResponseDisplay
from .study_trade_off import StudyTradeOffDisplay
from .tournament_bias import TournamentBiasDisplay
from .tournament_settling import TournamentSettlingDisplay
from .tournament_winners import TournamentWinnersDisplay
from .tracking import TrackingDisplay
from .vaf_contour import VAFContourDisplay

__all__ = [
    "PALETTE",
    "ROLES",
    "BodeDisplay",
    "ComparisonDisplay",
    "ConditionMeansDisplay",
    "DelayLossDisplay",
    "EffectRankingDisplay",
    "EffectStepsDisplay",
    "ErrorPathDisplay",
    "ExperimentDisplay",
    "ForgettingProfileDisplay",
    "GroupEffectsDisplay",
    "IdentifiedEffectDisplay",
    "MemoryHorizonDisplay",
    "NoiseCeilingDisplay",
    "OperatingPointDisplay",
    "OperatorParametersDisplay",
    "ParameterForestDisplay",
    "ParameterPathDisplay",
    "PeopleDisplay",
    "ResidualCorrelationDisplay",
    "ResidualFrequencyDisplay",
    "ResidualMapDisplay",
    "ResidualTimeDisplay",
    "RunComparisonDisplay",
    "ShapeDisplay",
    "SimulationDisplay",
    "StudyBoxDisplay",
    "StudyPathDisplay",
    "StudyResponseDisplay",
    "StudyTradeOffDisplay",
    "TournamentBiasDisplay",
    "TournamentSettlingDisplay",
    "TournamentWinnersDisplay",
    "TrackingDisplay",
    "VAFContourDisplay",
]
