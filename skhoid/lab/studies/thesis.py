"""The studies of the thesis by the names of its figures: ``paper_study`` reproduces one."""

from __future__ import annotations

import os
from typing import Any

from ...exceptions import did_you_mean
from .declared import CONDITIONS, INTENSITIES, PaperStudy, StudyResult
from .delays import DELAYS
from .memory_horizons import FORGETTING
from .parameter_paths import PATHS
from .responses import RESPONSES

_ALL: dict[str, Any] = {"conditions": CONDITIONS, "intensities": INTENSITIES, "step": 0.64}
PAPER_STUDIES: dict[str, PaperStudy] = {
    "fig9": DELAYS,
    "fig10": DELAYS.showing("relative bias of batch models", "fig10"),
    "fig12": DELAYS.showing("n_k fixed or estimated: validation VAF", "fig12", orders=(2,)),
    "fig13": FORGETTING,
    "fig14": PATHS,
    "fig15": PATHS.showing("operator parameters over time in C4", "fig15"),
    "appG": DELAYS.showing(
        "delay and bias at 50, 100 and 200 Hz, open and closed loop",
        "fig9",
        "fig10",
        sampling_rates=(50.0, 100.0, 200.0),
        open_loop=(False, True),
        n_validation=0,
    ),
    "appI": RESPONSES,
    "appJ": FORGETTING.showing("VAF and overfit by memory horizon", "figJ"),
    "appK": PATHS.showing("ARX parameters over time in all conditions", "fig14", **_ALL),
    "appL": PATHS.showing("operator parameters over time in all conditions", "fig15", **_ALL),
}
"""Studies by the name of a figure or an appendix."""


def paper_study(
    name: str,
    n_replications: int = 100,
    *,
    every_figure: bool = False,
    random_state: Any = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
    **options: Any,
) -> StudyResult:
    """Reproduce a study of the thesis.

    Parameters
    ----------
    name : str
        A name in ``PAPER_STUDIES``, such as ``"fig13"``.
    n_replications : int, default=100
        Runs per cell; as in the thesis.
    every_figure : bool, default=False
        Draw all figures of the study, not only those of this name.
    random_state : int, RandomState, Generator or None, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`skhoid.MonteCarloStudy.run`.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.
    **options
        Options of this study, as in ``PAPER_STUDIES[name].options``. All have ``conditions``,
        ``intensities`` (P_n) and ``gains`` ("table": K_n of Table G.1; "tuned": on ten realisations
        with their own seeds). Others are ``orders`` or ``remnant_order`` of the remnant filter (1,
        2, 3, 4, "nm"), ``n_validation`` runs per cell, ``sampling_rates`` in Hz, ``open_loop``
        (whether the remnant goes round the loop, Eq. G.1), ``memory_horizons`` (N0 in samples, one
        of them infinite) or one ``memory_horizon``, and ``step`` in s between the times that a
        table keeps.

    Returns
    -------
    result : StudyResult
        Tables, claims and figures.

    Raises
    ------
    ValueError
        If there is no such study, or it has no such option.

    Notes
    -----
    Figs. 9-12 and App. G: batch ARX[2, 2] models of each run with the true delay n_k^0 (``delay``
    "fixed") and with n_k*, that of the lowest one-step loss from 0.15 to 0.48 s ("estimated"):
    parameters and their relative bias (Eq. 30), ``weight_ratio`` (of ``|A|^2`` at 100 and at 20
    rad/s, Fig. 11) and ``vaf_validation`` (whole window, %).

    Fig. 13 and App. J: recursive models of each run, theta0 = OLS of the first 30.72 s, P0 = I, for
    all memory horizons; λ forgets all parameters, Λ only b0 and b1. The path is simulated on each
    validation run and scored from 30.72 to 51.20 s. All replications of a cell share its validation
    runs: the standard error of the level is ``sd_validation`` over the root of ``n_validation``.

    Figs. 14-15, Apps. K and L: the same recursions with one horizon, and batch models of the first
    and last 30.72 s ("ini", "fin"; time NaN), converted to the operator's parameters.

    App. I: responses at the lines of the target by Fourier coefficients (Eq. 5.14), a batch model
    with n_k*, and a recursion without forgetting; by cell, method and line the relative bias of the
    ensemble mean, its total complex deviation (Eq. H.7), and the ratio of stated deviations (Eqs.
    H.9, H.10) to those of the ensemble.

    Examples
    --------
    >>> from skhoid.lab.studies import paper_study
    >>> found = paper_study("fig12", 4, conditions=["C1"], intensities=[0.1], n_validation=2)
    >>> found.claims[-2].source, found.claims[-2].holds, list(found.figures)
    ('Fig. 12', True, ['fig12'])
    """
    if name not in PAPER_STUDIES:
        raise ValueError(
            f"No study {name!r}; there are {', '.join(PAPER_STUDIES)}."
            f"{did_you_mean(name, PAPER_STUDIES)}"
        )
    paper = PAPER_STUDIES[name]
    for option in options:
        if option not in paper.options:
            raise ValueError(
                f"The study {name!r} has no option {option!r}; it has {list(paper.options)}."
            )
    study = paper.declare(n_replications, random_state, **options)
    table = study.run(out, n_jobs=n_jobs, progress=progress)
    if "remnant_order" in table:
        table["remnant_order"] = table["remnant_order"].astype(str)
    good = table[table["error"].isna()]
    summary = paper.summarize(good)
    figures = {
        key: draw
        for key, draw in paper.draw(good).items()
        if every_figure or not paper.shown or key.startswith(paper.shown)
    }
    return StudyResult(name, paper.title, table, summary, list(paper.judge(summary, good)), figures)
