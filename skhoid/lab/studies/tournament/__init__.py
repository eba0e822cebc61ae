"""Which method follows an operator best: a tournament of methods on simulated runs."""

from .cells import TournamentCell, tournament_cells
from .methods import TOURNAMENT_METHODS, TournamentMethod, available_methods
from .recommend import MethodAdvice, recommend_method
from .result import TournamentResult
from .study import run_tournament

__all__ = [
    "TOURNAMENT_METHODS",
    "MethodAdvice",
    "TournamentCell",
    "TournamentMethod",
    "TournamentResult",
    "available_methods",
    "recommend_method",
    "run_tournament",
    "tournament_cells",
]
