"""Studies of many simulated runs: Monte Carlo, those of the thesis, the tournament of methods."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "blocks": ["Block", "DataSet"],
        "declared": ["Claim", "PaperStudy", "StudyResult"],
        "identity": ["identified_as"],
        "memory_horizons": ["ForgettingAdvice", "recommend_forgetting"],
        "monte_carlo": ["MonteCarloStudy"],
        "statistics": ["summarize"],
        "thesis": ["PAPER_STUDIES", "paper_study"],
        "tournament": ["MethodAdvice", "recommend_method", "run_tournament"],
        "tournament_conditions": ["TournamentCell", "tournament_cells"],
        "tournament_methods": ["TOURNAMENT_METHODS", "TournamentMethod", "available_methods"],
        "tournament_result": ["TournamentResult"],
    },
)
