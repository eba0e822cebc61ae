"""Tests of effects written from shapes: by a formula, or as a table."""

import importlib.util
import pickle
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import (
    Dimension,
    Effect,
    FreeDelay,
    FreeDynamics,
    FreeGain,
    FreeHysteresis,
    FreeMap,
    FreeOffset,
    FreePath,
    Parameter,
)
from skhoid.search.formulas import formula_of
from skhoid.search.shape import Shape
from skhoid.search.sketch import class_of, why_no_shape, written
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
        id=form.name,
        place=form.place,
        over=form.over,
        channel=getattr(form, "channel", None),
        sentence=form.sentence,
        curve=frame,
        x_label=f"{form.over}, deg",
        y_label="departure, deg",
        dof=6.0,
        gain=5.0,
        gain_loop=float("nan"),
        delta_bic=100.0,
        closed=0.9,
        effect=form,
        name="free_0",
        estimator=None,
        nearest=pd.DataFrame(),
        recordings=[],
        formula=None if table else formula_of(form, frame, 6.0, record),
    )


def imported(path):
    """The effect in a file."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return getattr(module, class_of(path.stem))


def cubic(x):
    return 0.1 * x**3 / np.abs(x).max() ** 2


def fading(x):
    return -0.1 * np.exp(-np.abs(x) / np.abs(x).max() / 0.1)


def square(x):
    return 0.1 * x**2


def weights(x):
    return -np.minimum(np.abs(x), 0.3 * np.abs(x).max())


def name_of(case):
    """Of a test: no addresses, which differ between processes."""
    return getattr(case, "__name__", str(case))


PLACES = [
    (FreeMap(at="error"), cubic),
    (FreeMap(at="command"), cubic),
    (FreeMap(at="output"), cubic),
    (FreeMap(at="output", folded=True), cubic),
    (FreeMap(at="spring"), cubic),
    (FreeMap(at="rate"), cubic),
    (FreeGain(), fading),
    (FreeGain(of="rate"), fading),
    (FreeGain(channel="speed"), square),
    (FreeDelay(), fading),
    (FreeOffset(), fading),
    (FreePath(channel="f_t"), fading),
    (FreePath(channel="motion_acc", at="output"), fading),
    (FreeDynamics(), fading),
    (FreeHysteresis(at="output"), weights),
    (FreeHysteresis(at="command"), weights),
]


@pytest.mark.parametrize("table", [False, True], ids=["formula", "table"])
@pytest.mark.parametrize(("form", "curve"), PLACES, ids=name_of)
def test_a_file_is_an_effect_that_passes_the_checks(form, curve, table, tmp_path):
    path = written("my_effect", tmp_path, shape(form, curve, table=table))
    assert path == tmp_path / "my_effect.py"
    check_effect(imported(path)())


@pytest.mark.parametrize(("form", "curve"), PLACES, ids=name_of)
def test_a_table_is_the_shape_itself(form, curve, tmp_path):
    """With size 1 it does what the free form does."""
    from skhoid.testing.records import parts_of, signal_at

    found = shape(form, curve, table=True)
    effect = imported(written("my_effect", tmp_path, found))()
    record = synthetic_record()
    signal = signal_at(effect.place, record)
    mine = parts_of(effect.apply(signal, record, size=1.0))
    whole = parts_of(found.effect.apply(signal, record))
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


def test_files_are_tidy(tmp_path):
    for number, ((form, curve), table) in enumerate(product(PLACES, [False, True])):
        folder = tmp_path / f"effects{number}"
        folder.mkdir()
        written("my_effect", folder, shape(form, curve, table=table))
    for command in (["check", "--select", "E,F,W,I,B,UP,SIM,N"], ["format", "--check"]):
        run = [sys.executable, "-m", "ruff", *command, "--isolated", "--line-length", "100"]
        done = subprocess.run([*run, tmp_path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("name", "error", "said"),
    [
        ("my effect", ValueError, "use a word"),
        ("class", ValueError, "use a word"),
        ("my__effect", ValueError, "use a word"),
        ("_mine", ValueError, "use a word"),
        ("1st", ValueError, "use a word"),
        ("", ValueError, "use a word"),
        ("dead_zone", ValueError, "in the catalogue of skhoid already"),
        ("free_map", ValueError, "in the catalogue of skhoid already"),
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


def test_a_missing_folder_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match="make it first"):
        written("my_effect", tmp_path / "nowhere" / "mine.py", shape(FreeMap(), cubic))


def test_nothing_half_written_is_left(tmp_path, monkeypatch):
    def fails(self, target):
        raise PermissionError("no")

    monkeypatch.setattr(Path, "replace", fails)
    with pytest.raises(PermissionError):
        written("my_effect", tmp_path, shape(FreeMap(), cubic))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("ids", "said"),
    [
        ([], "nothing is missing"),
        (["dead_zone"], "has a name, dead zone"),
        (["unknown"], "no free form at any place"),
        (["bias", "unknown"], "no free form at any place"),
    ],
)
def test_why_there_is_no_shape(ids, said):
    assert said in why_no_shape(ids)


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


def test_a_search_with_a_shape_can_be_stored(search, tmp_path):
    again = pickle.loads(pickle.dumps(search))
    path = again.sketch_effect("my_wave", tmp_path)
    assert path.read_text() == search.sketch_effect("my_other", tmp_path).read_text().replace(
        "my_other", "my_wave"
    ).replace("MyOther", "MyWave").replace("my other", "my wave")


def test_a_search_without_a_shape_says_why(hidden, tmp_path):
    X, _ = hidden
    y = OperatorRegressor().fit(*hidden).predict(X)
    y = y + 1e-3 * np.random.default_rng(0).standard_normal(y.size)
    found = EffectSearchCV(OperatorRegressor(), effects=["bias"]).fit(X, y)
    with pytest.raises(ValueError, match="nothing is missing"):
        found.sketch_effect("my_effect", tmp_path)
