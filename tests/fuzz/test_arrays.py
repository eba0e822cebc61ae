"""Every estimator on every array, and on containers that are like one."""

import numpy as np
from hypothesis import strategies as st
from sklearn.base import clone
from support.drawn_models import REGRESSORS, SEARCHES, TRANSFORMERS, models
from support.fuzzing import fuzz, outcome
from support.hostile import arrays, good

import skhoid
from skhoid import ARXRegressor, RecursiveARX

LONG = st.sampled_from([60, 100, 150])


@fuzz(recording=arrays(), model=models(*REGRESSORS, *SEARCHES))
def test_fit_and_predict(recording, model):
    X, y = recording.X, recording.y
    before = np.ma.getdata(X).tobytes() if isinstance(X, np.ndarray) else None
    fitted, error = outcome(model.fit, X, y)
    if before is not None:
        assert np.ma.getdata(X).tobytes() == before
    if error is not None:
        return
    predicted, error = outcome(fitted.predict, X)
    assert error is None, error
    assert predicted.shape == (len(X),)
    assert np.isfinite(predicted).all()


@fuzz(recording=arrays(), transformer=models(*TRANSFORMERS))
def test_transform(recording, transformer):
    Z, error = outcome(transformer.fit_transform, recording.X)
    if error is None:
        assert len(Z) == len(recording.X)


@fuzz(recording=arrays(), model=models(RecursiveARX), data=st.data())
def test_stream(recording, model, data):
    """Parts of any size, also none, which may be refused, but leave the model as it was."""
    X, y = recording.X, recording.y
    for part in data.draw(st.lists(st.slices(10), max_size=5)):
        try:
            rows, outputs = X[part], y[part]
        except (TypeError, KeyError, IndexError):
            continue
        known = getattr(model, "coef_", None)
        _, error = outcome(model.partial_fit, rows, outputs)
        if hasattr(model, "coef_"):
            assert np.isfinite(model.coef_).all()
            if error is not None:
                np.testing.assert_array_equal(model.coef_, known)


@fuzz(recording=good(lengths=LONG), model=models(*REGRESSORS, bad=False))
def test_same_numbers_in_another_container(recording, model):
    X, y = recording.X.to_numpy(), recording.y.to_numpy()
    fitted, error = outcome(clone(model).fit, X, y)
    if error is not None:
        return
    predicted = fitted.predict(X)
    for twin in (np.asfortranarray(X), np.repeat(X, 2, axis=0)[::2], X.astype(">f8"), X.tolist()):
        other, error = outcome(clone(model).fit, twin, list(y))
        assert error is None, error
        np.testing.assert_array_equal(outcome(other.predict, twin)[0], predicted)


@fuzz(recording=good(lengths=LONG), model=st.sampled_from([ARXRegressor(), ARXRegressor(1, 1, 1)]))
def test_run_column_is_the_run_level(recording, model):
    X, y = recording.X, recording.y
    fitted, error = outcome(clone(model).fit, X, y)
    if error is not None:
        return
    runs = np.unique(X.index.get_level_values("run"), return_inverse=True)[1]
    table = np.column_stack([runs, X.to_numpy()])
    inputs = [1 + X.columns.get_loc(name) for name in fitted.inputs_]
    model = clone(model).set_params(run=0, inputs=inputs, dt=skhoid.sampling_time(X))
    other, error = outcome(model.fit, table, y.to_numpy())
    assert error is None, error
    np.testing.assert_array_equal(other.coef_, fitted.coef_)
    np.testing.assert_array_equal(other.predict(table), fitted.predict(X))
