"""Experiments with several people: simulation, identification, statistics and shared effects."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "analyse": ["analyse_experiment"],
        "export": ["write_long", "write_wide"],
        "group": ["GroupEffectSearch"],
        "identify": ["identify_people"],
        "mending": ["mend_recordings"],
        "mixed": ["mixed_model"],
        "repeated": ["repeated_measures"],
        "simulate": ["simulate_experiment"],
    },
)
