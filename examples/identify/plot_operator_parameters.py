"""
How does the operator change during a run?
==========================================

In condition C4 the controlled element suddenly changes from a single to a double integrator. What
gain, lead and neuromuscular mode does the person have before and after? Five simulated runs, whose
truth is known, show how well ten-second windows can tell.
"""

# %%
# Runs with 5 % remnant that has passed the neuromuscular filter, the kind that suits ARX models
# best (see :ref:`sphx_glr_gallery_simulate_plot_remnant_bias.py` for other kinds).

from skhoid import ARXRegressor, make_tracking_runs, operator_parameters

X, y, truth = make_tracking_runs(
    "C4", n_runs=5, remnant_intensity=0.05, remnant_order="nm", return_truth=True, random_state=0
)

# %%
# One ARX model for each window, all runs together. Under zero-order hold its parameters are those
# of an operator (Eqs. 22-23), with standard deviations by the delta method.

import numpy as np
import pandas as pd

time = X.index.get_level_values("time")
rows = []
for middle in np.arange(5.0, 77.5, 2.5):
    window = (time >= middle - 5) & (time < middle + 5)
    model = ARXRegressor(na=2, nb=2, nk=truth.nk).fit(X[window], y[window])
    rows.append(operator_parameters(model).assign(time=middle))
over_time = pd.concat(rows).set_index("time")
print(over_time.loc[[20.0, 60.0], ["K_e", "K_edot", "T_L", "omega_nm", "zeta_nm"]].round(3))

# %%
# The picture shows the truth behind the estimates. The change is visible, smeared over the width of
# the window; while a window straddles it, omega_nm and zeta_nm dip, since one model has to describe
# two operators. K_edot is estimated best; T_L = K_edot / K_e inherits the scatter of K_e. Estimates
# are off by more than their standard deviations, which include the scatter but not the bias that
# even this remnant causes in a closed loop.

import matplotlib.pyplot as plt

from skhoid.plotting import ParametersDisplay

ParametersDisplay.from_frame({"windows of 10 s": over_time}, truth=truth)
plt.show()

# %%
# The answer
# ----------
# The gain K_e falls from 0.09 to 0.07 and that on the error rate, K_edot, rises from 0.03 to 0.08:
# the lead T_L goes from 0.4 to 1.2 s. The neuromuscular mode stays near 11 rad/s. Ten-second
# windows show that much, and that the change was in the middle, but not how fast it was.
