"""Every role works under any name of its column: all effects give the same numbers."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import CoreKind, catalogue
from skhoid.effects.registry import effect
from skhoid.plotting import EffectDisplay
from skhoid.testing import synthetic_record
from skhoid.testing.records import parts_of, signal_at

OWN = {"e": "err", "x": "pos", "f_t": "ref", "motion_acc": "sled", "dist": "gust", "speed": "x"}


@pytest.fixture(scope="module", params=[CoreKind.OPERATOR, CoreKind.ARX], ids=str)
def records(request):
    """A record, and the same with other names; a column of no role has that of another's."""
    record = replace(synthetic_record(), core=request.param)
    renamed = replace(
        record,
        channels={OWN[name]: values for name, values in record.channels.items()},
        roles={OWN[name]: role for name, role in record.roles.items()},
        inputs=("err",),
        _derived={},
    )
    return record, renamed


def numbers(one, record):
    """Whatever an effect takes from a record: bounds, starts, and what it does to a signal."""
    values = one.fixed | {p.name: p.starts[0] * p.scale_of(record, one.place) for p in one.free}
    changed = one.apply(signal_at(one.place, record), record, **values)
    return (
        one.limits(record),
        one.starts(record),
        {k: np.sum(v) for k, v in parts_of(changed).items()},
    )


@pytest.mark.parametrize("name", list(catalogue().index))
def test_effects_do_not_depend_on_names_of_columns(records, name):
    plain, renamed = records
    one = effect(name)
    assert bool(one.refusal(plain, plain.core)) == bool(one.refusal(renamed, plain.core))
    if one.refusal(plain, plain.core):
        return
    pairs = list(zip(one.variants(plain), one.variants(renamed), strict=True))
    assert pairs
    for a, b in pairs:
        expected, found = numbers(a, plain), numbers(b, renamed)
        assert found[:2] == expected[:2]
        assert found[2] == pytest.approx(expected[2], rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["feedforward", "preview", "output_feedback"])
def test_a_model_of_columns_with_roles(name):
    X, y = make_tracking_runs(
        n_runs=2, duration=20.48, sampling_rate=50, channels=("e", "x", "f_t"), random_state=0
    )
    X.attrs["units"] = {"e": "deg", "x": "mm", "f_t": "mm"}
    renamed = X.rename(columns=OWN)
    renamed.attrs["units"] = {OWN[name]: unit for name, unit in X.attrs["units"].items()}
    plain = OperatorRegressor(0.28, effects=name).fit(X, y)
    model = OperatorRegressor(0.28, effects=name, roles={OWN[c]: c for c in X}).fit(renamed, y)
    np.testing.assert_array_equal(model.predict(renamed), plain.predict(X))
    pd.testing.assert_frame_equal(model.parameters_, plain.parameters_)
    assert EffectDisplay.from_estimator(model, name, renamed, y).figure_
