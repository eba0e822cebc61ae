"""
How much could any model explain?
=================================

A person is not a machine: shown the same target twice, the hand does not do the same twice. No
model predicts that part, the remnant. So there is a highest VAF that any model can reach, the
*noise ceiling*, and a VAF says little without it. How can it be estimated?

In a simulation the remnant n is known, and with it the true ceiling, 100 (1 - Σn²/Σu²).
"""

# %%
# Runs, models, and the truth
# ---------------------------
# Two conditions of the thesis, with remnant of 15 % of the variance of u. Of ten runs with the same
# target, five are used to fit a model, and five to compare it with.

import numpy as np
import pandas as pd

from skhoid import ARXRegressor, compare, make_tracking_runs, select_runs

comparisons, data, models, remnant = {}, {}, {}, {}
for condition in ("C1", "C2"):
    X, y, truth = make_tracking_runs(
        condition,
        n_runs=10,
        remnant_intensity=0.15,
        channels=["e", "f_t"],
        return_truth=True,
        random_state=0,
    )
    models[condition] = ARXRegressor(nk=29, inputs=["e"]).fit(*select_runs(X, y, first=5))
    data[condition] = select_runs(X, y, last=5)
    comparisons[condition] = compare(models[condition], *data[condition])
    remnant[condition] = truth.remnant


def true_ceiling(condition, comparison):
    """Of the rows that a comparison has scored."""
    traces = comparison.traces[comparison.traces["scored"]]
    n = remnant[condition].loc[traces.index]
    return 100 * (1 - (n**2).sum() / (traces["measured"] ** 2).sum())


# %%
# The tempting way: does u repeat?
# --------------------------------
# The target is the same in all runs. So take the mean of u over the runs as what can be explained,
# and deviations from it as noise:


def repeatability(u):
    """Share of the power of u that repeats, in percent, from its deviations between runs."""
    runs = u.to_numpy().reshape(u.index.unique("run").size, -1)
    noise = runs.var(axis=0, ddof=1).mean()
    return 100 * (1 - noise / np.mean(runs**2))


table = pd.DataFrame(
    {
        condition: {
            "true ceiling": true_ceiling(condition, c),
            "VAF of the model": c.vaf,
            "repeatability of u": repeatability(data[condition][1]),
        }
        for condition, c in comparisons.items()
    }
)
print(table.round(1).to_string())

# %%
# In both conditions the model explains *more* than what repeats. That is no contradiction: remnant
# goes round the loop. It moves the controlled element, appears in the error, and the person
# responds to it. This response differs from run to run, but it can be predicted, because e was
# measured.
#
# It shows between the lines of the spectrum. The target excites ten frequencies; everything in u at
# other frequencies is due to remnant. It is more than the remnant itself:

from skhoid import Multisine

for condition, (_, u) in data.items():
    runs = u.to_numpy().reshape(5, -1)
    power = (np.abs(np.fft.rfft(runs)) ** 2).sum(axis=0)
    lines = np.round(Multisine().omega * 81.92 / (2 * np.pi)).astype(int)
    between = 100 * (1 - power[lines].sum() / power.sum())
    n = 100 * (remnant[condition].loc[u.index] ** 2).sum() / (u**2).sum()
    print(
        f"{condition}: u holds {between:.0f} % of its power between the lines, remnant is {n:.0f} %"
    )

# %%
# The way that works: does the residual repeat?
# ---------------------------------------------
# The residual of a good model is the remnant; the response to it is part of the simulated output.
# What the model lacks repeats with the target, run after run; remnant does not. So the part of the
# *residual* that does not repeat is the noise, whatever the model lacks, as long as that is a
# response to the target. (The contribution of a linear error in the response to e is estimated and
# taken out first.)

for condition, c in comparisons.items():
    low, high = c.noise_ceiling_interval
    print(
        f"{condition}: ceiling {c.noise_ceiling:.1f} % ({low:.1f} to {high:.1f}), "
        f"true {true_ceiling(condition, c):.1f} %, VAF {c.vaf:.1f} %, "
        f"left to explain {c.explainable_gap:.1f} points"
    )

# %%

_ = comparisons["C2"].plot("ceiling")

# %%
# One run only
# ------------
# Without repeats, a periodic target helps: what the model lacks of the response to it lies at the
# excited lines, and between them there is only noise. This route is taken when there is only one
# run with a whole number of periods.

rows = []
for condition, (X, y) in data.items():
    singles = {run: compare(models[condition], X.loc[[run]], y.loc[[run]]) for run in range(5, 10)}
    for name, c in (singles | {"all": comparisons[condition]}).items():
        low, high = c.noise_ceiling_interval
        rows.append(
            {
                "condition": condition,
                "run": name,
                "route": c.ceiling_route,
                "truth": true_ceiling(condition, c),
                "ceiling": c.noise_ceiling,
                "low": low,
                "high": high,
            }
        )
table = pd.DataFrame(rows)
print(table.round(1).to_string(index=False))
inside = table["truth"].between(table["low"], table["high"])
print(f"\n{inside.sum()} of {len(table)} intervals contain the truth")

# %%

import matplotlib.pyplot as plt

from skhoid.plotting import ROLES

CEILING, TRUTH = ROLES["ceiling"], ROLES["truth"]
fig, axes = plt.subplots(1, 2, figsize=(8.0, 3.6), sharey=True, layout="constrained")
for ax, (condition, part) in zip(axes, table.groupby("condition"), strict=True):
    at = np.arange(len(part))
    half = part["ceiling"] - part["low"]
    ax.errorbar(
        at - 0.1,
        part["ceiling"],
        half,
        fmt="o",
        color=CEILING.colour,
        capsize=3,
        label=CEILING.word,
    )
    ax.plot(at + 0.1, part["truth"], "x", color=TRUTH.colour, mew=2, label=TRUTH.word)
    ax.set_xticks(at, part["run"])
    ax.set(title=condition, xlabel="run")
    ax.grid(axis="y", alpha=0.3)
axes[0].set_ylabel("highest VAF, %")
_ = axes[1].legend()

# %%
# The ceiling belongs to these particular runs: by chance remnant is larger in one than in another,
# and the truth moves along with the estimate. Five runs together give it most accurately.
# (Intervals of 95 % should contain the truth in 19 of 20 cases; those of single runs are rather
# too narrow.)
#
# No way at all
# -------------
# If every run has its own target, which is not periodic in the recording, there is no way to tell
# misfit from noise. Then there is no ceiling, and the comparison says so.

no_whole_period = data["C1"][0].index.get_level_values("time") < 70
X, y = (table[no_whole_period] for table in data["C1"])
c = compare(models["C1"], X.loc[[5]], y.loc[[5]])
print(c.ceiling_route, c.noise_ceiling, c.explainable_gap)
print(c.ceiling_note)

# %%
# (With the other runs, which share the target, the same 70 s have a ceiling again.)

c = compare(models["C1"], X, y)
print(f"{c.ceiling_route}: {c.noise_ceiling:.1f} %, true {true_ceiling('C1', c):.1f} %")

# %%
# The answer
# ----------
# Up to about 85 % in these runs, and a simple ARX model comes within a point or two of it. The
# repeatability of u would have put the ceiling at 77 and 59 %, below what the model reaches. So:
# compare the residual, not u; show the same target several times, or at least a periodic one; and
# quote a VAF with its ceiling.
