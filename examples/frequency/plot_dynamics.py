"""
How does an operator adapt to the controlled element?
=====================================================

An element that behaves like 1/s is easy to control, one like 1/s² is not. What does a person change
between the two, and how much stability does the loop keep?

The figures are those of Figs. 6, 5.2 and 5.3 of the thesis.
"""

# %%
# Two elements, two operators
# ---------------------------
# Conditions C1 and C2 of the thesis (Table II). :class:`skhoid.FrequencyResponse` accepts anything
# that has a frequency response, here the physical objects themselves.

import numpy as np

from skhoid import FrequencyResponse, tracking_condition

omega = np.geomspace(0.1, 30, 400)  # rad/s
states = {"state 1, mostly 1/s": "C1", "state 2, mostly 1/s²": "C2"}
elements, operators = {}, {}
for label, name in states.items():
    condition = tracking_condition(name)
    print(condition.controlled_element)
    print(condition.operator)
    elements[label] = FrequencyResponse.of(condition.controlled_element, omega)
    operators[label] = FrequencyResponse.of(condition.operator, omega)

# %%
# Left: the controlled elements; right: the operators. In the band of 1 to 5 rad/s (grey) the second
# element falls off nearly twice as steeply and lags by 170 to 180 degrees instead of 100 to 130;
# the second operator compensates with a lead time of 1.2 s instead of 0.4 s. The peak at 11 rad/s
# is that of the arm.

import matplotlib.pyplot as plt

from skhoid.plotting import PALETTE, BodeDisplay


def side_by_side(panels, **options):
    """Two Bode plots with one legend."""
    fig, axes = plt.subplots(2, 2, figsize=(7.6, 5.4), sharex=True, layout="constrained")
    displays = []
    for (title, responses), column in zip(panels.items(), axes.T, strict=True):
        displays.append(BodeDisplay.from_responses(responses, ax=column, **options))
        column[0].set_title(title)
        handles, labels = column[0].get_legend_handles_labels()
        column[0].get_legend().remove()
        for ax in column:
            ax.axvspan(1, 5, color=PALETTE[-1], alpha=0.2, lw=0)
    axes[0, 1].set_ylabel("")
    axes[1, 1].set_ylabel("")
    fig.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
    return displays


_ = side_by_side({"controlled element": elements, "operator": operators})

# %%
# The loop
# --------
# The product of the two is the open loop, H / (1 + H) the closed one. ``view="open_loop"`` marks
# crossover frequency and phase margin.

loops = {label: operators[label] * elements[label] for label in states}
display = BodeDisplay.from_responses(loops, view="open_loop")
print(display.crossover_.round(2).to_string())

# %%
# Around crossover, both loops resemble an integrator with a delay, as the crossover model says. The
# closed loops:

_ = BodeDisplay.from_responses({label: loop.closed_loop() for label, loop in loops.items()})

# %%
# On the grid of the thesis
# -------------------------
# The thesis reads its figures at the multiples of 2π / 81.92 s, 0.077 rad/s apart;
# :func:`skhoid.crossover` solves for them.

from skhoid import crossover

grid = 2 * np.pi * np.arange(1, 230) / 81.92
for label, name in states.items():
    condition = tracking_condition(name)
    operator, element = condition.operator, condition.controlled_element
    omega_c, margin = crossover(operator, element)
    loop = FrequencyResponse.of(operator, grid) * element
    read = loop.crossover(interpolate=False).iloc[0]
    print(
        f"{label}: {omega_c:.2f} rad/s, {margin:.1f} deg; "
        f"on the grid {read['omega_c']:.2f} rad/s, {read['phase_margin']:.1f} deg"
    )

# %%
# The answer
# ----------
# The person trades gain for lead: K_e falls from 0.09 to 0.07, T_L rises from 0.4 s to 1.2 s. The
# double integrator is tracked at a crossover of 2.7 rad/s instead of 1.6 rad/s, but with a phase
# margin of 23 instead of 77 degrees: faster and closer to instability. (On the grid of the thesis
# these are 2.8 and 1.5 rad/s, 22.7 and 77.0 degrees.)
