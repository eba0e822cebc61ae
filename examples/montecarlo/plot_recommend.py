"""
Which memory should my experiment have?
=======================================

The experiment is still being planned: another vehicle, another target, 50 Hz. The recursion will
need a memory horizon, and 2.56 s is the answer to somebody else's question. What is it here?
"""

# %%
# The experiment as planned
# -------------------------
# A vehicle whose dynamics change half-way through runs of 60 s; a target of eight sines; and a
# person, about whom we have to guess: say that the crossover frequency goes from 1.3 to 2.4 rad/s,
# a second after the vehicle has changed.

# sphinx_gallery_thumbnail_number = 2
from skhoid import CompensatoryTask, ControlledElement, HumanOperator, Multisine, Sigmoid, crossover


def changes(before, after, time):
    return Sigmoid(before, after, rate=2.0, time=time)


vehicle = ControlledElement(K_c=changes(40, 20, 30.0), omega_b=changes(4.0, 0.5, 30.0))
person = HumanOperator(
    K_e=changes(0.12, 0.09, 31.0),
    K_edot=changes(0.05, 0.11, 31.0),  # s
    tau_e=0.25,
    omega_nm=10.0,
    zeta_nm=0.4,
)
target = Multisine(
    multiples=[2, 5, 9, 14, 21, 33, 52, 79],
    amplitudes=[1.2, 0.9, 0.7, 0.5, 0.3, 0.2, 0.1, 0.08],  # deg
    phases=[0.3, 2.1, 4.0, 1.1, 5.2, 3.3, 0.7, 2.9],
    period=60.0,
)
task = CompensatoryTask(
    controlled_element=vehicle,
    operator=person,
    target=target,
    duration=60.0,
    sampling_rate=50.0,
)
for t in (0.0, 60.0):
    frequency, margin = crossover(person.at(t), vehicle.at(t))
    print(f"at {t:g} s: crossover {frequency:.2f} rad/s, phase margin {margin:.0f} deg")

# %%
# Does it track? Always look at some runs before believing a study of them.

from skhoid import make_tracking_runs
from skhoid.plotting import TrackingDisplay

X, y, truth = make_tracking_runs(
    task,
    n_runs=1,
    remnant_intensity=0.2,
    channels=["e", "x", "f_t"],
    return_truth=True,
    random_state=0,
)
_ = TrackingDisplay.from_runs(X, y, truth=truth)

# %%
# The advice
# ----------
# Runs of this task are simulated and followed with all memory horizons, and each path is simulated
# on other runs.

from skhoid import recommend_forgetting

advice = recommend_forgetting(task, remnant_intensity=0.2, n_replications=30)
print(advice)
_ = advice.plot()

# %%
# What if I am wrong about the person?
# ------------------------------------
# The remnant, the speed of the change and its size are guesses. So ask again with others:

from dataclasses import replace


def slower(rate):
    later = {"rate": rate, "time": 31.0}
    gains = {"K_e": Sigmoid(0.12, 0.09, **later), "K_edot": Sigmoid(0.05, 0.11, **later)}
    return replace(task, operator=replace(person, **gains))


half = replace(
    task, operator=replace(person, K_e=changes(0.12, 0.105, 31), K_edot=changes(0.05, 0.08, 31))
)
guesses = {
    "as planned, P_n = 0.1": (task, 0.1),
    "as planned, P_n = 0.2": (task, 0.2),
    "as planned, P_n = 0.3": (task, 0.3),
    "adapts over 10 s": (slower(0.5), 0.2),
    "half the change": (half, 0.2),
    "half, and P_n = 0.35": (half, 0.35),
}
for name, (guess, P_n) in guesses.items():
    found = recommend_forgetting(guess, remnant_intensity=P_n, n_replications=15)
    also = ", ".join(f"{N0 / 50:.3g}" for N0 in found.close if found.memory_horizon != N0)
    print(
        f"{name:22s}: {found.memory_time:5.3g} s ({'also ' + also if also else 'no other'}), "
        f"{found.gain:+5.1f} points"
    )

# %%
# The answer
# ----------
# 128 samples, which at 50 Hz is 2.56 s again: 7 to 9 points better than no forgetting. Twice or
# half of that costs about a point, and none of the guesses moves it by more than a factor of two.
# That, more than the number, is what such a study is for: if the advice jumped from guess to guess,
# the person would have to be known first. With half the change, forgetting gains little, and then
# it hardly matters how much. This horizon is for single runs; several runs pooled allow a shorter
# one, :ref:`sphx_glr_gallery_recursion_plot_memory_horizon.py`.
