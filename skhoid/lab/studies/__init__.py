"""Studies of many simulated runs: Monte Carlo, those of the thesis, the tournament of methods."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "memory_horizons": ["recommend_forgetting"],
        "monte_carlo": ["MonteCarloStudy"],
        "statistics": ["summarize"],
        "thesis": ["paper_study"],
        "tournament": ["recommend_method", "run_tournament"],
        "tournament_conditions": ["TournamentCell", "tournament_cells"],
        "tournament_methods": ["TOURNAMENT_METHODS"],
    },
)
