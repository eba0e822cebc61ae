"""Standard errors: the noise model estimated along, and what is between samples."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Quantised


def test_a_delay_is_not_known_better_than_what_is_between_samples():
    X, y = make_tracking_runs("C1", n_runs=2, remnant_intensity=0.0, random_state=5)
    table = OperatorRegressor().fit(X, y).parameters_
    assert table.loc["tau_e", "sd"] == pytest.approx(0.01 / np.sqrt(12), rel=0.3)


@pytest.mark.slow
def test_an_output_in_steps_has_intervals_like_any_other():
    """A row that jumps must not tell more than remnant lets it."""
    steps = Quantised(step=0.1, offset=0.0, at="output", form="sharp")
    X, y = make_tracking_runs(
        n_runs=1, duration=40.96, remnant_intensity=0.15, effects=steps, random_state=1
    )
    table = OperatorRegressor(effects=steps).fit(X, y).parameters_
    names = ["K_e", "K_edot", "omega_nm", "zeta_nm", "tau_e"]
    sd = (table.loc[names, "sd"] / table.loc[names, "value"]).to_numpy()
    assert np.isfinite(sd).all()
    assert (sd > 0.01).all()
    assert (sd < 0.3).all()
