"""Every plot, in the pattern of scikit-learn: one Display a question, one file a subject.

A Display is a dataclass on the base in ``_display``, and a name in the list below. What several
share is in the files with an underscore.
"""

from ._axes import legend_entries, names_as_they_are, with_unit
from ._roles import PALETTE, ROLES
from .comparison import ComparisonDisplay
from .effect import EffectDisplay
from .frequency import BodeDisplay
from .memory import MemoryHorizonDisplay
from .orders import DelayLossDisplay, VAFContourDisplay
from .parameters import EnsembleDisplay, ParametersDisplay
from .people import GroupEffectsDisplay, GroupMeansDisplay, PeopleDisplay
from .search import SearchDisplay
from .study import StudyBoxDisplay, StudyResponseDisplay
from .time import SimulationDisplay, TrackingDisplay
from .tournament import TournamentDisplay

__all__ = [
    "PALETTE",
    "ROLES",
    "BodeDisplay",
    "ComparisonDisplay",
    "DelayLossDisplay",
    "EffectDisplay",
    "EnsembleDisplay",
    "GroupEffectsDisplay",
    "GroupMeansDisplay",
    "MemoryHorizonDisplay",
    "ParametersDisplay",
    "PeopleDisplay",
    "SearchDisplay",
    "SimulationDisplay",
    "StudyBoxDisplay",
    "StudyResponseDisplay",
    "TournamentDisplay",
    "TrackingDisplay",
    "VAFContourDisplay",
    "legend_entries",
    "names_as_they_are",
    "with_unit",
]
