"""The remnant model of residuals that hold nothing."""

import numpy as np
import pytest

from skhoid.greybox.fitting import AR_ORDER, remnant_model


@pytest.mark.parametrize("known", [True, False])
def test_nothing_left_is_white(known):
    residual = np.zeros((64, 2)) if known else np.random.default_rng(0).standard_normal((64, 2))
    model = remnant_model(residual, np.full((64, 2), known))
    np.testing.assert_array_equal(model.scale, [1.0, 1.0])
    assert model.ar.shape == (AR_ORDER,)
    assert known == (not model.ar.any())
