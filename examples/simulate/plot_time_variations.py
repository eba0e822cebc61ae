"""
Sudden, linear or gradual?
==========================

A person does not turn from one controller into another at once. In which ways can a parameter
change within a run, and how long does a change really last?

The figures are those of Figs. 2, 3.2, 3.3 and 3.4 of the thesis.
"""

# %%
# One transition
# --------------
# :class:`skhoid.Sigmoid` has two numbers besides its values: the rate G and the time t_M at which
# half of the change has happened. Here the rates between the gradual and the sudden transition of
# the thesis, on a scale from the initial to the final value.

import matplotlib.pyplot as plt
import numpy as np

from skhoid import Mixture, Ramp, Sigmoid, Step
from skhoid.plotting import PALETTE, ROLES

T_M = 40.96  # s, the middle of the measurement window
RATES = [0.1, 0.25, 0.5, 1.0, 10.0, 100.0]  # 1/s
t = np.arange(8192) / 100
*COLORS, GREY = PALETTE

fig, ax = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
for rate, color in zip(RATES, COLORS, strict=True):
    ax.plot(t, Sigmoid(0.0, 1.0, rate=rate, time=T_M)(t), color=color, label=f"{rate:g}")
ax.axvline(T_M, color=GREY, lw=0.8)
ax.axvspan(T_M - 10.24, T_M + 10.24, color=GREY, alpha=0.2, lw=0)
ax.set(xlabel="time, s", ylabel="parameter p(t)", xlim=(0, 81.92))
ax.set_yticks([0, 0.5, 1], ["$p_i$", "$(p_i + p_f)/2$", "$p_f$"])
_ = ax.legend(title="G, 1/s")

# %%
# From 10 % to 90 % it takes 2 ln 9 / G. The grey band is the window of 20.48 s around t_M in which
# the thesis judges its estimates; the slowest transition does not fit in, and that with G = 10 1/s
# lasts less than half a second.

for rate in RATES:
    done = Sigmoid(0.0, 1.0, rate=rate, time=T_M)(t)
    print(
        f"G = {rate:5g} 1/s: 10 to 90 % in {2 * np.log(9) / rate:6.2f} s, "
        f"{100 * (done[5120] - done[3072]):5.1f} % of it in the band"
    )

# %%
# The same with numbers for another parameter, over t_M and over G:

fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.2), sharey=True, layout="constrained")
for time, color in zip([30, 40, 50, 60, 70], COLORS, strict=False):
    axes[0].plot(Sigmoid(0.1, 0.4, rate=0.5, time=time)(np.arange(101)), color=color, label=time)
for rate, color in zip([0.1, 0.25, 0.5, 1, 10], COLORS, strict=False):
    seconds = np.linspace(0, 100, 2001)
    axes[1].plot(seconds, Sigmoid(0.1, 0.4, rate, 50.0)(seconds), color=color, label=rate)
axes[0].set(xlabel="time, s", ylabel="parameter P(t)", title="G = 0.5 1/s")
axes[1].set(xlabel="time, s", title="$t_M$ = 50 s")
axes[0].legend(title="$t_M$, s")
_ = axes[1].legend(title="G, 1/s")

# %%
# Linear in the parameters, not in the response
# ---------------------------------------------
# Zaal and Sweet (2011) let four parameters change linearly between two instants: gain and time
# constant of the controlled element K_c / (s (T_c s + 1)), and gain and lead of the operator, who
# always cancels the lag: T_L = T_c. Their pattern with :class:`skhoid.Ramp`, in numbers of our own.
# skhoid writes the element with omega_b = 1 / T_c, which is then no ramp but any function of time.

from skhoid import ControlledElement, HumanOperator, crossover

t1, t2 = 30.0, 50.0
T_c, K = Ramp(0.2, 1.0, t1, t2), Ramp(15.0, 30.0, t1, t2)
element = ControlledElement(K_c=lambda t: K(t) / T_c(t), omega_b=lambda t: 1 / T_c(t))
operator = HumanOperator(K_e=Ramp(0.10, 0.05, t1, t2), T_L=T_c)

fig, axes = plt.subplots(2, 2, figsize=(7.2, 4.4), sharex=True, layout="constrained")
ramps = {"$T_c = T_L$, s": T_c, "$K_c$, 1/s": K, "$K_e$": operator.K_e}
curves = {**ramps, r"$\omega_b = 1/T_c$, rad/s": element.omega_b}
for ax, (label, curve) in zip(axes.ravel(), curves.items(), strict=True):
    ax.plot(t, curve(t), color=COLORS[0])
    ax.set(ylabel=label, xlim=(0, 81.92))
    ax.set_xticks([0, t1, t2, 81.92], ["0", "$t_1$", "$t_2$", "$T_m$"])
    ax.grid(alpha=0.3)

# %%
# The loop is a single integrator with gain K_c K_e throughout, so its crossover frequency is that
# product (but for the neuromuscular dynamics): the same at both ends, and 13 % higher half-way.

for instant in (0.0, 40.0, 80.0):
    omega_c, margin = crossover(operator.at(instant), element.at(instant))
    print(f"{instant:2.0f} s: crossover {omega_c:.2f} rad/s, phase margin {margin:.0f} deg")

# %%
# There and back
# --------------
# Olivari and others (2016) mix two sets of dynamics with a control mode CM(t) between 0 and 1 that
# steps twice and ramps twice. :class:`skhoid.Mixture` switches between pieces:

pulse = Mixture(Step(0, 1, 10), Step(1, 0, 25), weight=Step(0, 1, 20))
hump = Mixture(Ramp(0, 1, 40, 50), Ramp(1, 0, 60, 75), weight=Step(0, 1, 55))
mode = Mixture(pulse, hump, weight=Step(0, 1, 30))

# %%
# :func:`skhoid.mixed_condition` applies it to every parameter of two conditions, and the loop can
# be simulated at once. (Eq. 3.7 mixes transfer functions; skhoid mixes their parameters, so that
# there is one operator at every instant.)

from skhoid import make_tracking_runs, mixed_condition

X, y, truth = make_tracking_runs(mixed_condition("C1", "C2", mode), 1, return_truth=True)

fig, axes = plt.subplots(3, 1, figsize=(6.4, 5.2), sharex=True, layout="constrained")
axes[0].plot(t, mode(t), color=COLORS[0])
axes[0].set(ylabel="control mode")
axes[1].plot(truth.parameters["K_edot"], color=COLORS[0], label=r"$K_{\dot e}$, s")
axes[1].plot(truth.parameters["K_e"], color=COLORS[1], label="$K_e$")
axes[1].set(ylabel="operator's gains")
axes[1].legend(loc="center", bbox_to_anchor=(0.4, 0.5))
axes[2].plot(t, y, color=ROLES["measured"].colour, lw=0.8)
axes[2].set(xlabel="time, s", ylabel="control u, deg", xlim=(0, 81.92))
for ax in axes:
    ax.grid(alpha=0.3)

# %%
# The answer
# ----------
# Sudden is a sigmoid with G = 10 1/s or more (0.44 s), gradual one with G = 0.5 1/s (8.8 s). A
# linear change of parameters does not change the loop linearly: with 15 to 30 1/s against 0.10 to
# 0.05 its crossover rises and comes back. And any pattern, even any function of an array of
# seconds, is a parameter like another.
