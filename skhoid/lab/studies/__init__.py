"""Studies of many simulated runs: the thesis, the tournament of methods, Monte Carlo."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=["montecarlo", "thesis", "tournament"]
)
