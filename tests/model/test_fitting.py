"""Steps to the least error."""

from types import SimpleNamespace

import numpy as np
import pytest

from skhoid.model import fitting
from skhoid.model.cores import Prior


@pytest.mark.parametrize("exact", [True, False])
def test_where_a_bound_cuts_a_step_short_shorter_ones_are_tried(exact, monkeypatch):
    """The step to the least error ends at a bound where it is larger than at the start."""
    normal, best = np.array([[1.0, 0.99], [0.99, 1.0]]), np.array([-5.0, 6.0])
    simulator = SimpleNamespace(low=np.zeros(2), high=np.full(2, 10.0), smooth=True, exact=exact)

    def sse_at(simulator, criterion, theta):
        return float((theta - best) @ normal @ (theta - best))

    def normal_equations(simulator, criterion, theta):
        return normal, normal @ (best - theta)

    monkeypatch.setattr(fitting, "sse_at", sse_at)
    monkeypatch.setattr(fitting, "make_normal_equations", normal_equations)
    start, known = np.array([0.1, 0.0]), SimpleNamespace(n=10)
    assert sse_at(None, None, np.clip(best, 0.0, 10.0)) > sse_at(None, None, start)
    fit = fitting.minimise(simulator, known, start, prior=Prior(), max_iter=50)
    least = 0.99 * 5.0 - 6.0  # where the first is at its bound
    np.testing.assert_allclose(fit.theta, [0.0, -least], atol=0.05)
