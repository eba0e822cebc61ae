"""An effect of a user's own, as one would write it."""

import numpy as np

from skhoid.effects import Dimension, Effect, Parameter


class Compressed(Effect):
    """Large errors are answered by their logarithm."""

    name = "compressed"
    place = "input"
    physics = "The response to large errors is less than proportional."
    formula = "e' = knee asinh(e / knee)"
    parameters = (Parameter("knee", Dimension(e=1), 0.05, 10.0, (0.5,), "where the answer bends"),)

    def apply(self, signal, record, knee):
        return knee * np.arcsinh(signal / knee)
