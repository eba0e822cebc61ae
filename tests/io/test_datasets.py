"""The recordings of the package against their sources and the facts known of them."""

from importlib import resources

import numpy as np
import pandas as pd
import pytest
from support.places import RECORDINGS, ROOT

from skhoid.io import load_bicycle_rider, load_human_tracking

SHARED = RECORDINGS
needs_source = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the source recordings are not part of the repository"
)
LABELS = [
    "difficulty 50",
    "difficulty 80",
    "phase-size 1",
    "phase-size 2a",
    "phase-size 2b",
    "phase-size 2c",
    "phase-size 2d",
    "phase-size 2e",
    "phase-size 3a",
    "phase-size 3b",
]
RATES = ["RollRate", "YawRate", "PitchRate"]


def run_lengths(X):
    return X.groupby(level="run", sort=False).size()


def free_run_vaf(u, y, delay):
    """VAF of ARX(2, 2, delay), fitted on the first half, running freely on the second."""
    first = delay + 1
    columns = [y[first - 1 : -1], y[first - 2 : -2]]
    columns += [u[first - delay - k : len(u) - delay - k] for k in (0, 1)]
    phi = np.column_stack(columns)
    half = len(y) // 2
    theta = np.linalg.lstsq(phi[:half], y[first : first + half], rcond=None)[0]
    free = y[:half].tolist()
    for k in range(half, len(y)):
        row = [free[-1], free[-2], u[k - delay], u[k - delay - 1]]
        free.append(float(np.dot(theta, row)))
    error, truth = y[half:] - free[half:], y[half:]
    return 100 * (1 - np.sum(error**2) / np.sum((truth - truth.mean()) ** 2))


class TestHumanTracking:
    def test_rows_and_labels(self):
        X, y = load_human_tracking(resample=False)
        assert X.index.names == ["run", "time"]
        assert X.index.equals(y.index)
        assert run_lengths(X).to_dict() == dict(zip(LABELS, [3589] * 2 + [4789] * 8, strict=True))
        assert X.columns.to_list() == ["f_t"]
        assert y.name == "x"
        assert X.notna().all(axis=None)
        assert y.notna().all()
        assert not np.any(y == 0)

    def test_clock(self):
        X, _ = load_human_tracking(resample=False)
        for _, run in X.groupby(level="run"):
            time = run.index.get_level_values("time").to_numpy()
            step = np.diff(time)
            assert time[0] == 0
            assert np.median(step) == pytest.approx(1 / 60, rel=1e-3)
            assert 1 / 60 - 1e-6 < step.min() <= step.max() < 0.0192

    def test_resampled(self):
        X, y = load_human_tracking([0, "phase-size 1"], axis="y")
        assert list(run_lengths(X).index) == ["difficulty 50", "phase-size 1"]
        raw_X, raw_y = load_human_tracking([0, "phase-size 1"], axis="y", resample=False)
        for label, run in X.groupby(level="run"):
            time = run.index.get_level_values("time").to_numpy()
            np.testing.assert_allclose(time, np.arange(time.size) / 60, rtol=0, atol=1e-9)
            raw_time = raw_X.loc[label].index
            assert raw_time[-1] - 1 / 60 < time[-1] <= raw_time[-1]
            # A smooth target: linear and cubic interpolation are within a pixel of each other.
            linear = np.interp(time, raw_time, raw_X.loc[label, "f_t"])
            assert np.max(np.abs(run["f_t"] - linear)) < 2
            linear = np.interp(time, raw_time, raw_y.loc[label])
            assert np.median(np.abs(y.loc[label] - linear)) < 1
        assert X.attrs == {"units": {"f_t": "px"}}
        assert y.attrs == {"units": {"x": "px"}}

    @needs_source
    def test_source(self):
        source = pd.read_parquet(SHARED / "human_tracking_2d" / "random_and_phase_size.parquet")
        for k, label in enumerate(LABELS):
            frame = source[source["rec"] == k].iloc[10:]
            channels = ["f_t", "e"] + (["size_s", "phase_f"] if k > 1 else [])
            for axis in ("x", "y"):
                X, y = load_human_tracking(k, axis=axis, channels=channels, resample=False)
                assert X.index[0][0] == label
                time = frame["t"] - frame["t"].iloc[0]
                np.testing.assert_allclose(X.index.get_level_values("time"), time, atol=1.1e-7)
                np.testing.assert_array_equal(y, frame[f"cursor_{axis}"])
                np.testing.assert_allclose(X["f_t"], frame[f"target_{axis}"], rtol=0, atol=6.2e-5)
                np.testing.assert_array_equal(X["e"], X["f_t"] - y)
                for name in channels[2:]:
                    np.testing.assert_allclose(X[name], frame[name], rtol=0, atol=6.2e-5)

    @pytest.mark.parametrize(
        ("label", "axis", "vaf"),
        [
            ("difficulty 50", "x", 96.7),
            ("difficulty 80", "y", 87.6),
        ],
    )
    def test_known_vaf(self, label, axis, vaf):
        X, y = load_human_tracking(label, axis=axis)
        u = X["f_t"].to_numpy() - X["f_t"].mean()
        y = y.to_numpy() - y.mean()
        # The source does not say how it treats offset and first frames; that is worth a point.
        assert free_run_vaf(u, y, delay=1) == pytest.approx(vaf, abs=1.2)
        assert max(free_run_vaf(u, y, delay=k) for k in (6, 7, 8)) > free_run_vaf(u, y, delay=1)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"recordings": 10}, "no recording 10: .*positions 0 to 9"),
            ({"recordings": "difficulty 60"}, "no recording 'difficulty 60'.*'difficulty 50'"),
            ({"recordings": [0, "difficulty 50"]}, "each recording once"),
            ({"axis": "z"}, "'axis' parameter of load_human_tracking must be a str among"),
            ({"channels": "x"}, "channels has 'x'; the channels are f_t, e, size_s, phase_f"),
            ({"channels": ["phase_f"]}, "'difficulty 50' has no phase_f"),
        ],
    )
    def test_errors(self, arguments, message):
        with pytest.raises(ValueError, match=message):
            load_human_tracking(**arguments)


class TestBicycleRider:
    def test_default(self):
        X, y = load_bicycle_rider()
        assert X.columns.to_list() == ["RollAngle"]
        assert y.name == "SteerAngle"
        assert len(X) == len(y) == 11938
        assert X.index.equals(y.index)
        np.testing.assert_array_equal(X.index.get_level_values("time"), np.arange(11938) / 200)
        assert set(X.index.get_level_values("run")) == {"00105"}
        assert X.attrs == {"units": {"RollAngle": "rad"}}
        assert y.attrs == {"units": {"SteerAngle": "rad"}}

    def test_unit_fault(self):
        X, _ = load_bicycle_rider(inputs=["RollAngle", *RATES])
        faulty, _ = load_bicycle_rider(inputs=RATES, correct_units=False)
        np.testing.assert_allclose(X[RATES], faulty * 180 / np.pi, rtol=1e-15)
        slope = np.gradient(X["RollAngle"].to_numpy(), 1 / 200)
        # The source's figure: d(RollAngle)/dt is 53.9 times the rate (fitted with an offset).
        factor, _ = np.polyfit(faulty["RollRate"].to_numpy(), slope, 1)
        assert factor == pytest.approx(53.9, abs=0.05)
        factor, _ = np.polyfit(X["RollRate"].to_numpy(), slope, 1)
        assert 0.9 < factor < 1

    @needs_source
    def test_source(self):
        source = pd.read_parquet(SHARED / "bicycle_rider" / "run00105.parquet")
        names = [name for name in source if name not in ("time", "SteerTorque")]
        X, y = load_bicycle_rider(inputs=names, output="SteerTorque", correct_units=False)
        np.testing.assert_allclose(X, source[names], rtol=6e-8)
        np.testing.assert_allclose(y, source["SteerTorque"], rtol=6e-8)
        np.testing.assert_array_equal(X.index.get_level_values("time"), source["time"])

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"inputs": "Roll"}, "inputs has 'Roll'; the channels are SteerAngle"),
            ({"output": "time"}, "output has 'time'"),
        ],
    )
    def test_errors(self, arguments, message):
        with pytest.raises(ValueError, match=message):
            load_bicycle_rider(**arguments)


def test_size_and_licences():
    files = {file.name: file for file in resources.files("skhoid.io").joinpath("data").iterdir()}
    archives = [file for name, file in files.items() if name.endswith(".npz")]
    assert sum(len(file.read_bytes()) for file in archives) < 1_000_000
    assert "Copyright (c) 2022 adam-matic" in files["LICENSE-human-tracking.txt"].read_text()
    assert "10.6084/m9.figshare.659465" in files["LICENSE-bicycle-rider.txt"].read_text()


@needs_source
def test_conversion_is_reproducible(tmp_path, monkeypatch):
    script = ROOT / "tools" / "convert_recordings.py"
    monkeypatch.setattr("sys.argv", [str(script), str(SHARED), str(tmp_path)])
    names = {"__name__": "__main__", "__file__": str(script)}
    exec(compile(script.read_text(), str(script), "exec"), names)
    for name in ("human_tracking.npz", "bicycle_rider.npz"):
        packed = resources.files("skhoid.io").joinpath("data", name)
        with np.load(tmp_path / name) as made, packed.open("rb") as file, np.load(file) as kept:
            assert made.files == kept.files
            for key in made.files:
                np.testing.assert_array_equal(made[key], kept[key])
