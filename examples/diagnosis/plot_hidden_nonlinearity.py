"""
Does a person ignore small errors?
==================================

A linear model explains 76 % of what a person does who ignores errors below 0.4 deg, and 84 % of
what one does whose stick stops at 0.8 deg. The VAF alone reveals neither. What gives a dead zone
and a stop away?
"""

# %%
# Two people, simulated
# ---------------------
# A loop in a few lines: the person sees the error 0.2 s late, acts on what exceeds the dead zone
# through an arm of 10 rad/s, and adds remnant; the stick may have stops; its deflection is the
# velocity of the cursor. The effects are inside the loop, so they act on remnant too.

import numpy as np
import pandas as pd

from skhoid import Multisine

dt, n_samples, n_before = 0.01, 8192, 2048  # s, and samples of run-in
f_t = Multisine().sample(-n_before, n_before + n_samples, 1 / dt)  # deg


def beyond(e, threshold):
    """What of an error exceeds a threshold on either side."""
    return e - np.clip(e, -threshold, threshold)


def record(runs, gain, threshold=0.0, stop=np.inf):
    """Runs of the loop: X with e and f_t, y with u, and the person's answer without remnant."""
    white = np.stack([np.random.default_rng(run).standard_normal(f_t.size) for run in runs])
    e, u, answer = np.zeros((3, len(runs), f_t.size))
    arm, speed, remnant, cursor = np.zeros((4, len(runs)))
    for k in range(f_t.size):
        e[:, k] = f_t[k] - cursor
        force = gain * beyond(e[:, max(k - 20, 0)], threshold)
        speed += dt * (100 * (force - arm) - 10 * speed)
        arm = arm + dt * speed
        remnant = 0.9 * remnant + 0.087 * white[:, k]
        answer[:, k] = arm
        u[:, k] = np.clip(arm + remnant, -stop, stop)
        cursor = cursor + dt * 2 * u[:, k]
    time = np.arange(n_samples) * dt
    index = pd.MultiIndex.from_product([runs, time], names=["run", "time"])
    e, u, answer = (signal[:, n_before:].ravel() for signal in (e, u, answer))
    X = pd.DataFrame({"e": e, "f_t": np.tile(f_t[n_before:], len(runs))}, index=index)
    y = pd.Series(u, index=index, name="u")
    X.attrs["units"], y.attrs["units"] = {"e": "deg", "f_t": "deg"}, {"u": "deg"}
    return X, y, pd.Series(answer, index=index)


# %%
# The one who ignores small errors
# --------------------------------
# An ARX model fitted to five runs, compared with five others:

from skhoid import ARXRegressor, compare

X_fit, y_fit, _ = record(range(5), gain=1.2, threshold=0.4)
X, y, answer = record(range(5, 10), gain=1.2, threshold=0.4)
linear = ARXRegressor(nk=21, inputs=["e"]).fit(X_fit, y_fit)
comparison = compare(linear, X, y)

_ = comparison.plot("amplitude")

# %%
# Each panel sorts the residual by the value of a signal, and shows its mean. If the model lacked
# nothing, the means would stay inside the grey band, whatever the colour of the remnant. Here they
# make a zigzag over e: for small positive errors the hand does less than the model says, for large
# ones more. The linear model is a compromise between no response below the threshold and a strong
# one above. The same zigzag shows over all signals that correlate with e.

for finding in comparison.findings:
    if finding.name == "nonlinearity":
        print(finding)

# %%
# Other findings follow from it. A dead zone distorts, and a linear model that is so far off looks
# wrong in every view:

for finding in comparison.findings:
    if finding.severity > 0:
        print(f"{finding.severity:4.1f} points: {finding.title}")

# %%
# Add what the finding says
# -------------------------
# Now models whose input is the part of the error above a threshold, for several thresholds:

by_threshold = {0.0: comparison}
for threshold in (0.2, 0.4, 0.6):
    seen_fit, seen = (table.assign(seen=beyond(table["e"], threshold)) for table in (X_fit, X))
    model = ARXRegressor(nk=21, inputs=["seen"]).fit(seen_fit, y_fit)
    by_threshold[threshold] = compare(model, seen, y)
for threshold, c in by_threshold.items():
    print(
        f"{threshold:.1f} deg: VAF {c.vaf:.1f} %, ceiling at least {c.noise_ceiling:.1f} %, "
        f"left to explain {c.explainable_gap:.1f} points"
    )
truth = 100 * (1 - ((y - answer) ** 2).sum() / (y**2).sum())
print(f"true ceiling {truth:.1f} %")

# %%
# 0.4 deg, the true threshold, leaves hardly anything. The ceiling has risen by a point along the
# way: remnant moves the error in and out of the dead zone, and that part of the misfit differs from
# run to run, like noise. So the linear model's ceiling is a lower bound, as its note says:

print(comparison.ceiling_note)

# %%
# The amplitude view of the right model is flat, and all other findings have gone with the first:

_ = by_threshold[0.4].plot("amplitude")
for finding in by_threshold[0.4].findings:
    print(finding.title)

# %%
# The one whose stick stops
# -------------------------

X_fit, y_fit, _ = record(range(5), gain=1.0, stop=0.8)
X, y, _ = record(range(5, 10), gain=1.0, stop=0.8)
linear = ARXRegressor(nk=21, inputs=["e"]).fit(X_fit, y_fit)
comparison = compare(linear, X, y)
print(f"VAF {comparison.vaf:.1f} %")
_ = comparison.plot("amplitude")

# %%
# Now the zigzag is reversed: the response is weaker at large errors than at small ones. Saturation,
# a rate limit, or a person who avoids large deflections? The levels of u tell. A stop collects
# samples at one value, which nothing else does:

import matplotlib.pyplot as plt

from skhoid.plotting import ROLES

(at_level,) = (finding for finding in comparison.findings if finding.name == "level")
print(at_level)

fig, ax = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
simulated = comparison.traces["predicted"]
for u, role in ((y, ROLES["measured"]), (simulated, ROLES["simulated"])):
    look = {"color": role.colour, "label": role.word}
    ax.hist(u, np.linspace(-1.61, 1.61, 162), histtype="step", **look)
ax.set(xlabel="u, deg", ylabel="samples")
ax.grid(axis="y", alpha=0.3)
_ = ax.legend()

# %%
# The answer
# ----------
# Ignored small errors and clipped large ones leave opposite zigzags in the mean residual over
# amplitude, far beyond what remnant can do. Levels at which u stays tell a stop from a habit. With
# the dead zone in the model, 76 % become 87 %, and these runs show nothing else that is missing.
