"""
What do six people share, and who differs?
==========================================

Six people tracked a target in two conditions. Is there an effect that most of them have? Who has
it not? Does a parameter differ between the conditions?
"""

# %%
# The recordings are simulated here, so that the truth is known: the movements of all but S6 end at
# 1.1 standard deviations. Of files, :func:`skhoid.read_experiment` makes the same table.

from skhoid import simulate_experiment

X, y = simulate_experiment(
    6,
    ["C1", "C2"],
    runs=2,
    duration=25.0,
    run_in=5.0,
    sampling_rate=50.0,
    remnant_intensity=0.1,
    random_state=3,
)
for who in ("S1", "S2", "S3", "S4", "S5"):
    rows = y.index.get_level_values("subject") == who
    limit = 1.1 * y[rows].std()
    y[rows] = y[rows].clip(-limit, limit)

# %%
# First of all: does anything look wrong in the recordings?

from skhoid import check_experiment

check = check_experiment(X, y)
check

# %%
# What do they share?
# -------------------
# A search for each person in each condition, and then the evidence of all of them together. Two
# candidates are enough here; ``effects="all"`` is the whole catalogue.

from skhoid import EffectSearchCV, GroupEffectSearch, OperatorRegressor

search = EffectSearchCV(OperatorRegressor(), effects=["dead_zone", "saturation"])
group = GroupEffectSearch(search).fit(X, y)
group.summary()

# %%
# A column for each person; the darker, the more probable. A dot is where the runs of that person
# alone name the effect. Right, the share of people who have it, with its interval.

_ = group.plot()

# %%
# Parameters
# ----------
# Each run is identified with the effect that the group has, which would else bend the others.

from skhoid import identify_people
from skhoid.plotting import PeopleDisplay

people = identify_people(OperatorRegressor().with_effect("saturation"), X, y)
_ = PeopleDisplay.from_result(people)

# %%
# A mixed model compares the conditions: runs of one person are no independent measurements.

from skhoid.lab.experiment import mixed_model

lead = mixed_model(people.table, "T_L")
lead.summary()

# %%
# The means over people, and people as thin lines:

from skhoid.plotting import GroupMeansDisplay

_ = GroupMeansDisplay.from_result(lead)

# %%
# For others
# ----------
# All rows for R, with a script that makes the same model there:

from tempfile import mkdtemp

from skhoid.lab.experiment import write_long

folder = mkdtemp()
[path.name for path in write_long(lead, folder)]

# %%
# And all of it on one page, with a part for each person:

from skhoid.lab.report import report_experiment

page = report_experiment(
    group,
    X,
    y,
    people=people,
    check=check,
    title="Six people in two conditions",
    source="Simulated",
)
page

# %%
# The answer
# ----------
# The summary of the group names saturation, and who has it not; the mixed model says by how much
# the lead time differs. ``page.save("experiment.html")`` is the file to send; on the command line
# ``skhoid experiment recordings/`` makes it.
