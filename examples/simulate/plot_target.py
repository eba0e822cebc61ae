"""
What does the operator follow?
==============================

A target must look random, so that nobody learns it, and yet be known exactly, so that its
frequencies can be recognised in every signal. How do ten sine waves do both?

The figures are those of Figs. 5 and 5.1 of the thesis.
"""

# %%
# The target of Table I, in degrees of visual angle, is :class:`skhoid.Multisine` without arguments.
# Every frequency is a whole multiple of 2π / 81.92 s, so that each line completes its cycles within
# the measurement window.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from skhoid import Multisine

f_t = Multisine()
table = pd.DataFrame(
    {"n": f_t.multiples, "omega, rad/s": f_t.omega, "A, deg": f_t.amplitudes, "phi": f_t.phases}
)
print(table.round(3).to_string(index=False))

# %%
# Over time, and over frequency
# -----------------------------
# :func:`skhoid.auto_psd` takes the DFT of the whole window. With whole periods nothing leaks: all
# power is in ten bins.

from skhoid import auto_psd
from skhoid.plotting import PALETTE, ROLES

FOREGROUND, GREY = ROLES["measured"].colour, PALETTE[-1]
DT, PERIOD = 0.01, f_t.period
time = pd.Index(DT * pd.RangeIndex(8192), name="time")
target = pd.Series(f_t(time), index=time, name="f_t")
psd = auto_psd(target, forcing=f_t)
lines = psd[psd["excited"]]

fig, axes = plt.subplots(2, 1, figsize=(6.4, 5.6), layout="constrained")
axes[0].plot(target, color=FOREGROUND, lw=1.0)
axes[0].set(xlabel="time, s", ylabel="target $f_t$, deg", xlim=(0, PERIOD))
axes[1].vlines(lines["omega"], 1e-6, lines["psd"], color=GREY, lw=1.0)
axes[1].loglog(lines["omega"], lines["psd"], "o", color=PALETTE[1], label="excited lines")
axes[1].set(xlabel="frequency, rad/s", ylabel="PSD, deg² s/rad", xlim=(0.05, 314), ylim=(1e-6, 50))
axes[1].legend()
for ax in axes:
    ax.grid(alpha=0.3)

# %%
# The densities times the spacing of the bins add up to the variance that Table I is scaled for (the
# thesis divides by n - 1). Most of it is in the three lowest lines; the upper three, where the
# neuromuscular system shows, together hold about a thousandth of it.

spacing = 2 * np.pi / PERIOD  # rad/s
power = lines["psd"].to_numpy() * spacing
print(f"power of the lines {power.sum():.4f} deg², variance of the samples {target.var():.4f} deg²")
print(f"crest factor {f_t.crest_factor():.2f}")
print(f"three lowest lines {100 * power[:3].sum() / power.sum():.1f} %")
print(f"three highest lines {100 * power[-3:].sum() / power.sum():.2f} %")

# %%
# Other phases, other lines
# -------------------------
# With the same lines and other phases, every run has a new target with the same spectrum. Random
# phases give peaks of all sizes; the crest factor can be bounded. And a second forcing function,
# such as a disturbance, needs its own lines.

drawn = [f_t.with_random_phases(seed) for seed in range(200)]
crests = pd.Series([target.crest_factor() for target in drawn])
calm = f_t.with_random_phases(0, max_crest_factor=2.5)
disturbance = f_t.interleaved(scale=0.3, random_state=0)
print(f"crest factors of 200 draws: {crests.min():.2f} to {crests.max():.2f}")
print(f"crest factor of a draw that may have 2.5 at most: {calm.crest_factor():.2f}")
print(f"lines of the disturbance: {disturbance.multiples}")

fig, axes = plt.subplots(2, 1, figsize=(6.4, 4.4), sharex=True, layout="constrained")
titles = {
    f"least of 200 draws: crest factor {crests.min():.2f}": drawn[crests.idxmin()],
    f"largest of 200 draws: crest factor {crests.max():.2f}": drawn[crests.idxmax()],
}
for ax, (title, multisine) in zip(axes, titles.items(), strict=True):
    ax.plot(time, multisine(time), color=FOREGROUND, lw=1.0)
    ax.set(ylabel="target, deg", title=title, ylim=(-6, 6))
    ax.grid(alpha=0.3)
_ = axes[1].set(xlabel="time, s", xlim=(0, PERIOD))

# %%
# The answer
# ----------
# Ten sine waves of 0.23 to 17.6 rad/s, with a variance of 2.2490 deg² and a crest factor of 2.69.
# To the eye they are noise; to a Fourier transform over 81.92 s they are ten bins, and all that the
# bins between hold in a recorded signal is remnant.
