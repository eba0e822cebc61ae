"""Runs start as their first seconds show: what grows is not removed with hindsight."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, filtfilt, lfilter
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from skhoid import ARXRegressor, Decimator, RunInTrimmer, VAFScorer, compare
from skhoid.diagnosis.identification import ModelChoice, Verdict, identify
from skhoid.lab.cli import main

N, DT = 1200, 0.05
INDEX = pd.MultiIndex.from_product([["a", "b"], np.arange(N) * DT], names=["run", "time"])


def ahead(seed):
    """A person who sees the target ahead: the output leads the input."""
    rng = np.random.default_rng(seed)
    b, a = butter(2, 0.05)
    e, hidden = (
        np.concatenate([filtfilt(b, a, rng.standard_normal(N)) for _ in "ab"]) for _ in range(2)
    )
    y = pd.Series(np.roll(e, -14) + 0.2 * hidden, index=INDEX, name="u")
    return pd.DataFrame({"e": e}, index=INDEX), y


def radius(model):
    return np.abs(np.roots(np.r_[1, model.a_])).max()


def with_poles(poles, initial, X, y):
    """A model that was fitted, but for poles of its own."""
    a = np.poly(poles)[1:].real
    model = ARXRegressor(a.size, 2, 1, initial=initial).fit(X, y)
    model.coef_ = np.r_[a, model.b_]
    return model


@pytest.fixture(scope="module")
def recorded():
    rng = np.random.default_rng(5)
    e = np.concatenate([lfilter([1], [1, -0.9], rng.standard_normal(N)) for _ in "ab"])
    y = lfilter([0, 0.3, 0.1], [1, -0.8], e) + 0.2 * rng.standard_normal(2 * N)
    return pd.DataFrame({"e": e}, index=INDEX), pd.Series(y, index=INDEX, name="u")


GROWS = {
    "fast": [1.4, 0.3],
    "of alternating sign": [-1.01, 0.5],
    "an oscillation": [1.006 * np.exp(0.3j), 1.006 * np.exp(-0.3j)],
    "beside an integrator": [1.0, 1.009],
    "slow": [1.004, 0.9],
}


@pytest.mark.parametrize(
    ("kind", "initial"),
    [(kind, (None, "estimate")[k % 2]) for k, kind in enumerate(GROWS)],
)
def test_a_mode_that_grows_costs_what_it_costs(recorded, kind, initial):
    X, y = recorded
    model = with_poles(GROWS[kind], initial, X, y)
    assert model.score(X, y) < -100
    assert VAFScorer()(model, X, y) == VAFScorer()(make_pipeline(model), X, y) < -100
    report = compare(model, X, y, run_in=0)
    assert report.vaf == pytest.approx(model.score(X, y))
    assert report.findings[0].name == "unstable"


@pytest.mark.parametrize("poles", [[0.9995], [1.0, 0.6], [1 + 1e-12, 1.0]])
def test_integrals_are_no_finding_and_keep_their_score(recorded, poles):
    X, _ = recorded
    a, b = np.poly(poles), [0, 0.02, 0.01]
    start = np.eye(1, N)[0]
    clean = [
        lfilter(b, a, X.loc[run, "e"]) + lfilter([level], a, start)
        for run, level in (("a", 1.0), ("b", -2.0))
    ]
    y = pd.Series(np.concatenate(clean), index=INDEX, name="u")
    y += 0.01 * y.std() * np.random.default_rng(1).standard_normal(y.size)
    model = with_poles(poles, "estimate", X, y)
    model.coef_ = np.r_[a[1:], b[1:]]
    assert model.score(X, y) > 99
    assert not any(f.name == "unstable" for f in compare(model, X, y).findings)


@pytest.mark.parametrize(
    ("orders", "steps"),
    [((3, 2, 4), [RunInTrimmer(2.0)]), ((2, 3, 2), [Decimator(2, method="downsample")])],
)
def test_all_places_say_the_same_of_a_model_that_was_fitted(orders, steps):
    """Own forward runs are the truth; of forty recordings, those of which the fit is unstable."""
    seen = 0
    for seed in range(40):
        X, y = ahead(seed)
        model = make_pipeline(*map(clone, steps), ARXRegressor(*orders))
        model.fit(X.loc[["a"]], y.loc[["a"]])
        rows = N // (2 if isinstance(steps[0], Decimator) else 1)
        if rows * np.log(radius(model[-1])) < 9:
            continue
        held = X.loc[["b"]], y.loc[["b"]]
        report = compare(model, *held)
        assert report.vaf < 0
        assert VAFScorer()(model, *held) < 0
        assert report.findings[0].name == "unstable"
        seen += 1
        if seen == 2:
            return
    assert seen


def test_identify_and_its_table_refuse_it(tmp_path, capsys):
    X, y = next(
        data
        for data in map(ahead, range(60))
        if radius(ARXRegressor(2, 2, 4).fit(data[0].loc[["a"]], data[1].loc[["a"]])) > 1.008
    )
    found = identify(X, y, ModelChoice(na=2, nb=2, nk=4, domain="machine"), centered=False)
    assert found.best.verdict is Verdict.UNSTABLE
    X.assign(u=y).reset_index().to_csv(tmp_path / "runs.csv", index=False)
    options = ["--na", "2", "--nb", "2", "--nk", "4", "--keep-means", "--domain", "machine"]
    assert main(["identify", str(tmp_path / "runs.csv"), *options]) == 0
    told = capsys.readouterr().out
    assert "(as given; about zero): unstable" in " ".join(told.split())


@pytest.mark.parametrize("offset", [0.0, -7.5])
def test_an_offset_of_the_free_run_is_said(offset, recorded, tmp_path, capsys):
    X, y = recorded
    off = y + np.where(INDEX.get_level_values("run") == "b", offset, 0.0)
    found = identify(X, off, ModelChoice(na=1, nb=2, nk=1, domain="machine"))
    held, run = off.loc["b"].to_numpy(), found.best.free_run[N:]
    spread = held - held.mean()
    about_mean = 100 * (1 - np.sum((held - run) ** 2) / np.sum(spread**2))
    assert found.best.vaf_validation == pytest.approx(about_mean)
    fit = 100 * (1 - np.linalg.norm(held - run) / np.linalg.norm(spread))
    assert found.best.fit == pytest.approx(fit)
    assert found.best.offset == pytest.approx(np.mean(held - run))
    assert found.best.offset == pytest.approx(offset, abs=0.5)
    report = compare(found.best.pipeline, X.loc[["b"]], off.loc[["b"]], run_in=0)
    assert report.fit == pytest.approx(fit)
    assert report.offset == pytest.approx(found.best.offset)
    X.assign(u=off).reset_index().to_csv(tmp_path / "runs.csv", index=False)
    options = ["--na", "1", "--nb", "2", "--nk", "1", "--domain", "machine"]
    assert main(["identify", str(tmp_path / "runs.csv"), *options]) == 0
    told = capsys.readouterr().out
    assert f"{about_mean:.2f}" in told
    assert f" {fit:.1f} " in told
