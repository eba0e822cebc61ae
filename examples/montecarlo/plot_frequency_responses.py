"""
Which method finds the operator's frequency response?
=====================================================

Fourier coefficients at the lines of the target need no model; an ARX model needs an order and a
delay. Which of them is closer to the operator, how much does it scatter from run to run, and does
it know its own scatter?

The study is that of Appendix I of the thesis, with 25 runs per cell instead of 100.
"""

# %%
# The study
# ---------
# Fourier coefficients (Eq. 5.14), a batch ARX(2, 2) model with its own n_k*, and the final
# parameters of a recursion without forgetting that begins with P0 = I.

from skhoid.lab.studies import paper_study

found = paper_study("appI", 25, every_figure=True, intensities=[0.0, 0.15, 0.30])
print(found.summary.loc[("C1", 0.15)].head(3).round(3).to_string())

# %%
# The responses
# -------------
# C1, by method: the mean of the runs with their standard deviation, and the operator. Below, the
# deviations over the runs and those stated by the estimates.

from skhoid import HumanOperator
from skhoid.plotting import StudyResponseDisplay

truth = HumanOperator(K_e=0.09, T_L=0.4).frequency_response
noisy = found.summary.query("condition == 'C1' and remnant_intensity > 0")
_ = StudyResponseDisplay.from_summary(noisy, truth=truth)

# %%
# Bias and scatter
# ----------------
# Relative bias of the magnitude of the mean, and the complex standard deviation divided by the mean
# (Eq. H.7), in percent, by line:

P_15 = found.summary.xs(("C1", 0.15))
print((100 * P_15[["bias", "relative_sd"]]).round(1).unstack("method").to_string())

# %%
# Fourier coefficients are right on average, and scatter by a tenth and more; ARX models scatter by
# a third of that, and are wrong at the high lines, by their order and by the bias of remnant. C2 is
# another matter: there the person makes the error small at low frequencies, and most of it is
# remnant.

C2 = found.summary.xs(("C2", 0.15))
print((100 * C2[["bias", "relative_sd"]]).round(1).unstack("method").to_string())

# %%
# Does a method know its own scatter? The standard deviation of the magnitude that it states (Eq.
# H.9 for ARX models), divided by that over the runs; 1 would be right.

stated = found.summary.query("remnant_intensity > 0")["stated_over_ensemble"]
print(stated.groupby(["condition", "method"]).describe().round(2).to_string())

# %%
# What the thesis says, and whether it holds in these runs:

for claim in found.claims:
    print(claim)

# %%
# The answer
# ----------
# In C1 Fourier coefficients are right on average, and a single run scatters by 7 to 19 % with 15 %
# remnant. An ARX(2, 2) model scatters by 3 % up to 4 rad/s and is wrong by as much at low
# frequencies, but by 16 and 58 % at the two highest lines: second-order remnant and a wrong delay
# have moved its neuromuscular mode. In C2 the person tracks the low lines so well that the error
# there is mostly remnant, and Fourier coefficients from a single run are worthless below 1 rad/s.
# Batch models understate their own scatter by up to a third, since equation errors are coloured,
# and none of them knows its bias. The end of a recursion without forgetting is the batch model, but
# P0 = I makes it more certain than it should be.
