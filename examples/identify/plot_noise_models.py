"""
Which noise does the model have?
================================

A sensor adds noise to the output of a machine. Least squares believe in another noise, and the
model is wrong. Which of the other noise models are right?
"""

# %%
# The same system with three noises
# ---------------------------------
# The system is always :math:`B/F`; white noise is added to its output, or noise that is slower than
# it, or noise that passes through the same poles:

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from skhoid import ARXRegressor

B, F = [0.0, 0.05, 0.047], [1.0, -1.73, 0.835]
noises = {
    "white": ([1.0], [1.0]),
    "slow": ([1.0], [1.0, -0.95]),
    "behind F": ([1.0, -0.5], F),
}
rng = np.random.default_rng(0)
x = lfilter([0.3], [1.0, -0.7], rng.standard_normal(4000))
outputs = {}
for name, (C, D) in noises.items():
    rest = lfilter(C, D, rng.standard_normal(4000))
    clean = lfilter(B, F, x)
    outputs[name] = clean + 0.2 * clean.std() / rest.std() * rest

# %%
# Five methods
# ------------
# Output error (``"oe"``) has white noise on the output, Box-Jenkins (``"bj"``) any noise of its
# own, ARMAX noise behind the poles of the system. Instruments (``"iv"``) assume nothing of it. The
# error of the frequency response, in percent:

z = np.exp(1j * np.geomspace(0.02, 1.0, 40))
truth = np.polyval(B, z) / np.polyval(F, z)
error = pd.DataFrame(index=list(noises), columns=["ols", "armax", "oe", "bj", "iv"], dtype=float)
for name, y in outputs.items():
    for method in error:
        model = ARXRegressor(2, 2, 1, dt=0.1, method=method).fit(x[:, None], y)
        found = np.polyval(np.r_[0.0, model.b_], z) / np.polyval(np.r_[1.0, model.a_], z)
        error.loc[name, method] = 100 * np.sqrt(np.mean(np.abs(found / truth - 1) ** 2))
print(error.round(1))

import matplotlib.pyplot as plt

axes = error.plot.bar(logy=True, rot=0, figsize=(7.0, 3.6))
axes.set(xlabel="noise", ylabel="error of the response, %")
plt.tight_layout()

# %%
# The noise model predicts: a few samples ahead the slow noise is foreseen, far ahead it is not.
# The standard deviation of the errors:

slow = outputs["slow"]
models = {
    method: ARXRegressor(2, 2, 1, dt=0.1, method=method).fit(x[:, None], slow)
    for method in ("oe", "bj")
}
for horizon in (1, 10, 100):
    left = [np.std(slow - m.predict_ahead(x[:, None], slow, horizon)) for m in models.values()]
    print(horizon, dict(zip(models, np.round(left, 3).tolist(), strict=True)))

# %%
# The answer
# ----------
# Least squares are wrong wherever the noise is not white behind F. The others are right where their
# noise is the true one, and output error and instruments in all three, as the loop is open. Of
# those, Box-Jenkins foresees slow noise too.
