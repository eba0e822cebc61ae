"""
What is this person doing that the model does not know?
=======================================================

Three recordings of a person who tracks a target. A linear model of the operator explains 72 % of
what the hand does. Is the rest noise? If not, what is it? From the measurement to two named effects
with their parameters, with the error falling at each step.
"""

# %%
# The measurement
# ---------------
# Two of four effects are hidden in a simulated person, drawn with a seed chosen to give a pair that
# shows well. What follows uses only the recordings: the error ``e``, the target ``f_t`` and the
# stick ``u``.

# sphinx_gallery_thumbnail_number = 4
import numpy as np

from skhoid import make_tracking_runs
from skhoid.effects import Bias, DeadZone, Saturation, TimeVaryingGain

effects = [
    DeadZone(width=0.3),
    Saturation(limit=0.1),
    Bias(level=0.05),
    TimeVaryingGain(K_e_change=-0.4, K_edot_change=0.8, rate=2.0, time=25.0),
]
first, second = np.random.default_rng(11).choice(len(effects), 2, replace=False)
hidden = effects[first] + effects[second]  # not shown before the end

X, y, truth = make_tracking_runs(
    "C1",
    n_runs=3,
    duration=50.0,
    sampling_rate=50.0,
    remnant_intensity=0.1,
    channels=["e", "f_t"],
    effects=hidden,
    random_state=2,
    return_truth=True,
)
print(X.head(3))

# %%
# A model
# -------
# An operator with gain, lead, delay and arm, constant in time, with parameters estimated by maximum
# likelihood:

from skhoid import OperatorRegressor

model = OperatorRegressor().fit(X, y)
print(model.parameters_[["value", "sd", "unit"]].round(3))

# %%
# Given the error, it simulates the stick. Measured and simulated are similar, but not the same:

from skhoid.plotting import SimulationDisplay

_ = SimulationDisplay.from_estimator(model, X, y, runs=0)

# %%
# Where does it fail?
# -------------------
# :func:`skhoid.compare` shows how much of the difference is remnant, which no model explains, and
# where the rest is:

from skhoid import compare

comparison = compare(model, X, y)
page = comparison.plot()

# %%
# A better model can gain at least 12 points: that much of the residual is the same in every run. It
# is not spread evenly over all errors, nor over all times:

for finding in comparison.findings[:3]:
    print(f"- {finding.title}")

# %%
# These are symptoms, and a model that is wrong in one way looks wrong in others too. Which physical
# effect is behind them?
#
# Which effect is it?
# -------------------
# The search adds each effect of the catalogue to the model, refits all parameters, and judges the
# result on held-out runs. It adds the best effect and starts again, until none helps:

from skhoid import EffectSearchCV

search = EffectSearchCV(OperatorRegressor()).fit(X, y)
print(search.summary())

# %%
# All candidates of the first step, and how certain the first place is: the title says how far
# behind the runner-up is. Effects whose channels were not recorded do not apply:

from skhoid.plotting import SearchDisplay

_ = SearchDisplay.from_estimator(search, "ranking", step=1)

# %%
# The error falls
# ---------------
# Step by step, on runs that the model has not seen, down to the remnant:

print(search.error_path_[["effect", "vaf", "rmse", "explainable_gap"]].round(3))
_ = SearchDisplay.from_estimator(search)

# %%
# Measured and simulated stick before and after, where the effects help most:

_ = SearchDisplay.from_estimator(search, "steps")

# %%
# The effects themselves
# ----------------------
# Each has parameters with units and standard errors. The threshold, and the errors that occurred:

from skhoid.plotting import EffectDisplay

_ = EffectDisplay.from_estimator(search, "dead_zone", X)

# %%
# And the gains, which change during the run:

_ = EffectDisplay.from_estimator(search, "tv_gain", X)

# %%
# Against the truth
# -----------------
# Now we look at what was drawn. Nothing else was hidden, so the best possible model is the person's
# own response, without remnant. (These runs are a good case: three sets of recordings were tried,
# and all gave the same two names, but one put the change 3 standard errors too early.)

print(hidden)
columns = ["value", "sd", "low", "high", "unit"]
print(search.best_estimator_.parameters_.loc["dead_zone__width":"tv_gain__time", columns].round(3))
best = 100 * (1 - (truth.remnant**2).sum() / (y**2).sum())
print(f"held-out VAF {search.error_path_['vaf'].iloc[-1]:.1f} %, of the true response {best:.1f} %")

# %%
# And where nothing is hidden?
# ----------------------------
# The same person without effects, and the same four candidates:

X_plain, y_plain = make_tracking_runs(
    "C1", 3, duration=50.0, sampling_rate=50.0, remnant_intensity=0.1, random_state=3
)
names = [effect.name for effect in effects]
plain = EffectSearchCV(OperatorRegressor(), effects=names).fit(X_plain, y_plain)
print(plain.verdict_)

# %%
# The answer
# ----------
# This person ignores errors below 0.3 deg, and changes gain and lead half-way through the run. Both
# effects are named from the recordings alone, and their parameters are here within two standard
# errors of the truth. With them the held-out VAF rises from 72 to 91 %, within half a point of what
# the person's own response explains; the other 9 % are remnant. Where nothing is hidden, the search
# finds nothing.
