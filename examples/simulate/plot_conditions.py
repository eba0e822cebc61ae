"""
Do the signals show that the operator has changed?
==================================================

The element that a person controls changes from 1/s to 1/s² in mid-run, slowly or at once, and the
person adapts. How much of that can be seen in the error, the control output and the element's
output?

The figures are those of Fig. 7 and Appendix E (E.2 to E.14) of the thesis: conditions C1 to C6
without remnant.
"""

# %%
# Six conditions
# --------------
# C1 and C2 do not vary; C3 and C4 go from the one to the other gradually (G = 0.5 1/s) and suddenly
# (100 1/s), at 40.96 s; C5 and C6 go back. Without remnant all runs are the same, so one is enough.
# :func:`skhoid.make_tracking_runs` also gives the truth behind it.

from skhoid import make_tracking_runs

T_M = 40.96  # s
runs = {
    name: make_tracking_runs(name, 1, channels=["e", "x", "f_t"], return_truth=True)
    for name in ("C1", "C2", "C3", "C4", "C5", "C6")
}

# %%
# Slowly and at once
# ------------------
# Error and control output in the window of 20.48 s around the transition, for C3 and C4.

import matplotlib.pyplot as plt

from skhoid.plotting import PALETTE, ROLES

fig, axes = plt.subplots(2, 1, figsize=(6.4, 5.0), sharex=True, layout="constrained")
for name, color in zip(("C3", "C4"), PALETTE, strict=False):
    X, y, _ = runs[name]
    axes[0].plot(X.loc[0, "e"], color=color, lw=1.2, label=name)
    axes[1].plot(y.loc[0], color=color, lw=1.2, label=name)
axes[0].set(ylabel="error e, deg")
axes[1].set(xlabel="time, s", ylabel="control u, deg", xlim=(30.72, 51.2), ylim=(-0.6, 0.6))
for ax in axes:
    ax.axvline(T_M, color=PALETTE[-1], lw=1.0)
    ax.grid(alpha=0.3)
_ = axes[0].legend()

# %%
# The two coincide at the beginning and again at the end. In between, following the transition, the
# difference in u is as large as u itself.

difference = (runs["C3"][1] - runs["C4"][1]).loc[0]
shown = difference.loc[30.72:51.2]
print(f"largest difference in u: {shown.abs().max():.3f} deg at {shown.abs().idxmax():.2f} s")
print(f"standard deviation of u: {runs['C4'][1].loc[0].loc[30.72:51.2].std():.3f} deg")

# %%
# The whole measurement window
# ----------------------------
# The target is the same in all of them; on the right is its part in the transition window.

fig, axes = plt.subplots(1, 2, figsize=(7.2, 2.6), sharey=True, layout="constrained")
for ax, window in zip(axes, ((0, 81.92), (30.72, 51.2)), strict=True):
    ax.plot(runs["C1"][0].loc[0, "f_t"], color=ROLES["measured"].colour, lw=1.0)
    ax.set(xlabel="time, s", xlim=window)
    ax.grid(alpha=0.3)
_ = axes[0].set_ylabel("target $f_t$, deg")

# %%
# Each pair of conditions side by side, drawn by :class:`skhoid.plotting.TrackingDisplay`; the
# dotted line is where the parameters change fastest.

from skhoid.plotting import TrackingDisplay


def draw(pair, window):
    """Error, output and control of two conditions, on the same scales."""
    _, axes = plt.subplots(
        3, 2, figsize=(7.6, 5.2), sharex=True, sharey="row", layout="constrained"
    )
    for name, column in zip(pair, axes.T, strict=True):
        X, y, _ = runs[name]
        options = {"window": window, "ax": column}
        transition = None if name in ("C1", "C2") else T_M
        TrackingDisplay.from_runs(X[["e", "x"]], y, transition=transition, **options)
        column[0].set_title(name)
        if column[0].get_legend():  # it would hide the error
            column[0].get_legend().remove()
    for ax in axes[:, 1]:
        ax.set_ylabel("")


# %%
# Constant dynamics: with 1/s² the control output is more than twice as large and much quicker, for
# almost the same error.

draw(("C1", "C2"), (0, 81.92))

# %%
# From 1/s to 1/s², slowly and suddenly: the left half is C1, the right half C2.

draw(("C3", "C4"), (0, 81.92))

# %%
# And back:

draw(("C5", "C6"), (0, 81.92))

# %%
# The transition window
# ---------------------
# The same in the 20.48 s around the transition.

draw(("C1", "C2"), (30.72, 51.2))

# %%

draw(("C3", "C4"), (30.72, 51.2))

# %%

draw(("C5", "C6"), (30.72, 51.2))

# %%
# How large are they?
# -------------------
# Spread of the signals in the two halves of the run:

import pandas as pd

rows = {}
for name, (X, y, _) in runs.items():
    late = y.index.get_level_values("time") >= T_M
    rows[name] = {
        "std e, 1st half": X["e"][~late].std(),
        "2nd half": X["e"][late].std(),
        "std u, 1st half": y[~late].std(),
        "2nd half ": y[late].std(),
    }
print(pd.DataFrame(rows).T.round(3).to_string())

# %%
# The answer
# ----------
# The error does not: its spread hardly depends on the dynamics, because the operator adapts. The
# control output does: it more than doubles with 1/s². But whether the change was slow or sudden
# shows for a few seconds only, and only in comparison with a run of the other kind. Seeing more in
# a single run takes a model whose parameters vary.
