"""
How large must the model be?
============================

More lags always predict the next sample better. How many does a model of a person really need,
when it must simulate a run that it has not seen?

The data are four runs of one person who tracks the same target repeatedly (``"phase-size 2b"`` to
``"2e"``, 80 s each): the target is the input, the cursor the output.
"""

# %%
# All candidates at once
# ----------------------
# :class:`skhoid.OrderSearchCV` fits every combination of ``na``, ``nb`` and ``nk``, here on three
# runs at a time, and scores its simulation of the fourth. Pixels are counted from the middle of the
# target's path, because the model is not about the mean of the signals.

from skhoid import ARXRegressor, OrderSearchCV, load_human_tracking

X, y = load_human_tracking([f"phase-size 2{letter}" for letter in "bcde"])
middle = X["f_t"].mean()
X, y = X - middle, y - middle

search = OrderSearchCV(ARXRegressor(), na=range(1, 7), nb=range(1, 7), nk=[1, 4, 7, 10]).fit(X, y)
print(f"{len(search.cv_results_['params'])} models")

# %%
# The contours
# ------------
# One panel per delay; a star marks the highest VAF in each, a ring the chosen model.

from skhoid.plotting import VAFContourDisplay

_ = VAFContourDisplay.from_estimator(search)

# %%
# Models with a single lag of the input (bottom row) or of the output (left column) are the poorest;
# empty areas are models whose simulation explains nothing at all. Beyond two lags of each the
# surface is nearly flat. Some stars are at its edge, where the models have ten parameters or
# more, but they are hardly higher than their surroundings.

results = search.cv_results_
highest = results["mean_test_score"].argmax()
for name, index in (("highest VAF", highest), ("chosen", search.best_index_)):
    p = results["params"][index]
    print(
        f"{name}: ARX({p['na']}, {p['nb']}, {p['nk']}), {results['n_params'][index]} parameters, "
        f"VAF {results['mean_test_score'][index]:.2f} %"
    )
print(f"standard error of the highest: {search.standard_error_:.2f} %")

# %%
# The rule
# --------
# With four runs the VAF itself is uncertain. By default the search takes the smallest model within
# one standard error of the highest. The Bayesian information criterion asks a different question:
# it judges the prediction of the next sample and treats the errors of all 19,000 rows as
# independent.

by_bic = results["bic"].argmin()
p = results["params"][by_bic]
print(
    f"BIC: ARX({p['na']}, {p['nb']}, {p['nk']}), {results['n_params'][by_bic]} parameters, "
    f"VAF {results['mean_test_score'][by_bic]:.2f} %"
)

# %%
# The chosen model, refitted on all runs, on the first of them:

from skhoid.plotting import SimulationDisplay

_ = SimulationDisplay.from_estimator(search, X, y, runs="phase-size 2b")

# %%
# The answer
# ----------
# Four parameters are enough. ARX(2, 2, 1) explains 92.9 % of a run it has not seen (with a target
# that it has); the best of the 144 models needs ten parameters for 93.1 %, a difference well within
# the standard error of 0.7 %. The BIC takes twelve parameters to predict the next sample better,
# but its simulations are no better: choose by what the model is for.
