"""
How long should the memory be?
==============================

A short memory follows a change quickly but mistakes noise for change; a long one averages out noise
but lags. Where is the optimum, and does it help to give each parameter its own memory?

The figures are those of Fig. 13 and Appendix J of the thesis in a smaller form: 10 runs instead of
100, each of which is estimated alone and validated on the nine others.
"""

# %%
# Conditions
# ----------
# C1 does not change, C3 changes slowly from 1/s to 1/s², C4 suddenly, C6 suddenly back; remnant of
# 15 %. :class:`skhoid.RecursiveARXCV` estimates all horizons at once, and scores the free run along
# each path in the 20.48 s around the transition. ``LeavePGroupsOut(9)`` trains on one run and
# validates on nine.

import numpy as np
from sklearn.model_selection import LeavePGroupsOut

from skhoid import RecursiveARXCV, VAFScorer, make_tracking_runs
from skhoid.plotting import MemoryHorizonDisplay

N_RUNS = 10
HORIZONS = [*(2.0 ** np.arange(4, 14)), np.inf]
OPTIONS = {"nk": 29, "scoring": VAFScorer(window=(30.72, 51.2)), "n_jobs": 2}


def cut_runs(condition, intensity):
    """Runs with remnant of second order, with the gains of Table G.1."""
    return make_tracking_runs(
        condition, N_RUNS, remnant_gain="table", remnant_intensity=intensity, random_state=0
    )


def searched(X, y, horizons=HORIZONS, estimated=1):
    """A search that estimates so many runs together and validates on the rest."""
    cv = LeavePGroupsOut(N_RUNS - estimated)
    return RecursiveARXCV(horizons, cv=cv, **OPTIONS).fit(X, y)


runs = {name: cut_runs(name, 0.15) for name in ("C1", "C3", "C4", "C6")}
searches = {name: searched(*of_condition) for name, of_condition in runs.items()}
_ = MemoryHorizonDisplay.from_estimator(searches)

# %%
# Where nothing changes, forgetting costs. Where something does, the best horizon is near 256
# samples, 2.56 s; half or twice that is nearly as good, and 32 samples are no better than no
# forgetting. The change back (C6) gains least.

for name, search in searches.items():
    gain = search.cv_results_["gain"]
    print(f"{name}: best N0 {search.best_memory_horizon_:5g}, gain {gain.max():5.2f} points")

# %%
# Remnant
# -------
# The same for C4 with less and with more remnant.

intensities = {
    "$P_n$ = 0.05": searched(*cut_runs("C4", 0.05)),
    "$P_n$ = 0.15": searches["C4"],
    "$P_n$ = 0.30": searched(*cut_runs("C4", 0.30)),
}
_ = MemoryHorizonDisplay.from_estimator(intensities)
for name, search in intensities.items():
    gain = search.cv_results_["gain"]
    best = search.best_memory_horizon_
    print(f"{name.replace('$', '')}: best N0 {best:5g}, gain {gain.max():5.2f} points")

# %%
# Overfit
# -------
# How much better does a path simulate the run that it was estimated from? The picture shows the
# difference between the two VAFs (Eq. J.1), for the same searches. It is small from the best
# horizon on, and grows quickly to the left of it: what is learned there is noise. (Its wide bands
# are differences between runs.)

_ = MemoryHorizonDisplay.from_estimator(intensities, kind="overfit_difference")

# %%
# λ against Λ
# -----------
# An entry with one horizon per parameter is a Λ: here one that does not forget a_1 and a_2.

horizons = [*HORIZONS, *((np.inf, np.inf, n, n) for n in HORIZONS[:-1])]
both = searched(*runs["C4"], horizons)
_ = MemoryHorizonDisplay.from_estimator(both)

# %%

scores = both.cv_results_["mean_test_score"]
n = len(HORIZONS)
for horizon, scalar, matrix in zip(HORIZONS[:-1], scores[:n], scores[n:], strict=False):
    print(f"N0 {horizon:5g}: VAF with λ {scalar:6.2f}, with Λ {matrix:6.2f} %")

# %%
# More runs
# ---------
# Several runs can tell from noise what one run cannot. The best horizon depends on the number of
# pooled runs.

pooled = {"one run": searches["C4"], "nine runs pooled": searched(*runs["C4"], estimated=9)}
_ = MemoryHorizonDisplay.from_estimator(pooled, kind="score")
for name, search in pooled.items():
    print(f"{name}: best N0 {search.best_memory_horizon_:g}, VAF {search.best_score_:.1f} %")

# %%
# The answer
# ----------
# About 256 samples at 100 Hz, 2.56 s, where a person adapts to another element with 15 % remnant,
# for models of single runs: the free run then explains 10 points more than without forgetting (C3,
# C4), or 4 (C6). Less remnant allows a shorter memory, more demands a longer one: by a factor of
# two at 5 and at 30 %. Where nothing changes, do not forget. A separate memory for each parameter
# changes the VAF by 0.1 points at the best horizon, and by 1 where the memory is too short or too
# long. More runs help more: nine pooled runs raise the VAF by 2 points, with a memory of 64
# samples.
