"""
How do I try an effect by hand?
===============================

A search has named what a model lacks. Is it right? Take an effect away and add it again, look at
the trace, and see what it is good for, without writing a line for each trial.
"""

# %%
# Three recordings of a person who ignores errors below 0.3 deg and holds the stick off its centre:

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias, DeadZone

X, y = make_tracking_runs(
    "C1",
    n_runs=3,
    duration=50.0,
    sampling_rate=50.0,
    remnant_intensity=0.1,
    channels=["e", "x", "f_t"],
    effects=DeadZone(width=0.3) + Bias(level=0.05),
    random_state=0,
)
candidates = ["dead_zone", "cubic_gain", "saturation", "backlash", "bias", "tv_gain"]
search = EffectSearchCV(OperatorRegressor(), effects=candidates).fit(X, y)
print(search.summary())

# %%
# In a notebook this line shows the component, and the kernel computes: every effect can be added,
# and its numbers have sliders. On this page there is no kernel: here you have the combinations of
# the effects found. It opens with both: take one away, and drag over a plot to see where it fails.

search.explore()

# %%
# What was done by hand is a model like any other, and its script gives the same numbers:

from skhoid.lab.explore import Exploration

by_hand = Exploration(search.estimator, X, y, search=search)
by_hand.act("add", {"effect": "dead_zone"})
by_hand.act("add", {"effect": "bias"})
print(by_hand.script())

# %%
# Where a model that takes no effects fails, its comparison shows in the same way:

from skhoid import ARXRegressor, compare

compare(ARXRegressor(nk=15).fit(X, y), X, y).explore()

# %%
# The answer
# ----------
# ``search.explore()`` in a notebook, ``skhoid workbench run*.csv`` without one. Here the dead zone
# gains more beside the bias than alone, and both together reach the noise ceiling.
