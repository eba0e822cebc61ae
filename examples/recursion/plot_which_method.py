"""
Which method follows an operator best?
======================================

Least squares with forgetting, a Box-Jenkins recursion, Kalman filters on the physical parameters,
windows, sigmoids, smoothing: what does each of them make of the same runs?

A small tournament. The whole one, of all methods in 94 conditions, is ``skhoid study tournament``;
its table is on :doc:`this page </which-method>`.
"""

# %%
# The methods
# -----------
# Each has one knob, with five settings, and is tuned by the VAF of validation runs. What a method
# is ``told`` matters when results are compared: most models of the ARX form are given the true
# delay, others estimate it, and the oracle is told when and how the operator changes.

# sphinx_gallery_thumbnail_number = 1
from skhoid.lab.studies import TOURNAMENT_METHODS

NAMES = ["rls", "rls_auto", "box_jenkins", "ekf", "rls_smooth", "sigmoid", "lpv", "arx"]
for name in NAMES:
    method = TOURNAMENT_METHODS[name]
    kind = "causal" if method.causal else "offline"
    told = method.told or "nothing"
    print(f"{method.name:12s} {kind:8s} told: {told:9s} {method.label}; knob: {method.knob}")

# %%
# The runs
# --------
# An operator who does not change (C1), one who changes suddenly (C4), and one who relapses: after
# 22 s everything is as it was, which no sigmoid can follow. Four runs of each, remnant of 15 %.

from skhoid.lab.studies import run_tournament, tournament_cells

cells = tournament_cells("small", conditions=["C1", "C4", "relapse"])
result = run_tournament(NAMES, cells, size="small", n_validation=2)
_ = result.plot("winners")

# %%
# Numbers are the RMSE of K_edot over time, in % of its true value. Pale cells are close races. The
# oracle is not ranked.

print(result)

# %%
# Bias and scatter
# ----------------
# The RMSE has two parts. Remnant goes round the loop into the error, and biases least squares; the
# memory trades scatter for lag. Marks of causal methods are filled; arcs are lines of equal RMSE.

_ = result.plot("bias")

# %%
# Speed and noise
# ---------------
# A method that is quiet before the change is often slow after it.

_ = result.plot("settling")

# %%
# For an experiment to come
# -------------------------
# The same for a task of one's own and one question: when did the person change? The answer ends in
# the estimator, ready to be fitted.

from skhoid.lab.studies import recommend_method

advice = recommend_method(
    "C4",
    0.15,
    question="detect",
    methods=["rls", "rls_smooth", "box_jenkins"],
    causal=True,
    n_replications=4,
    n_validation=1,
)
print(advice)

# %%
# The answer
# ----------
# It depends on the question, and the tournament says how much. For gains alone, recursive least
# squares with a memory that suits the experiment is hard to beat while a person steers; for the
# neuromuscular parameters its bias is far larger than its scatter, and a model of the remnant
# removes most of that. Afterwards, methods that see the whole run are better than any that do not,
# as long as the change has the form that they expect: a relapse defeats the sigmoid. And where
# nothing changes, a constant model is best.
