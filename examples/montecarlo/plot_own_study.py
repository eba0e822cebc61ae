"""
How many runs does it take to see a change of 10 %?
===================================================

After some training, a person responds 10 % more strongly to an error. How many runs before and
after must you record to see that, and with how much remnant? A study of your own answers this in
seconds.
"""

# %%
# Two people
# ----------
# They differ by 10 % in K_e, and so in K_edot = K_e T_L.

from dataclasses import replace

from skhoid import HumanOperator, tracking_condition

condition = tracking_condition("C1")
before = replace(condition, name="before")
after = replace(condition, name="after", operator=HumanOperator(K_e=1.1 * 0.09, T_L=0.4))

# %%
# The study
# ---------
# A study is a table of conditions, a number of replications, and a function of one data set. Here a
# data set is a whole session of 12 runs, and the function returns a row for each. With
# ``batched=True`` it is given many sessions at once, as arrays of shape (runs, samples). An ARX(2,
# 2) model is then a line of linear algebra, and the study is quick; :class:`skhoid.ARXRegressor`
# would find the same, and is simpler when time does not matter.

import numpy as np

from skhoid import MonteCarloStudy, arx_to_operator

N_RUNS, N_SESSIONS, NK = 12, 50, 29


def gains(block):
    """K_e and K_edot of each run of each session."""
    e, u = block.record.e, block.record.u
    columns = (-u[:, NK:-1], -u[:, NK - 1 : -2], e[:, 1:-NK], e[:, : -NK - 1])
    regressors = np.stack(columns, axis=-1)
    theta = [np.linalg.lstsq(A, y)[0] for A, y in zip(regressors, u[:, NK + 1 :], strict=True)]
    values, _, _ = arx_to_operator(theta, dt=0.01)
    return {
        "replication": np.repeat(block.replications, block.n_runs),
        "run": np.tile(np.arange(block.n_runs), len(block.replications)),
        "K_e": values["K_e"],
        "K_edot": values["K_edot"],
    }


study = MonteCarloStudy(
    gains,
    {"condition": [before, after], "remnant_intensity": [0.05, 0.15, 0.30]},
    N_SESSIONS,
    n_runs=N_RUNS,
    simulation={"run_in": 20.0},  # s, enough for the loop to settle
    batched=True,
    random_state=0,
)
table = study.run()
print(table.head(3).to_string())

# %%
# How well is a gain known from one run? The interval is that of the mean over all runs.

from skhoid.lab.studies import summarize

columns = ["n", "mean", "sd", "low", "high"]
print(summarize(table, values=["K_e", "K_edot"])[columns].round(4).to_string())

# %%
# K_e is found within about 1 % on average, K_edot 4 to 7 % too high: that is the bias of remnant.
# But it is too high both before and after, so a *change* is still seen.
#
# Is it seen?
# -----------
# A t test compares the first n runs before with the first n after. Remnant is not the only reason
# why runs differ: people are not the same in each run. The second row of panels adds a scatter of 5
# % from run to run; since estimates follow the gain, it can be added to them.

import pandas as pd
from scipy.stats import ttest_ind

rng = np.random.default_rng(1)


def tested(name, scatter):
    """Whether each session shows the difference with p < 0.05, by number of runs."""
    wide = table.pivot(
        index=["remnant_intensity", "replication"], columns=["condition", "run"], values=name
    )
    wide = wide * np.exp(scatter * rng.standard_normal(wide.shape))
    found = {}
    for runs in (2, 3, 4, 6, 8, 12):
        sessions = (wide[when].to_numpy()[:, :runs] for when in ("before", "after"))
        found[runs] = ttest_ind(*sessions, axis=1).pvalue < 0.05
    return pd.DataFrame(found, index=wide.index).melt(
        var_name="runs", value_name="seen", ignore_index=False
    )


cells = {
    (name, scatter): tested(name, scatter) for scatter in (0, 0.05) for name in ("K_e", "K_edot")
}
tests = pd.concat(cells, names=["parameter", "scatter"]).reset_index()
cell = ["parameter", "scatter", "remnant_intensity", "runs"]
power = summarize(tests, by=cell, values="seen").droplevel("value").sort_index()
print((100 * power["mean"]).round().unstack("runs").to_string())

# %%
# ``summarize`` describes any column of any table by cell: here the share of sessions, with its
# interval.

import matplotlib.pyplot as plt

from skhoid.plotting import PALETTE

TITLES = {"K_e": "$K_e$", "K_edot": r"$K_{\dot e}$"}
fig, axes = plt.subplots(2, 2, figsize=(8, 5.6), sharex=True, sharey=True, layout="constrained")
for (name, scatter), ax in zip(cells, axes.flat, strict=True):
    for P_n, color in zip((0.05, 0.15, 0.30), PALETTE, strict=False):
        shown = 100 * power.loc[(name, scatter, P_n), ["mean", "low", "high"]].clip(0, 1)
        ax.plot(shown.index, shown["mean"], color=color, marker=".", label=f"{P_n:g}")
        ax.fill_between(shown.index, shown["low"], shown["high"], color=color, alpha=0.2)
    ax.axhline(80, color=PALETTE[-1], lw=0.8, ls=":")
    ax.set_title(f"{TITLES[name]}, people scatter by {100 * scatter:g} %", fontsize="medium")
    ax.grid(alpha=0.3)
axes[0, 0].legend(title="$P_n$")
for ax in axes[:, 0]:
    ax.set_ylabel("change seen, % of sessions")
for ax in axes[1]:
    ax.set_xlabel("runs before, and as many after")

# %%
# And is a change seen where there is none? Six runs of the first person against the other six, in
# all sessions:

same = table[table["condition"] == "before"]
same = same.pivot(index=["remnant_intensity", "replication"], columns="run", values="K_e")
seen = ttest_ind(same.to_numpy()[:, :6], same.to_numpy()[:, 6:], axis=1).pvalue < 0.05
print(f"{100 * seen.mean():.1f} % of {seen.size}")

# %%
# The answer
# ----------
# An operator who is the same in each run shows a change of 10 % in four of five sessions with two
# runs (K_e) or three (K_edot) before and as many after if remnant is 5 %, with four if it is 15,
# and with six if it is 30 %. People who themselves scatter by 5 % need six, eight, and about ten:
# then the person matters more than the remnant, and K_edot does as well as K_e, in spite of its
# bias. All of this is for ARX(2, 2) models at 100 Hz with the true delay; put your own rate,
# duration and forcing function into the table of conditions, and your own estimator into the
# function.
