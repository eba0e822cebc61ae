"""
When no name fits: the shape of what is missing
===============================================

A catalogue of effects ends somewhere. Here a person's attention comes and goes in waves, which no
effect of the catalogue does. What can a search still say, and what can one do with it?
"""

# %%
# The measurement
# ---------------
# The gains rise and fall by 60 % with a period of 22 s. That is an effect of our own, for the
# simulation alone; what follows uses only the recordings.

# sphinx_gallery_thumbnail_number = 1
import matplotlib.pyplot as plt
import numpy as np

from skhoid import make_tracking_runs
from skhoid.effects import Dimension, Effect, Parameter


class Waves(Effect):
    """Attention comes and goes."""

    name = "waves"
    place = "gain"
    parameters = (
        Parameter("depth", Dimension(), 0.0, 1.0, (0.3,)),
        Parameter("period", Dimension(s=1), 5.0, 100.0, (20.0,)),
    )

    def apply(self, signal, record, depth, period):
        return signal.times(1 + depth * np.sin(2 * np.pi * record.t / period))


def recorded(n_runs, seed):
    return make_tracking_runs(
        "C1",
        n_runs,
        duration=50.0,
        sampling_rate=50.0,
        remnant_intensity=0.1,
        channels=["e", "f_t"],
        effects=Waves(depth=0.6, period=22.0),
        random_state=seed,
    )


X, y = recorded(4, 2)

# %%
# The search
# ----------
# It tries the whole catalogue. Some effects imitate part of what is missing, none explains it:

from skhoid import EffectSearchCV, OperatorRegressor

search = EffectSearchCV(OperatorRegressor()).fit(X, y)
print(search.summary())

# %%
# The shape
# ---------
# So curves that the data choose were tried in place of names, at every place where something can
# act. One is left, with its place, and a band that holds the whole curve with a probability of
# 95 %. The truth, which a real person would not tell, is drawn over it:

from skhoid.plotting import ROLES, EffectDisplay

display = EffectDisplay.from_shape(search)
curve = search.shape_.curve
wave = 1 + 0.6 * np.sin(2 * np.pi * curve.index.to_numpy() / 22.0)
wave *= curve["value"].mean() / wave.mean()  # the level is that of the gains
(truth,) = display.ax_.plot(curve.index, wave, **ROLES["truth"].style())
_ = display.ax_.legend([truth], [ROLES["truth"].word])

# %%
# The error falls
# ---------------
# ``shape_.estimator`` is the model with the curve. On new runs its residual hardly changes over the
# time, while that of the linear model rises and falls:

X_new, y_new = recorded(4, 3)
models = {"baseline": search.baseline_, "with the shape": search.shape_.estimator}
for name, model in models.items():
    print(f"{name}: VAF {model.score(X_new, y_new):.1f} %")

figure, panel = plt.subplots(figsize=(7.0, 3.2), layout="constrained")
for (name, model), line in zip(models.items(), ("--", "-"), strict=True):
    squares = (y_new - model.predict(X_new)) ** 2
    second = squares.index.get_level_values("time") // 2 * 2 + 1
    by_time = np.sqrt(squares.groupby(second).mean())
    panel.plot(by_time, **ROLES["residual"].style(ls=line), label=name)
panel.set(xlabel="time in the run, s", ylabel="RMS residual, deg", ylim=(0, None))
panel.grid(alpha=0.3)
_ = panel.legend()

# %%
# The answer
# ----------
# The search names nothing that is not there. It says where something acts (on the gains, over the
# time in the run), draws its curve, and gives a model that explains 91 % of new runs instead of 72.
# The period of the wave can be read from the curve; an effect with such a formula is the next step.
