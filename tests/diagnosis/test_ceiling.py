"""The ceiling agrees with itself: repeats, periods, and models that it may not contradict."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter
from support.comparison import Gives
from support.unseen import DT, simulate

from skhoid import (
    ARXRegressor,
    Multisine,
    OperatorRegressor,
    compare,
    make_tracking_runs,
    select_runs,
)
from skhoid.diagnosis.ceiling import consistent_ceiling
from skhoid.effects import Preview
from skhoid.exceptions import ShortRunError

pytestmark = pytest.mark.slow

PERIOD = 20.0  # s


def as_runs(loop, columns=("e", "x", "f_t"), runs=None, dist=None):
    signals = {"e": loop.e, "x": loop.x, "f_t": loop.f, "dist": dist}
    n, n_runs = loop.u.shape
    runs = range(n_runs) if runs is None else runs
    index = pd.MultiIndex.from_product([list(runs), np.arange(n) * DT], names=["run", "time"])
    names = [*columns, *(["dist"] if dist is not None else [])]
    X = pd.DataFrame({c: signals[c][:, list(runs)].T.ravel() for c in names}, index=index)
    u, answer = (v[:, list(runs)].T.ravel() for v in (loop.u, loop.answer))
    return X, pd.Series(u, index=index, name="u"), Gives(lambda X: answer)


def of(loop, **options):
    X, y, model = as_runs(loop, **options)
    return compare(model, X, y, run_in=5.0)


def periodic(n, n_runs):
    """A multisine of 20 s, another in each run."""
    t = np.arange(n)[:, None] * DT
    rng = np.random.default_rng(3)
    total = np.zeros((n, n_runs))
    for k in (1, 2, 3, 5, 7, 11, 13, 17, 23):
        phase = rng.uniform(0, 2 * np.pi, n_runs)
        total += np.sin(2 * np.pi * k * t / PERIOD + phase) / (1 + (k / 8) ** 2)
    return total


def test_runs_with_another_unrecorded_disturbance_are_no_repeats():
    options = {"seed": 1, "shared_target": True, "delay": (0.2, 0.2)}
    found = of(simulate("1/s", 3, disturbance=1.0, **options))
    assert found.ceiling_route == "none"
    assert "unrecorded disturbance that differs" in found.ceiling_note
    assert np.isnan([found.noise_ceiling, found.explainable_gap]).all()
    assert "unrecorded disturbance" in found.summary()
    alike = of(simulate("1/s", 3, disturbance=0.0, **options))
    assert alike.ceiling_route == "repeats"
    assert "no unrecorded disturbance" in alike.ceiling_note


def test_a_few_repeats_among_many_runs_are_no_ceiling_of_all():
    loop = simulate("1/s", 5, disturbance=0.0)
    for signal in (loop.f, loop.u, loop.x, loop.e, loop.answer):
        signal[:, 1] = signal[:, 0]
    found = of(loop)
    assert found.ceiling_route in ("none", "inputs")
    assert "only 2 of 5 runs repeat each other" in found.ceiling_note


@pytest.mark.parametrize(("n_runs", "run_in"), [(1, 0.0), (3, 3.0)])
def test_a_run_in_leaves_whole_periods(run_in, n_runs):
    loop = simulate("1/s", n_runs, disturbance=0.0, target=periodic)
    X, y, model = as_runs(loop)
    found = compare(model, X, y, run_in=run_in)
    assert found.ceiling_route == "lines"
    assert found.vaf <= found.noise_ceiling <= 100
    if run_in:
        assert "has a period of 20 s" in " ".join(map(str, found.notes))
        assert "1 whole period" in " ".join(map(str, found.notes))
        assert "whole periods" in [note.kind for note in found.notes]
    late = X.index.get_level_values("time") >= run_in - 1e-9
    assert (found.traces["scored"].to_numpy() == late).all()


def test_a_ceiling_is_between_the_vaf_and_100():
    X, y = make_tracking_runs(
        "C1",
        n_runs=4,
        remnant_intensity=0.1,
        channels=["e", "f_t"],
        random_state=0,
        sampling_rate=50.0,
    )
    model = ARXRegressor(nk=15).fit(*select_runs(X, y, first=2))
    for scale in (0.0, 0.5, 1.0):
        of_model = Gives(lambda X, scale=scale: scale * model.predict(X))
        found = compare(of_model, *select_runs(X, y, last=2))
        low, high = found.noise_ceiling_interval
        assert found.vaf <= found.noise_ceiling <= 100
        assert low <= found.noise_ceiling <= high <= 100


@pytest.mark.parametrize(
    ("ceiling", "vaf", "sd", "shown"),
    [
        (101.6, 97.0, 0.5, 100.0),
        (90.0, 80.0, 0.5, 90.0),
        (90.0, 91.5, 0.5, 91.5),
        (59.1, 71.2, 1.0, np.nan),
        (np.nan, 71.2, 1.0, np.nan),
    ],
)
def test_consistent_ceiling(ceiling, vaf, sd, shown):
    value, reason = consistent_ceiling(ceiling, vaf, sd)
    assert_allclose(value, shown)
    assert bool(reason) == (np.isnan(shown) and np.isfinite(ceiling))


def test_a_run_in_that_leaves_too_little_says_what_to_do():
    X, y, model = as_runs(simulate("1/s", 1, duration=10.0, disturbance=0.0))
    with pytest.raises(ShortRunError, match=r"successive rows .* shorter run_in"):
        compare(model, X, y, run_in=9.5)


def test_a_free_run_that_does_not_settle_is_said():
    X, y, _ = as_runs(simulate("1/s", 1, duration=30.0, disturbance=0.0))

    def slow(X):
        """A model whose start takes a minute to be forgotten."""
        return 5 * np.exp(-np.arange(len(X)) / 3600) + X["e"].to_numpy()

    found = compare(Gives(slow), X, y).notes
    notes = " ".join(note.with_hint for note in found)
    assert "still shows its start" in notes
    assert "unsettled" in [note.kind for note in found]
    assert "longer run_in" in notes


def of_person(seed, **options):
    """Runs of a person on C1, and an operator fitted to the first of them."""
    X, y, truth = make_tracking_runs(
        "C1",
        n_runs=5,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.1,
        sampling_rate=50.0,
        duration=60.0,
        return_truth=True,
        random_state=seed,
        **options,
    )
    model = OperatorRegressor().fit(*select_runs(X, y, first=2))
    late = select_runs(X, y, last=3)
    n = truth.remnant.loc[late[0].index]
    return model, *late, 100 * (1 - (n**2).sum() / (late[1] ** 2).sum())


@pytest.mark.parametrize(("seed", "slowness"), [(3, 0.0), (4, 0.9), (5, 0.99)])
def test_a_disturbance_that_nobody_answers_costs_nothing(seed, slowness):
    model, X, y, truth = of_person(seed)
    white = np.random.default_rng(seed).standard_normal(len(X))
    idle = X.assign(dist=lfilter([1.0], [1.0, -slowness], white))
    predicted = model.predict(X)
    found = compare(Gives(lambda X: predicted), idle, y, run_in=5.0)
    assert found.ceiling_route == "repeats"
    assert found.noise_ceiling == pytest.approx(truth, abs=2)
    assert "output does not follow it" in " ".join(map(str, found.notes))
    assert "idle disturbance" in [note.kind for note in found.notes]


@pytest.mark.parametrize("seed", [3, 4])
def test_a_disturbance_that_is_answered_tells_runs_apart(seed):
    rng = np.random.default_rng(seed)
    upset = Multisine((4, 9, 17, 31), (0.3, 0.25, 0.2, 0.1), tuple(rng.uniform(0, 6, 4)), 60.0)
    X, y = make_tracking_runs(
        "C1",
        n_runs=3,
        channels=["e", "x", "f_t", "dist"],
        remnant_intensity=0.1,
        sampling_rate=50.0,
        duration=60.0,
        disturbance=upset,
        random_phases=True,
        random_state=seed,
    )
    found = compare(OperatorRegressor().fit(X, y), X, y)
    assert "nobody answers" not in " ".join(map(str, found.notes))


@pytest.mark.parametrize("seed", [0, 1])
def test_where_targets_differ_responses_to_them_are_a_lower_bound(seed):
    answer = Preview(form="rate", gain=0.05, time=0.4)
    model, X, y, truth = of_person(seed, random_phases=True, effects=answer)
    found = compare(model, X, y)
    assert found.ceiling_route == "inputs"
    assert found.vaf < found.noise_ceiling < truth + 1
    assert "at least" in found.summary()
    assert "a lower bound" in found.ceiling_note
