"""Tests of effects written from shapes: by a formula, or as a table."""

import importlib.util
import sys

import numpy as np
import pandas as pd
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import (
    Dimension,
    Effect,
    FreeDelay,
    FreeGain,
    FreeHysteresis,
    FreeMap,
    FreeOffset,
    FreePath,
    Parameter,
)
from skhoid.search.formulas import find_formula
from skhoid.search.shape import Shape
from skhoid.search.sketch import name_class, written
from skhoid.testing import check_effect, synthetic_record

pytestmark = pytest.mark.slow  # fits the effects that it writes


def shape(form, curve, *, half=0.1, table=False):
    """A shape with a curve that is a function of its abscissa."""
    record = synthetic_record()
    form = form.variants(record)[0]
    knots = np.asarray(form.knots)
    values = curve(knots)
    form = form.with_choices(values=tuple(values.tolist()))
    grid = np.linspace(knots[0], knots[-1], 101)
    value = form.curve(values, grid) + form.at_rest
    band = half * np.abs(values).max()
    frame = pd.DataFrame({"value": value, "low": value - band, "high": value + band}, grid)
    return Shape(
        sentence=form.sentence,
        curve=frame,
        x_label=f"{form.over}, deg",
        y_label="departure, deg",
        dof=6.0,
        gain=5.0,
        delta_bic=100.0,
        closed=0.9,
        effect=form,
        name="free_0",
        estimator=None,
        nearest=pd.DataFrame(),
        recordings=[],
        formula=None if table else find_formula(form, frame, 6.0, record),
    )


def imported(path):
    """The effect in a file."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return getattr(module, name_class(path.stem))


def cubic(x):
    return 0.1 * x**3 / np.abs(x).max() ** 2


def fading(x):
    return -0.1 * np.exp(-np.abs(x) / np.abs(x).max() / 0.1)


def square(x):
    return 0.1 * x**2


def weights(x):
    return -np.minimum(np.abs(x), 0.3 * np.abs(x).max())


def find_name(case):
    """Of a test: no addresses, which differ between processes."""
    return getattr(case, "__name__", str(case))


PLACES = [
    (FreeMap(at="error"), cubic),
    (FreeMap(at="command"), cubic),
    (FreeMap(at="spring"), cubic),
    (FreeGain(), fading),
    (FreeGain(channel="speed"), square),
    (FreeGain(channel="size of e"), square),
    (FreeDelay(channel="|de/dt|"), fading),
    (FreeMap(at="error rate"), cubic),
    (FreeOffset(), fading),
    (FreePath(channel="f_t"), fading),
    (FreeHysteresis(at="output"), weights),
]


@pytest.mark.parametrize(
    ("form", "curve", "table"),
    [(*place, k % 2 == 1) for k, place in enumerate(PLACES)],
    ids=find_name,
)
def test_a_file_is_an_effect_that_passes_the_checks(form, curve, table, tmp_path):
    path = written("my_effect", tmp_path, shape(form, curve, table=table))
    assert path == tmp_path / "my_effect.py"
    check_effect(imported(path)())


@pytest.mark.parametrize(("form", "curve"), PLACES, ids=find_name)
def test_a_table_is_the_shape_itself(form, curve, tmp_path):
    """With size 1 it does what the free form does."""
    from skhoid.testing.records import signal_at, split_parts

    found = shape(form, curve, table=True)
    effect = imported(written("my_effect", tmp_path, found))()
    record = synthetic_record()
    signal = signal_at(effect.place, record)
    mine = split_parts(effect.apply(signal, record, size=1.0))
    whole = split_parts(found.effect.apply(signal, record))
    for name, values in whole.items():
        np.testing.assert_allclose(mine[name], values, rtol=1e-4, atol=1e-4)


def test_a_formula_is_found_with_its_numbers():
    found = shape(FreeOffset(), lambda t: 0.4 * np.exp(-t / 6.0)).formula
    assert found.formula.text == "size exp(-t / tau)"
    values = dict(zip(found.formula.names, found.values, strict=True))
    assert values == pytest.approx({"size": 0.4, "tau": 6.0}, rel=0.02)
    assert found.distance < 0.02


def test_no_formula_lies_within_the_band_of_a_rough_curve():
    assert shape(FreeMap(), lambda x: np.sin(9 * x), half=0.01).formula is None


@pytest.mark.parametrize(
    ("name", "error", "said"),
    [
        ("my effect", ValueError, "use a word"),
        ("class", ValueError, "use a word"),
        ("dead_zone", ValueError, "in the catalogue of skhoid already"),
        ("effect", ValueError, "would make a class Effect"),
        (3, TypeError, "needs a name"),
    ],
)
def test_names_that_cannot_be_taken(name, error, said, tmp_path):
    with pytest.raises(error, match=said):
        written(name, tmp_path, shape(FreeMap(), cubic))
    assert not list(tmp_path.iterdir())


def test_a_file_is_not_replaced_unasked(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("by hand")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        written("my_effect", path, shape(FreeMap(), cubic))
    assert path.read_text() == "by hand"
    written("my_effect", path, shape(FreeMap(), cubic), overwrite=True)
    assert "class MyEffect" in path.read_text()
    assert [p.name for p in tmp_path.iterdir()] == ["mine.py"]


class Wandering(Effect):
    name = "wandering"
    place = "gain"
    physics = "Attention comes and goes."
    formula = "K (1 + depth sin(2 pi t / period))"
    parameters = (
        Parameter("depth", Dimension(), 0.0, 1.0, (0.5,), meaning="depth"),
        Parameter("period", Dimension(s=1), 1.0, 100.0, (20.0,), meaning="period"),
    )

    def apply(self, signal, record, depth, period):
        return signal.times(1 + depth * np.sin(2 * np.pi * record.t / period))


@pytest.fixture(scope="module")
def hidden():
    return make_tracking_runs(
        "C1",
        n_runs=3,
        remnant_intensity=0.1,
        duration=40.96,
        sampling_rate=50.0,
        effects=Wandering(depth=0.6, period=30.0),
        random_state=0,
    )


@pytest.fixture(scope="module")
def search(hidden):
    return EffectSearchCV(OperatorRegressor(), effects=["gain_drift", "lapses"]).fit(*hidden)


def test_from_shape_to_name(hidden, search, tmp_path):
    """The effect in the file closes the gap, and a search names it."""
    effect = imported(search.sketch_effect("my_wave", tmp_path))
    before = OperatorRegressor().fit(*hidden).vaf_
    after = OperatorRegressor(effects=[effect()]).fit(*hidden)
    whole = search.shape_.estimator.vaf_
    assert after.vaf_ - before > 0.95 * (whole - before)
    period = after.parameters_.loc["my_wave__period"]
    assert period["low"] < 30.0 < period["high"]
    named = EffectSearchCV(OperatorRegressor(), effects=["gain_drift", "lapses", effect()])
    assert named.fit(*hidden).best_effects_ == ["my_wave"]
