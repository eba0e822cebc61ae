"""Effects that are noise to the free run: tremor, and those of users."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Dimension, Effect, Parameter, Signature, Tremor
from skhoid.search.judges import without_noise
from skhoid.testing import check_effect, synthetic_record


class Hum(Effect):
    """A steady tone of known frequency."""

    name = "hum"
    place = "sum"
    physics = "The mains hum."
    formula = "u + amplitude sin(2 pi 16.7 t + phase)"
    noise = "a hum"
    parameters = (Parameter("amplitude", Dimension(u=1), 0.0, 5.0, (0.1,), "of the hum"),)

    def apply(self, signal, record, amplitude):
        return signal

    def signature(self, residual, record):
        wave = np.exp(2j * np.pi * 16.7 * record.t)
        amplitude = 2 * np.abs(np.mean(residual * wave, axis=0)).mean()
        share = amplitude**2 / 2 / record.sd("u") ** 2
        if share < 0.01:
            return None
        return Signature("frequency", share, "a hum", f"amplitude = {amplitude:.3g}")

    def realisation(self, values, t=None):
        t = np.linspace(0.0, 0.3, 300) if t is None else t
        return t, values["amplitude"] * np.sin(2 * np.pi * 16.7 * t)


def toned(hertz, amplitude):
    """A record, and a residual that is a line in white noise."""
    record = synthetic_record()
    rng = np.random.default_rng(0)
    size = amplitude * record.sd("u")
    residual = 0.1 * rng.standard_normal(record.known.shape) * record.sd("u")
    residual += size * np.sin(2 * np.pi * hertz * record.t + rng.uniform(0, 6, record.n_runs))
    residual[~record.known] = 0.0
    return record, residual, size


def test_a_line_in_the_band_is_recognised():
    record, residual, size = toned(9.3, 0.3)
    found = Tremor().signature(residual, record)
    assert found.where == "frequency"
    assert found.share == pytest.approx(0.045, rel=0.15)
    frequency, amplitude = (float(part.split()[2]) for part in found.parameters.split(", "))
    assert frequency == pytest.approx(9.3, abs=0.06)
    assert amplitude == pytest.approx(size, rel=0.1)
    assert found.words == f"a line at 9.3 Hz, {100 * found.share:.1f} % of the output"


@pytest.mark.parametrize(("hertz", "amplitude"), [(9.3, 0.0), (3.0, 0.3), (18.0, 0.3)])
def test_nothing_is_recognised_in_noise_and_out_of_the_band(hertz, amplitude):
    record, residual, _ = toned(hertz, amplitude)
    assert Tremor().signature(residual, record) is None


def test_short_or_slow_recordings_show_no_line():
    record, residual, _ = toned(9.3, 0.3)
    assert Tremor().signature(residual[:400], record.beginning(8.0)) is None
    assert Tremor().signature(residual, replace(record, dt=1 / 25)) is None


@pytest.fixture(scope="module")
def humming():
    X, y = make_tracking_runs("C1", n_runs=2, duration=40.96, sampling_rate=50, random_state=0)
    t = y.index.get_level_values("time")
    hum = 0.3 * y.std() * np.sin(2 * np.pi * 16.7 * np.asarray(t) + 1.0)
    return X, pd.Series(y + hum, name="u")


@pytest.mark.slow
def test_noise_of_a_user_is_found_by_a_search(humming):
    check_effect(Hum())
    search = EffectSearchCV(OperatorRegressor(), effects=["bias", Hum()]).fit(*humming)
    assert search.best_effects_ == ["hum"]
    row = search.ranking_.set_index("effect").loc["hum"]
    assert (row["status"], row["rank"]) == ("added", 2)
    assert row["words"] == "The mains hum. It is noise to the free run: a hum."
    assert row["parameters"].startswith("amplitude = ")


def test_the_tremor_of_each_run_is_taken_out_whatever_its_phase():
    record, residual, _ = toned(9.3, 0.3)
    record = replace(record, y=residual)
    quiet = without_noise(record, np.zeros_like(residual), [Tremor()])
    assert Tremor().signature(quiet.y, record) is None
    left, before = quiet.y[record.known].std(), residual[record.known].std()
    assert left == pytest.approx(before / np.sqrt(5.5), rel=0.1)  # 0.3^2 / 2 beside 0.1^2
    noise = toned(9.3, 0.0)[1]
    assert without_noise(record, residual - noise, [Tremor()]) is None  # a model explains it


def test_what_is_no_tremor_stays_in_the_output():
    record, residual, _ = toned(9.3, 0.3)
    slow = record.sd("u") * np.sin(2 * np.pi * 1.1 * record.t) * record.known
    record = replace(record, y=residual + slow)
    quiet = without_noise(record, slow, [Tremor()])
    taken = (record.y - quiet.y)[record.known]
    assert abs(np.corrcoef(taken, slow[record.known])[0, 1]) < 0.02
