"""
How much should a recursion forget?
===================================

Two numbers decide what a recursion makes of the data: P0, which sets the weight of its initial
guess, and λ, which sets how fast it forgets. What does each of them do?

The figures are those of Figs. 5.14, 5.15 and 5.16 of the thesis, with new realisations of remnant.
"""

# %%
# The data
# --------
# As in Chapter 5 of the thesis: condition C1, nothing changes; first-order remnant of 15 %; an
# ARX(3, 4) model at 6.25 Hz, after a delay of 0.28 s.

# sphinx_gallery_thumbnail_number = 2
import numpy as np
from sklearn.pipeline import make_pipeline

from skhoid import ARXRegressor, Decimator, DelayShift, RecursiveARX, make_tracking_runs

X, y = make_tracking_runs("C1", n_runs=1, remnant_intensity=0.15, remnant_order=1, random_state=0)


def fitted(model):
    """The model at the end of a pipeline, fitted."""
    return make_pipeline(Decimator(16), DelayShift(0.28), model).fit(X, y)


batch = fitted(ARXRegressor(na=3, nb=4))
print(f"{len(X) // 16} samples, {batch[-1].dt_:.2f} s apart")

# %%
# P0: how much is a guess worth?
# ------------------------------
# No forgetting, a start from zeros, and P0 = p0 I. All paths should converge to the batch model.
# Two of the seven parameters are shown; without ``parameters=`` all are drawn.

from skhoid.plotting import ParametersDisplay

starts = {
    f"$P_0 = 10^{power}$ I": fitted(RecursiveARX(na=3, nb=4, init="zeros", p0=10.0**power))
    for power in (0, 2, 4, 6)
}
_ = ParametersDisplay.from_estimator({"batch": batch} | starts, parameters=["a1", "b0"])

# %%
# With a large P0 the first samples throw the estimates about, out of the panels; P0 = I holds them
# near zero to the end of the run: it counts as one sample of unit size for each parameter, and in
# the directions in which e and u hardly move all 512 samples weigh no more. Between 10^4 and 10^6
# there is no visible difference.

errors = batch[-1].standard_errors_
for name, model in starts.items():
    off = np.abs((model[-1].coef_ - batch[-1].coef_) / errors).max()
    print(f"{name.replace('$', '')}: at the end {off:.2g} standard errors from the batch model")

# %%
# λ: how long is the past?
# ------------------------
# A measurement that is k samples old has the weight λ^k, which falls to 1/e at the memory horizon
# N0 = 1 / (1 - λ).

import matplotlib.pyplot as plt

from skhoid.plotting import PALETTE

FACTORS = (0.9, 0.95, 0.99, 0.995, 1.0)
age = np.arange(256)
fig, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
for factor, color in zip(FACTORS, PALETTE, strict=False):
    horizon = 1 / (1 - factor) if factor < 1 else np.inf
    ax.plot(0.16 * age, factor**age, color=color, label=f"λ = {factor:g}, N0 = {horizon:g}")
ax.axhline(np.exp(-1), color=PALETTE[-1], lw=0.8, ls=":")
ax.set(xlabel="age, s", ylabel="weight", xlim=(0, 40), ylim=(0, 1.05))
_ = ax.legend()

# %%
# With forgetting
# ---------------
# P0 = 10^4 I, zeros, and three of these factors.

memories = {
    f"λ = {factor:g}": fitted(RecursiveARX(na=3, nb=4, forgetting=factor, init="zeros", p0=1e4))
    for factor in (0.95, 0.99, 1.0)
}
_ = ParametersDisplay.from_estimator({"batch": batch} | memories, parameters=["a1", "b0"])

# %%
# Nothing changes in this person, so all movement of the path is noise. Its scatter in the second
# half grows as the memory shrinks; in theory it equals that of a batch model of 2 N0 samples.

n = len(X) // 16
print("λ      N0   scatter of a_1   of a batch model of 2 N0 samples")
for name in ("λ = 0.95", "λ = 0.99"):
    arx = memories[name][-1]
    scatter = arx.coef_path_[n // 2 :, 0].std()
    expected = errors[0] * np.sqrt(n / (2 * arx.memory_horizon_ - 1))
    print(f"{name[4:]:5s} {arx.memory_horizon_:4.0f} {scatter:14.3f} {expected:18.3f}")

# %%
# The start is forgotten
# ----------------------
# With λ < 1 even the worst start is forgotten, sooner or later. The distance between two paths that
# begin at zeros and at 10 for every parameter, P0 = I:

fig, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
for factor, color in zip(FACTORS, PALETTE, strict=False):
    paths = [
        fitted(RecursiveARX(na=3, nb=4, forgetting=factor, init=start * np.ones(7), p0=1))[-1]
        for start in (0.0, 10.0)
    ]
    apart = np.abs(paths[0].coef_path_ - paths[1].coef_path_).max(axis=1)
    ax.semilogy(paths[0].time_path_, apart, color=color, label=f"{factor:g}")
ax.set(xlabel="time, s", ylabel="largest difference", xlim=(0, 81.92))
ax.grid(alpha=0.3)
_ = ax.legend(title="λ")

# %%
# The answer
# ----------
# P0 decides how the recursion starts, λ how it continues. From zeros use P0 = 10^4 I or more: it
# ends within 0.002 standard errors of least squares, P0 = I only within 5.5. (skhoid's default,
# which scales P0 with the power of the data, is also large where the start is zero.) With λ = 0.95
# a bad start fades within the run, with 0.99 and P0 = I it does not. And a memory of 20 samples,
# 3.2 s, scatters by 0.14 about an a_1 of -0.16: at this rate and with this remnant it is useless,
# as the thesis found for λ below 0.99. How much to forget where something does change is the next
# question, :ref:`sphx_glr_gallery_recursion_plot_memory_horizon.py`.
