"""
How much is left to explain of two real people?
===============================================

One person follows a target on a screen; another balances a bicycle. A simple ARX model is fitted to
each. What does a comparison find in recordings whose truth nobody knows, and what does it say about
how much is left to explain?

Both recordings come with skhoid (A. Matic, 2022, doi:10.1101/2022.07.20.500761; P.D.L. de Lange
and J.K. Moore, doi:10.6084/m9.figshare.659465).
"""

# %%
# Four times the same target
# --------------------------
# Runs 2b to 2e show the same target, so they have a noise ceiling. (Frame times differ slightly, so
# the recorded targets differ by up to 3 %; ``repeats=True`` says that they are repeats.) The model
# was fitted to three other targets, and has no delay. Pixels are counted from the middle of the
# path.

from skhoid import ARXRegressor, compare, load_human_tracking


def recordings(names):
    X, y = load_human_tracking(names)
    middle = X["f_t"].groupby(level="run").transform("mean")
    X["f_t"] -= middle
    y -= middle
    return X, y


fitted = recordings(["phase-size 2a", "phase-size 3a", "phase-size 3b"])
repeats = recordings(["phase-size 2b", "phase-size 2c", "phase-size 2d", "phase-size 2e"])
undelayed = ARXRegressor(na=2, nb=2).fit(*fitted)
comparison = compare(undelayed, *repeats, estimation=fitted, repeats=True)
page = comparison.plot()

# %%
# All but 2 to 3 % of the movement is the same all four times: that is the ceiling for models driven
# by the target. This one explains 91 %, far below the ceiling.


def verdict(c):
    print(
        f"VAF {c.vaf:.1f} %, ceiling at least {c.noise_ceiling:.1f} %, "
        f"left to explain {c.explainable_gap:.1f} points"
    )


verdict(comparison)
for finding in comparison.findings:
    print(f"- {finding.title}")

# %%
# One finding is about the recording: at the start of one run the cursor stands still for half a
# second. (It does no harm here; the first seconds, in which the free run settles, are left out
# anyway.) Another says that the person is later than the model:

for finding in comparison.findings:
    if "later" in finding.title:
        print(finding)

# %%
# With a delay
# ------------
# As it advises, the delay is searched for by simulation, on the runs used for the fit:

from skhoid import DelaySearchCV

search = DelaySearchCV(ARXRegressor(na=2, nb=2), nk=range(21), criterion="vaf").fit(*fitted)
delayed = compare(search.best_estimator_, *repeats, repeats=True)
print(f"delay {search.best_delay_:.2f} s")
verdict(delayed)

# %%
# 2.6 points are gained, 4 are left. Where?

_ = delayed.plot("frequency")

# %%
# At most frequencies of the target, and most clearly near 8 rad/s: there the hand moves more than
# the target, and more than a second-order model can. And over amplitude:

_ = delayed.plot("amplitude")

# %%
# In fast movements the hand does not reach the speed that the model says (right panel), in either
# direction. Whether that is a limit of the arm or a person who cuts corners, these runs do not say.
#
# A ceiling needs repeats, or whole periods of a multisine. One of these runs alone has neither:

X, y = repeats
alone = compare(undelayed, X.loc[["phase-size 2b"]], y.loc[["phase-size 2b"]])
print(f"VAF {alone.vaf:.1f} %; noise ceiling, {alone.ceiling_note}")

# %%
# A rider
# -------
# One run of 60 s in which somebody balances a bicycle while being pulled sideways. A model of the
# rider's response to the roll angle, fitted to the first half, is compared with the second. The
# recording is used as it was published.

from sklearn.pipeline import make_pipeline

from skhoid import Decimator, load_bicycle_rider


def rider(**options):
    X, y = load_bicycle_rider(inputs=["RollAngle", "RollRate", "YawRate", "PullForce"], **options)
    early = X.index.get_level_values("time") < 30
    return (X[early], y[early]), (X[~early], y[~early])


first, second = rider(correct_units=False)
model = make_pipeline(Decimator(factor=4), ARXRegressor(inputs=["RollAngle"])).fit(*first)
comparison = compare(model, *second, roles={"PullForce": "dist"})
for finding in comparison.findings:
    print(finding)

# %%
# The roll rate is too small by π/180: it was converted from degrees to radians twice. A model that
# used it would not have complained; its gain on the roll rate would have been 57 times too large.
# With the units corrected, no problems are found in the channels:

_, corrected = rider()
for finding in compare(model, *corrected, roles={"PullForce": "dist"}).findings:
    print(finding.title)

# %%
# And the model? It explains 80 %. Whether the other 20 % are noise, nobody can say: there is only
# one run, no target, and the pulls do not repeat.

_ = comparison.plot("ceiling")

# %%
# The pulls come from outside the loop, so a residual that followed them would prove that there is a
# response that does not go through the roll angle, or that the modelled one is wrong. It does not
# follow them by more than chance:

_ = comparison.plot("correlation")

# %%
# The answer
# ----------
# The person at the screen is later than a model without delay. With the delay 4 points are still
# left, and the views say where to look: it is worth continuing. About the rider we learn that a
# channel is in the wrong unit, and that one run cannot tell misfit from noise: it is worth
# recording a second run with the same pulls.
