"""The studies of the thesis by the names of its figures: ``paper_study`` reproduces one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from inspect import signature
from typing import Any

from ....exceptions import did_you_mean
from .delays import delay_study
from .parameter_paths import path_study
from .responses import response_study
from .study_result import CONDITIONS, INTENSITIES, StudyResult
from .trade_off import forgetting_study


@dataclass(frozen=True)
class PaperStudy:
    """A study of the thesis: which function, with which options, draws which figures.

    Parameters
    ----------
    function : callable
        One of the study functions.
    what : str
        What it shows, in a few words.
    figures : tuple of str
        Prefixes of the names of its figures; empty for all.
    options : dict
        Options that differ from the function's defaults.

    Examples
    --------
    >>> from skhoid.lab.studies.thesis import PAPER_STUDIES
    >>> PAPER_STUDIES["fig12"].what
    'n_k fixed or estimated: validation VAF'
    """

    function: Callable[..., StudyResult]
    what: str
    figures: tuple[str, ...] = ()
    options: dict[str, Any] = field(default_factory=dict)


PAPER_STUDIES: dict[str, PaperStudy] = {
    "fig9": PaperStudy(delay_study, "delay estimates against the remnant filter", ("fig9",)),
    "fig10": PaperStudy(delay_study, "relative bias of batch models", ("fig10",)),
    "fig12": PaperStudy(
        delay_study, "n_k fixed or estimated: validation VAF", ("fig12",), {"orders": (2,)}
    ),
    "fig13": PaperStudy(forgetting_study, "memory horizons, λ and Λ", ("fig13",)),
    "fig14": PaperStudy(path_study, "ARX parameters over time in C4", ("fig14",)),
    "fig15": PaperStudy(path_study, "operator parameters over time in C4", ("fig15",)),
    "appG": PaperStudy(
        delay_study,
        "delay and bias at 50, 100 and 200 Hz, open and closed loop",
        ("fig9", "fig10"),
        {"sampling_rates": (50.0, 100.0, 200.0), "open_loop": (False, True), "n_validation": 0},
    ),
    "appI": PaperStudy(response_study, "frequency responses by three methods"),
    "appJ": PaperStudy(forgetting_study, "VAF and overfit by memory horizon", ("figJ",)),
    "appK": PaperStudy(
        path_study,
        "ARX parameters over time in all conditions",
        ("fig14",),
        {"conditions": CONDITIONS, "intensities": INTENSITIES, "step": 0.64},
    ),
    "appL": PaperStudy(
        path_study,
        "operator parameters over time in all conditions",
        ("fig15",),
        {"conditions": CONDITIONS, "intensities": INTENSITIES, "step": 0.64},
    ),
}


def paper_study(
    name: str, n_replications: int = 100, *, every_figure: bool = False, **options: Any
) -> StudyResult:
    """Reproduce a study of the thesis.

    Parameters
    ----------
    name : str
        A name in ``PAPER_STUDIES``, such as ``"fig13"``.
    n_replications : int, default=100
        As in the thesis.
    every_figure : bool, default=False
        Draw all figures of the study, not only those of this name.
    **options
        Other options of the study's function, such as ``conditions``, ``n_jobs`` or ``out``.

    Returns
    -------
    result : StudyResult
        The result of the study function.

    Raises
    ------
    ValueError
        If there is no such study, or it has no such option.

    Examples
    --------
    >>> from skhoid.lab.studies.thesis import paper_study
    >>> found = paper_study("fig12", 4, conditions=["C1"], intensities=[0.1], n_validation=2)
    >>> found.claims[-2].source, found.claims[-2].holds, list(found.figures)
    ('Fig. 12', True, ['fig12'])
    """
    if name not in PAPER_STUDIES:
        raise ValueError(
            f"No study {name!r}; there are {', '.join(PAPER_STUDIES)}."
            f"{did_you_mean(name, PAPER_STUDIES)}"
        )
    study = PAPER_STUDIES[name]
    known = list(signature(study.function).parameters)
    for option in options:
        if option not in known:
            raise ValueError(f"The study {name!r} has no option {option!r}; it has {known[1:]}.")
    result = study.function(n_replications, **(study.options | options))
    figures = {
        key: draw
        for key, draw in result.figures.items()
        if every_figure or not study.figures or key.startswith(study.figures)
    }
    return replace(result, name=name, figures=figures)
