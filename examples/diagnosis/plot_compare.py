"""
Is a VAF of 77 % good?
======================

A person tracks a target. In the middle of each run the controlled element changes from 1/s to 1/s²,
and the person adapts. A constant model explains 77 % of what the hand did. Is the rest noise, or
does the model lack something? And if so, what?

The runs are simulated (condition C4 of the thesis, remnant of 15 % of the variance of u), so that
we can look up the truth at the end.
"""

# %%
# Compare
# -------
# Five runs to fit a model, and five others for the comparison. ``X`` has the error ``e``, which
# drives the model, and the target ``f_t``, which tells :func:`~skhoid.compare` that all runs share
# it.

from skhoid import ARXRegressor, compare, make_tracking_runs, select_runs

X, y, truth = make_tracking_runs(
    "C4",
    n_runs=10,
    remnant_intensity=0.15,
    channels=["e", "x", "f_t"],
    return_truth=True,
    random_state=0,
)
fitted, held_out = select_runs(X, y, first=5), select_runs(X, y, last=5)
model = ARXRegressor(na=2, nb=2, nk=29, inputs=["e"]).fit(*fitted)
comparison = compare(model, *held_out, estimation=fitted)
page = comparison.plot()

# %%
# The bar at the top sums up the answer. Blue is explained. Grey does not repeat when the same
# target is shown again: it is remnant, which no model can predict. Vermilion, between them,
# repeats: a better model could explain it.
#
# The panels below it show where. Most points are lost from 41 s on, but most of what repeats, the
# vermilion part of the bars, is lost before. In frequency, points are lost at those lines of the
# target that stand out above the remnant.
#
# In words
# --------

print(comparison.summary())

# %%
# Each finding comes with its evidence, what it means and what to do about it; the most expensive
# come first. Costs overlap, and one fault shows in many views: a response that grows in the middle
# of a run has a different gain from the model at most times, and looks like an effect of amplitude
# where amplitudes grow too. So change one thing, and compare again.
#
# Where in time
# -------------
# The upper panel divides the lost points among windows of the run. Vermilion is what repeats from
# run to run by more than chance: misfit. The rest is remnant, and there is more of it after 41 s.
# In the lower panel the grey band shows how the residual's power would vary by chance if nothing
# changed. Dashed lines are changes that a test finds, corrected for having looked everywhere.

_ = comparison.plot("time")

# %%
# ``by_time`` has the numbers; ``explainable`` is the part of ``share`` that repeats. ``gain`` is
# the gain of the person's response divided by the model's: the model is far too strong before the
# change, and a little too weak after it, where most of the power in the fit is.

windows = comparison.by_time.query("run == 'all'")
columns = ["start", "stop", "vaf", "share", "explainable", "gain", "sd_gain"]
print(windows[columns].round(2).to_string(index=False))

# %%
# Where in frequency
# ------------------
# The target excites ten lines (dots). At some of them the residual stands out above the noise, and
# also at some frequencies between them (curves): what repeats there cannot be explained by any
# constant linear model. Below: the response of the person and of the model, estimated with the
# target as the instrument.

_ = comparison.plot("frequency")

# %%
# In which runs
# -------------

_ = comparison.plot("runs")

# %%
# Run 8 has the lowest VAF, but is not unlike the others: its rms error is as small as theirs, and
# there was less to explain.
#
# The same over time and frequency together: red cells have more power than the average noise there,
# blue ones less, and dots mark cells beyond chance.

_ = comparison.plot("map")

# %%
# Do what the first finding says
# ------------------------------
# A model that follows the change:

from skhoid import RecursiveARX

path = RecursiveARX(na=2, nb=2, nk=29, inputs=["e"], memory_horizon=256).fit(*fitted)
followed = compare(path, *held_out, estimation=fitted)

for name, c in {"constant": comparison, "recursive": followed}.items():
    print(
        f"{name:10s} VAF {c.vaf:.1f} %, ceiling at least {c.noise_ceiling:.1f} %, "
        f"left to explain {c.explainable_gap:.1f} points"
    )
print()
for finding in followed.findings:
    print(finding.title)

# %%
# The change of the response has gone from the findings, and most of the others with it. What still
# changes at 41 s is the power of the remnant itself. That is correct: the gain of its filter grows
# to 2.6 times its value, and power grows with the square.

print(truth.parameters["K_n"].loc[[0.0, 81.91]].round(4).to_string())

# %%
# So the windows after 41 s still lose more than those before, but hardly any of it repeats:

_ = followed.plot("time")

# %%
# Run by run, both models against their ceilings:

import matplotlib.pyplot as plt

fig, axes = plt.subplots(1, 2, figsize=(10, 3.6), sharey=True, layout="constrained")
_ = comparison.plot("runs", ax=axes[0])
_ = followed.plot("runs", ax=axes[1])
axes[0].set_title("constant")
_ = axes[1].set_title("recursive")

# %%
# What the simulator knows
# ------------------------
# The remnant of these runs is known here, and with it the highest VAF that a model could have
# reached on the rows that were scored: 100 (1 - Σn²/Σu²).

scored = followed.traces["scored"]
u, n = held_out[1][scored], truth.remnant.loc[held_out[0].index][scored]
print(f"true ceiling {100 * (1 - (n**2).sum() / (u**2).sum()):.1f} %")

# %%
# Both ceilings are within a point of it, and that of the better model is closer. Remnant goes round
# the loop into e, and the person responds to it. A model's error in *that* response differs from
# run to run, like noise. This is allowed for as far as the person responds to e linearly and
# changes slowly; the rest counts as noise. So the ceiling estimated with a model is a lower bound,
# and rises as the model gets better.
#
# The answer
# ----------
# 77 % is not good: about 6 points could still be gained, and one finding, a response that grows
# near 41 s, says how. A recursive model gains most of them. Of the 18 % that it does not explain,
# all but a point or two are remnant.
