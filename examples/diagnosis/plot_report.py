"""
How do I show others what is missing?
=====================================

A search has found which effect a model lacks. How do you pass that on, with data, reasons and
doubts, to somebody who does not use Python?
"""

# %%
# Three recordings of a person who ignores errors below 0.3 deg, and some effects as candidates:

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs, report
from skhoid.effects import DeadZone

X, y = make_tracking_runs(
    "C1",
    n_runs=3,
    duration=50.0,
    sampling_rate=50.0,
    remnant_intensity=0.1,
    channels=["e", "f_t"],
    effects=DeadZone(width=0.3),
    random_state=0,
)
candidates = ["dead_zone", "cubic_gain", "saturation", "backlash", "bias", "tv_gain"]
search = EffectSearchCV(OperatorRegressor(), effects=candidates).fit(X, y)

# %%
# The report is one page: what the data are, where the model fails, which effect improves it and
# why, and what to do next. Click on a step of the staircase, or use the arrow keys.

page = report(
    search,
    X,
    y,
    title="What does this person not act upon?",
    source="Simulated runs of condition C1",
    made_with={"Random seed": "0"},
)
page

# %%
# ``page.save("report.html")`` writes it to a single file, to send by mail or keep with the data. On
# the command line ``skhoid diagnose run*.csv --report report.html`` does the same.
#
# Each picture is also available on its own:

from skhoid.plotting import SearchDisplay

_ = SearchDisplay.from_estimator(search)

# %%
# The answer
# ----------
# With one file that needs no network: ``report(search, X, y).save("report.html")``. Here it says
# that the model lacks a dead zone of 0.3 deg.
