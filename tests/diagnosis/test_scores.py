"""Performance scores by window: closed form, the thesis's figures, windows, missing samples."""

import numpy as np
import pandas as pd
import pytest
from support.synthetic import recording

from skhoid import RunInTrimmer, make_tracking_runs
from skhoid.diagnosis.scores import performance_scores
from skhoid.exceptions import RunIndexError, ShortRunError

# facts.json: variance ratio e / f_t over the window of 8,192 samples, without remnant.
SCORE = {"C1": 0.17780685142128813, "C2": 0.1765739971473172}
SCORES = ["rms_e", "tracking_score", "control_activity"]


def sines(n_runs=2, duration=81.92, dt=0.01, start=0.0):
    """Whole periods: var(e) = 2, var(f_t) = 8, var(u) = 0.5; e has the mean 1."""
    t = start + dt * np.arange(round(duration / dt))
    wave = np.sin(2 * np.pi * 100 * t / duration)
    channels = [2 * wave + 1, 4 * wave]
    runs = dict.fromkeys(range(n_runs), (channels, wave))
    return recording(runs, names=("e", "f_t"), dt=dt, start=start)


def test_closed_form():
    X, y = sines()
    scores = performance_scores(X, y, ["T_m"])
    assert scores["run"].tolist() == [0, 1]
    np.testing.assert_allclose(scores["rms_e"], np.sqrt(3), rtol=1e-9)
    np.testing.assert_allclose(scores["tracking_score"], 0.25, rtol=1e-9)
    np.testing.assert_allclose(scores["control_activity"], 0.5, rtol=1e-9)
    assert (scores["n_samples"] == 8192).all()
    assert (scores["n_missing"] == 0).all()


@pytest.mark.parametrize("condition", SCORE)
def test_scores_of_the_thesis(condition):
    X, y = make_tracking_runs(condition, 1, channels=["e", "f_t"])
    found = performance_scores(X, y, ["T_m"])
    assert found["tracking_score"].item() == pytest.approx(SCORE[condition], abs=1e-6)
    assert found["rms_e"].item() == pytest.approx(np.sqrt(np.mean(X["e"] ** 2)), rel=1e-12)
    assert found["control_activity"].item() == pytest.approx(y.var(ddof=0), rel=1e-12)


def test_named_windows_tile_a_run_of_the_thesis():
    X, y = make_tracking_runs("C3", 2, channels=["e", "f_t"], remnant_intensity=0.1, random_state=0)
    scores = performance_scores(X, y).set_index(["run", "window"])
    assert scores.loc[0, "start"].tolist() == pytest.approx([0, 0, 30.72, 51.2])
    assert scores.loc[0, "stop"].tolist() == pytest.approx([81.92, 30.72, 51.2, 81.92])
    assert scores.loc[0, "n_samples"].tolist() == [8192, 3072, 2048, 3072]
    for run in (0, 1):
        e = X.loc[run, "e"].to_numpy()
        f_t = X.loc[run, "f_t"].to_numpy()
        u = y.loc[run].to_numpy()
        for window, rows in {
            "T_m": slice(None),
            "ini": slice(3072),
            "tran": slice(3072, 5120),
            "fin": slice(5120, None),
        }.items():
            expected = [
                np.sqrt(np.mean(e[rows] ** 2)),
                e[rows].var() / f_t[rows].var(),
                u[rows].var(),
            ]
            found = scores.loc[(run, window), SCORES].to_numpy(dtype=float)
            np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_windows_of_ones_own_are_half_open():
    X, y = sines()
    found = performance_scores(X, y, ["T_m", (10.0, 20.0), (70, np.inf)])
    found = found[found["run"] == 0].set_index("window")
    assert found.index.tolist() == ["T_m", "10-20 s", "70-inf s"]
    assert found["n_samples"].tolist() == [8192, 1000, 1192]
    assert found.loc["70-inf s", "stop"] == pytest.approx(81.92)
    by_name = performance_scores(X, y, {"a": "ini", "b": (10.0, 20.0)})
    assert by_name["n_samples"].tolist() == [3072, 1000] * 2


def test_signals_that_follow_from_others():
    X, y = make_tracking_runs("C1", 1, channels=["e", "x", "f_t"])
    whole = performance_scores(X, y)[SCORES]
    for missing in ("e", "x", "f_t"):
        np.testing.assert_allclose(performance_scores(X.drop(columns=missing), y)[SCORES], whole)
    renamed = X.rename(columns={"e": "error", "f_t": "target"})
    roles = {"error": "e", "target": "f_t"}
    np.testing.assert_allclose(performance_scores(renamed, y, roles=roles)[SCORES], whole)


def test_scores_without_their_signals_are_nan():
    X, y = make_tracking_runs("C1", 1)
    scores = performance_scores(X, y)
    assert scores["tracking_score"].isna().all()
    assert scores[["rms_e", "control_activity"]].notna().all(axis=None)
    no_output = performance_scores(X, None)
    assert no_output["control_activity"].isna().all()
    assert performance_scores(X[["e"]].rename(columns={"e": "speed"}), y)["rms_e"].isna().all()
    with pytest.raises(ValueError, match=r"nothing to score.*\['speed'\]"):
        performance_scores(X.rename(columns={"e": "speed"}), None)


def test_missing_samples_are_left_out_and_counted():
    X, y = sines(1)
    e, f_t, u = (values.to_numpy().copy() for values in (X["e"], X["f_t"], y))
    e[100:200], u[150:300], f_t[5000] = np.nan, np.nan, np.nan
    X = X.assign(e=e, f_t=f_t)
    found = performance_scores(X, pd.Series(u, index=y.index, name="u"), ["T_m", "ini"])
    assert found["n_missing"].tolist() == [201, 200]
    assert found["n_samples"].tolist() == [8192, 3072]
    both = ~np.isnan(e) & ~np.isnan(f_t)
    assert found["rms_e"][0] == pytest.approx(np.sqrt(np.nanmean(e**2)))
    assert found["tracking_score"][0] == pytest.approx(e[both].var() / f_t[both].var())
    assert found["control_activity"][0] == pytest.approx(np.nanvar(u))
    nothing = performance_scores(X, np.full(len(X), np.nan), ["T_m"])
    assert nothing["control_activity"].isna().all()


def test_run_in_is_no_part_of_the_run():
    X, y = make_tracking_runs(
        "C1", 2, channels=["e", "f_t"], remnant_intensity=0.1, random_state=0, keep_run_in=10.0
    )
    marked = RunInTrimmer(measurement_time=81.92).fit_transform(X)
    window = X.index.get_level_values("time").to_numpy() >= 0
    pd.testing.assert_frame_equal(
        performance_scores(marked, y), performance_scores(X[window], y[window])
    )


def test_errors_say_what_to_do():
    X, y = sines(duration=20.0)
    with pytest.raises(ShortRunError, match=r"Run 0 lasts from 0 to 20 s.*'ini'.*30\.72 s"):
        performance_scores(X, y)
    with pytest.raises(ShortRunError, match=r"no row in the window \(30\.0, 40\.0\)"):
        performance_scores(X, y, [(30.0, 40.0)])
    with pytest.raises(RunIndexError, match="X has no rows: there is nothing to score"):
        performance_scores(X[:0], y[:0], dt=0.01)
    with pytest.raises(ShortRunError, match="another change="):
        performance_scores(*sines(), ["tran"], change=75.0)
    for wrong in (["middle"], {"a": (5, 1)}):
        with pytest.raises(ValueError, match="must begin before it ends; got"):
            performance_scores(X, y, wrong)
    with pytest.raises(RunIndexError, match="roles names 'error'"):
        performance_scores(X, y, roles={"error": "e"})
    with pytest.raises(ValueError, match=r"2 columns of X have the role 'e': .* Keep it for one"):
        performance_scores(X, y, roles={"f_t": "e"})
    with pytest.raises(ValueError, match="y has 5 values"):
        performance_scores(X, np.zeros(5))
