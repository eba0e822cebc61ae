"""Tables of single precision, and those in files, are read a part at a time and never copied."""

import tracemalloc
import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone

from skhoid import (
    ARXRegressor,
    EffectSearchCV,
    MissingDataWarning,
    OperatorRegressor,
    RecursiveARX,
    SimulatedARX,
    check_channels,
    compare,
    lost_control,
    make_tracking_runs,
    performance_scores,
)
from skhoid.diagnosis.identification import ModelChoice, identify

pytestmark = pytest.mark.slow

WIDE = 60  # columns, of which a model takes one or two
MODELS = {
    "arx": ARXRegressor(2, 2, 7, inputs=["e"]),
    "arx, all": ARXRegressor(2, 2, 7, inputs=["e", "x"]),
    "recursive": RecursiveARX(2, 2, 7, inputs=["e"], memory_time=5.0),
    "operator": OperatorRegressor(),
    "effect": SimulatedARX(2, 2, 7, inputs=["e"], effects=["dead_zone"]),
}


@pytest.fixture(scope="module")
def data():
    X, y = make_tracking_runs(
        "C1", n_runs=4, duration=20.48, sampling_rate=50, channels=["e", "x", "f_t"],
        remnant_intensity=0.1, random_state=0,
    )  # fmt: skip
    X.iloc[[100, 101, 700], 0] = np.nan
    return X.astype(np.float32), y.astype(np.float32)


@pytest.fixture(params=["few", "many"])
def size(request, monkeypatch):
    """Runs simulated all at once, or a few at a time."""
    if request.param == "many":
        for module in ("effects.record", "model.prepared"):
            monkeypatch.setattr(f"skhoid.{module}.LARGE", 2500)
        monkeypatch.setattr("skhoid.effects.record.CACHED", 2100)


def answers(model, X, y):
    fitted = model.fit(X, y)
    yield "estimates", fitted.coef_ if hasattr(fitted, "coef_") else fitted.parameters_["value"]
    yield "predict", fitted.predict(X)
    yield "score", fitted.score(X, y)
    if hasattr(fitted, "predict_ahead"):
        yield "ahead", fitted.predict_ahead(X, y, 3)


@pytest.mark.usefixtures("size")
@pytest.mark.parametrize("name", MODELS)
def test_they_give_the_bits_of_the_same_values_in_double(name, data):
    X, y = data
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingDataWarning)
        double = dict(answers(MODELS[name], X.astype(np.float64), y.astype(np.float64)))
        for what, found in answers(MODELS[name], X, y):
            np.testing.assert_array_equal(found, double[what], err_msg=what)


def assert_equal(found, expected):
    if isinstance(found, pd.DataFrame):
        pd.testing.assert_frame_equal(found, expected, check_exact=True)
    elif isinstance(found, dict):
        assert found.keys() == expected.keys()
        for name, value in found.items():
            assert_equal(value, expected[name])
    elif hasattr(found, "__dataclass_fields__"):
        assert_equal(vars(found), vars(expected))
    elif isinstance(found, list):
        assert [str(one) for one in found] == [str(one) for one in expected]
    else:
        np.testing.assert_equal(found, expected)


@pytest.mark.parametrize("channels", [["e", "x", "f_t"], ["e", "x"], ["e"]])
@pytest.mark.parametrize("container", ["frame", "array"])
def test_comparison_and_checks_give_the_same_too(channels, container, data):
    X, y = data
    X = X[channels]
    model = ARXRegressor(2, 2, 7, inputs=[0], dt=0.02)
    options = {}
    if container == "array":
        X, y = X.to_numpy()[:1024], y.to_numpy()[:1024]
        options = {"roles": dict(enumerate(channels)), "dt": 0.02}
    double = X.astype(np.float64), y.astype(np.float64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingDataWarning)
        model.fit(*double)
        found, expected = (vars(compare(model, *data, **options)) for data in ((X, y), double))
        for name, value in found.items():
            assert_equal(value, expected[name])
        assert_equal(lost_control(X, **options), lost_control(double[0], **options))
        scores = [
            performance_scores(*data, windows=[(0.0, 10.0)], **options) for data in ((X, y), double)
        ]
        assert_equal(*scores)
        dt = options.get("dt")
        assert_equal(check_channels(X, y, dt=dt), check_channels(*double, dt=dt))


@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_identification_and_search_give_the_same_too(data):
    X, y = data
    double = X.astype(np.float64), y.astype(np.float64)
    found, expected = (identify(*given, ModelChoice()) for given in ((X, y), double))
    for one, other in zip(found.models, expected.models, strict=True):
        np.testing.assert_array_equal(one.model.coef_, other.model.coef_)
    search = EffectSearchCV(OperatorRegressor(), effects=["dead_zone"])
    assert_equal(search.fit(X, y).ranking_, search.fit(*double).ranking_)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """Runs in a file with many more channels, as a frame that does not copy it."""
    X, y = make_tracking_runs(
        "C1", n_runs=40, duration=40.96, channels=["e", "x"], remnant_intensity=0.1, random_state=1
    )
    path = tmp_path_factory.mktemp("mapped") / "channels"
    table = np.memmap(path, np.float32, "w+", shape=(len(X), WIDE))
    table[:] = np.random.default_rng(0).standard_normal((1, WIDE))
    table[:, 0], table[:, 7] = X["e"], X["x"]
    table.flush()
    names = [f"c{i}" for i in range(WIDE)]
    names[0], names[7] = "e", "x"
    table = np.memmap(path, np.float32, "r", shape=(len(X), WIDE))
    frame = pd.DataFrame(table, index=X.index, columns=names, copy=False)
    assert np.shares_memory(frame.to_numpy(), table)
    return frame, y


def peak(call, *args):
    tracemalloc.start()
    try:
        call(*args)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["arx", "recursive", "operator"])
def test_a_mapped_file_is_not_copied(name, mapped):
    X, y = mapped
    few = X.index.get_level_values("run") <= 2
    model = MODELS[name].fit(X[few], y[few])
    for call in ("predict", "score", "predict_ahead", "fit"):
        if not hasattr(model, call):
            continue
        args = (X,) if call == "predict" else (X, y)
        getattr(model, call)(*(part[few] for part in args))  # which compiles and imports
        # What they compute with; to score, an operator's runs begin where suits them.
        most = {"operator": 0.9, "recursive": 0.7}.get(name, 0.3) if call == "fit" else 0.45
        assert peak(getattr(model, call), *args) < most * X.to_numpy().nbytes, call


@pytest.mark.parametrize("call", [compare, check_channels, lost_control, performance_scores])
def test_a_mapped_file_is_compared_without_a_copy(call, mapped):
    """What they compute with is that of the few channels with a role, in double precision."""
    rows = 12 * 4096
    X, y = (part.iloc[:rows] for part in mapped)
    assert np.shares_memory(X.to_numpy(), mapped[0].to_numpy())

    def peak_of(X):
        model = [MODELS["arx"].fit(X[:8192], y[:8192])] if call is compare else []
        outputs = [] if call is lost_control else [y]
        call(*model, X[:8192], *(part[:8192] for part in outputs))
        return peak(call, *model, X, *outputs)

    # All channels are checked, but one after the other.
    channels = X.columns if call is check_channels else ["e", "x"]
    copied = X.to_numpy().nbytes
    assert peak_of(X) < peak_of(X[channels].astype(np.float64)) + 0.1 * copied


FEW = 10
MORE = {
    "effect": lambda X, y: SimulatedARX(2, 2, 7, effects=["bias"]).fit(X, y),
    "operator": lambda X, y: OperatorRegressor().fit(X, y),
    "search": lambda X, y: EffectSearchCV(OperatorRegressor(), ["bias"], max_effects=0).fit(X, y),
    "stream": lambda X, y: RecursiveARX(2, 2, 7, init="zeros", p0=1.0, memory_time=5.0).partial_fit(
        X, y
    ),
    "stream from data": lambda X, y: RecursiveARX(2, 2, 7, memory_time=5.0).partial_fit(X, y),
    "compare": lambda X, y: compare(ARXRegressor(2, 2, 7).fit(X, y), X, y),
    "check": check_channels,
}


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """Runs in files with few and with many channels beside the error, all of which move."""
    X, y = make_tracking_runs(
        "C1", n_runs=6, duration=40.96, sampling_rate=50, remnant_intensity=0.1, random_state=1
    )
    table = np.random.default_rng(0).standard_normal((len(X), WIDE), dtype=np.float32)
    table[:, 0] = X["e"]
    frames = []
    for n_columns in (FEW, WIDE):
        path = tmp_path_factory.mktemp("moving") / "channels.npy"
        np.save(path, table[:, :n_columns])
        names = ["e", *(f"c{i}" for i in range(1, n_columns))]
        values = np.load(path, mmap_mode="r")
        frames.append(pd.DataFrame(values, index=X.index, columns=names, copy=False))
    return *frames, y


@pytest.mark.parametrize("name", MORE)
def test_channels_that_nobody_asks_for_take_no_room(name, moving):
    """All of them are looked at by a check or a search, but one after the other."""
    few, many, y = moving
    MORE[name](few.loc[[0]], y.loc[[0]])  # which compiles and imports
    further = 8 * len(y) * (WIDE - FEW)  # bytes, in double precision
    assert peak(MORE[name], many, y) < peak(MORE[name], few, y) + 0.4 * further


def test_a_stream_of_many_rows_is_taken_in_parts(moving, monkeypatch):
    _, X, y = moving
    whole = MORE["stream"](X, y)
    monkeypatch.setattr("skhoid.arx.streaming.BLOCK", 700)
    np.testing.assert_array_equal(MORE["stream"](X, y).coef_, whole.coef_)
    fading = RecursiveARX(
        2, 2, 7, init="zeros", p0=1.0, forgetting=lambda t: 0.99 + 0.0001 * t, reset_times=[3.0]
    )
    parts = fading.partial_fit(X, y).coef_
    monkeypatch.setattr("skhoid.arx.streaming.BLOCK", 10**9)
    np.testing.assert_array_equal(clone(fading).partial_fit(X, y).coef_, parts)
