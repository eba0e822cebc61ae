"""Small changes of the data keep the name: runs left out, cut, and in parts.

No run is drawn twice: its copy repeats the remnant too, which is then structure of the data.
"""

import pandas as pd
import pytest
from support.person_in_loop import pursued

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Saturation

RIVALS = ["dead_zone", "saturation", "rate_limit", "feedforward", "extra_lag", "bias", "tv_gain"]


def person(name):
    if name == "feedforward":
        X, y, _ = pursued("1/s", 12, n_runs=6, feedforward=0.6, early=-0.1)
        return X, y, "1/s"
    X, y = make_tracking_runs(
        "C1",
        n_runs=6,
        remnant_intensity=0.1,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        effects=Saturation(limit=0.1),
        random_state=12,
    )
    return X, y, None


def resampled(data, how):
    runs = [data.xs(label, level="run") for label in data.index.unique("run")]
    parts = {
        "first left out": runs[1:],
        "halves": [
            half for run in runs[:4] for half in (run[: len(run) // 2], run[len(run) // 2 :])
        ],
        "begin later": [run[run.index >= 4.0] for run in runs],
    }[how]
    return pd.concat(dict(enumerate(parts)), names=["run", "time"])


@pytest.mark.parametrize(
    ("name", "how"),
    [
        pytest.param("saturation", "halves", marks=pytest.mark.slow),
        pytest.param("saturation", "begin later", marks=pytest.mark.whole),
        pytest.param("feedforward", "first left out", marks=pytest.mark.whole),
    ],
)
def test_resampled_runs_give_the_same_name(name, how):
    X, y, element = person(name)
    search = EffectSearchCV(OperatorRegressor(), effects=RIVALS, controlled_element=element)
    assert search.fit(resampled(X, how), resampled(y, how)).best_effects_[:1] == [name]
