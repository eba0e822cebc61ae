"""Faults of units, clock and channels are found, and nothing is where nothing is wrong."""

import numpy as np
import pandas as pd
import pytest
from support.synthetic import run_time

from skhoid import load_bicycle_rider, load_human_tracking, make_tracking_runs, resample_runs
from skhoid.exceptions import RunIndexError
from skhoid.recordings import check_channels

DT = 0.01
N = 2000


def names(findings):
    return [finding.name for finding in findings]


def only(findings):
    assert len(findings) == 1, [str(finding) for finding in findings]
    return findings[0]


def smooth(n=N, seed=0, dt=DT, highest=10.0):
    """A signal of ten sines and its derivative."""
    rng = np.random.default_rng(seed)
    omega, phase = rng.uniform(0.3, highest, 10), rng.uniform(0, 2 * np.pi, 10)
    at = np.outer(dt * np.arange(n), omega) + phase
    return np.sin(at).sum(axis=1), (omega * np.cos(at)).sum(axis=1)


def table(n_runs=2, **channels):
    """Channels of runs of equal length, one after the other."""
    n = len(next(iter(channels.values()))) // n_runs
    return pd.DataFrame(channels, index=run_time([n] * n_runs))


# Nothing wrong


@pytest.mark.parametrize(("condition", "intensity"), [("C2", 0.0), ("C6", 0.15)])
def test_nothing_is_wrong_with_simulated_runs(condition, intensity):
    X, y = make_tracking_runs(
        condition,
        2,
        remnant_intensity=intensity,
        channels=["e", "x", "f_t"],
        random_state=0,
    )
    assert check_channels(X, y) == []
    assert check_channels(X) == []


def test_human_recordings_hold_a_stalled_cursor_and_nothing_else():
    """The cursor stands still and jumps 0.2 to 0.7 s after the beginning of recordings.

    Interpolation smooths the smaller of these jumps away.
    """
    X, y = load_human_tracking("all", channels=["f_t", "e"], axis="x")
    finding = only(check_channels(X, y))
    assert finding.name == "first samples"
    assert finding.title.startswith("x is not valid from the beginning of run")
    assert all(f"phase-size {run}" in finding.title for run in ("2e", "3b"))


def test_bicycle_in_the_right_units():
    inputs = ["RollAngle", "RollRate", "YawRate", "PitchRate", "SteerAngle", "ForwardSpeed"]
    X, y = load_bicycle_rider(inputs=inputs, output="SteerTorque")
    assert check_channels(X, y) == []


# Real faults


def test_bicycle_in_the_wrong_units():
    inputs = ["RollAngle", "RollRate", "YawRate", "PitchRate", "RearWheelRate", "SteerAngle"]
    X, y = load_bicycle_rider(inputs=inputs, correct_units=False, output="SteerTorque")
    finding = only(check_channels(X, y))
    assert finding.name == "rate unit"
    assert finding.title == "RollRate is not the derivative of RollAngle: factor 55.4"
    assert "pi/180 too small" in finding.meaning
    assert "Multiply RollRate by 57.2958" in finding.next_step
    # The wheel turns a thousand times as fast, and was converted once.
    assert "YawRate and PitchRate have no angle" in finding.next_step
    assert "RearWheelRate" not in finding.next_step


@pytest.mark.parametrize("recording", [0, 4, 9])
def test_clock_of_the_human_recordings(recording):
    X, y = load_human_tracking(recording, channels=["f_t", "e"], resample=False)
    findings = {finding.name: finding for finding in check_channels(X, y)}
    jitter = findings.pop("clock jitter")
    step = np.diff(X.index.get_level_values("time"))
    worst = 100 * np.abs(step / np.median(step) - 1).max()
    assert f"by up to {worst:.1f} %" in jitter.title
    assert ("more than models accept" in jitter.evidence) == (worst > 10)
    assert "resample_runs" in jitter.next_step
    assert set(findings) <= {"first samples"}
    assert "clock jitter" not in names(check_channels(*resample_runs(X, y)))


# Rates


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (np.pi / 180, "pi/180 too small"),
        (180 / np.pi, "180/pi too large"),
        (1000.0, "1000 times too large"),
        (0.001, "1000 times too small"),
        (DT, "not divided by the sampling time"),
        (2.0, "No common unit conversion"),
        (-1.0, "opposite directions"),
        (-np.pi / 180, "The sign is also opposite"),
    ],
)
def test_factor_of_a_rate(factor, words):
    phi, rate = smooth()
    rng = np.random.default_rng(1)
    phi = phi + 0.02 * rng.standard_normal(N)
    rate = rate + 0.02 * rng.standard_normal(N) * rate.std()
    finding = only(check_channels(table(Angle=phi, AngleRate=factor * rate)))
    assert finding.name == "rate unit"
    assert words in finding.meaning
    found = finding.evidence.split(" changes by ")[1].split()[0]
    assert float(found) == pytest.approx(1 / factor, rel=0.01)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_right_rate_is_right(noise):
    phi, rate = smooth()
    rng = np.random.default_rng(1)
    noisy = phi + noise * rng.standard_normal(N)
    assert check_channels(table(phi=noisy, phi_rate=1.05 * rate)) == []
    assert check_channels(table(phi=phi, phi_rate=rate + 3 * noise * rng.standard_normal(N))) == []


def test_other_signal_than_the_rate():
    phi, other = smooth()[0], smooth(seed=1)[1]
    finding = only(check_channels(table(phi=phi, phi_rate=other)))
    assert finding.title == "phi_rate is not the derivative of phi"


def test_rate_with_gaps_wraps_and_missing_samples():
    phi, rate = smooth(n=4000)
    heading = np.mod(phi, 2.0)  # wraps
    rate = np.rad2deg(rate)
    rate[100:110] = np.nan
    X = table(n_runs=2, heading=heading, heading_rate=rate)
    X = X[(X.index.get_level_values("time") < 5) | (X.index.get_level_values("time") > 7)]
    assert sorted(names(check_channels(X))) == ["gaps", "missing samples", "rate unit"]


# The error


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"e": -1.0}, "e has the opposite sign"),
        ({"x": -1.0}, "x has the opposite sign"),
        ({"e": 180 / np.pi}, "e is not in the unit of f_t and x: it is 57.2958 times as large"),
        ({"x": 0.5}, "x is not in the unit of e: multiply it by 2"),
        ({"f_t": 0.5}, "f_t is not in the unit of e: multiply it by 2"),
    ],
)
def test_error_that_is_not_target_minus_output(change, words):
    X, y = make_tracking_runs("C1", 2, channels=["e", "x", "f_t"])
    X = X.assign(**{name: factor * X[name] for name, factor in change.items()})
    finding = only(check_channels(X, y))
    assert finding.name == "error signal"
    assert words in finding.meaning


def test_error_of_another_signal():
    X, y = make_tracking_runs("C1", 2, channels=["e", "x", "f_t"])
    late = X.assign(e=np.roll(X["e"], 5))
    assert "not the signal that its name says" in only(check_channels(late, y)).meaning
    offset = X.assign(e=X["e"] + 0.2)
    assert only(check_channels(offset, y)).meaning == "e has an offset of 0.2."
    rounded = X.assign(e=X["e"].round(4))
    assert check_channels(rounded, y) == []


# Copies


@pytest.mark.parametrize(
    ("gain", "title", "shift"),
    [
        (1.0, "b is a copy of a", 0),
        (-1.0, "b is a with the opposite sign", 3),
        (2.5, "b is a times 2.5", 0),
    ],
)
def test_copies(gain, title, shift):
    rng = np.random.default_rng(0)
    for a in (smooth()[0], rng.standard_normal(N)):
        finding = only(check_channels(table(1, a=a[3:], b=gain * a[3 - shift : N - shift] + 7.0)))
        late = {0: "", 1: ", 1 sample late", 3: ", 3 samples late"}[shift]
        assert finding.name == "copy"
        assert finding.title == title + late


def test_output_among_the_inputs():
    X, y = make_tracking_runs("C1", 2, channels=["e", "f_t"], remnant_intensity=0.1, random_state=0)
    finding = only(check_channels(X.assign(stick=3 * y), y))
    assert "stick is the output itself" in finding.meaning
    assert only(check_channels(X.assign(u=y), y)).title == "u (y) is a copy of u"


def test_what_is_alike_is_no_copy():
    a = smooth()[0]
    rng = np.random.default_rng(0)
    assert check_channels(table(a=a, b=a + 1e-2 * rng.standard_normal(N))) == []


# The beginning of runs


def test_cursor_that_is_not_yet_there():
    x = smooth()[0] + 20
    x[:15] = 0.0
    finding = only(check_channels(table(x=x)))
    assert finding.title == "x is not valid from the beginning of run 1"
    assert "after 15 samples (0.15 s)" in finding.evidence
    assert "run_in=0.15" in finding.next_step


def test_operator_that_is_not_yet_there():
    x = smooth()[0]
    x[:60] = x[60]
    finding = only(check_channels(table(x=x)))
    assert finding.title == "x is constant at the beginning of run 1"
    assert "first 61 samples of run 1" in finding.evidence


def test_steps_pulses_and_pauses_are_no_fault():
    step = np.where(np.arange(N) % 1000 < 50, 0.0, 1.0)
    pulse = 0.01 * smooth()[0]
    pulse[10:50] += 5.0
    quantised = np.round(2 * smooth()[0]) / 2
    assert check_channels(table(f_t=step, button=pulse, x=quantised)) == []


# The clock


def counted_in_rows(X):
    run = X.index.get_level_values("run")
    time = X.groupby("run").cumcount().to_numpy()
    X.index = pd.MultiIndex.from_arrays([run, time], names=["run", "time"])
    return X


def test_row_numbers_or_milliseconds():
    """Of a person, who has an error and a target; a furnace may tick so."""
    e, other = smooth()[0], smooth(seed=7)[0]
    finding = only(check_channels(counted_in_rows(table(e=e, f_t=other))))
    assert (finding.name, finding.title) == ("clock unit", "The clock advances by 1 per row")
    assert check_channels(counted_in_rows(table(gas=e, heat=other))) == []


def test_small_jitter_and_gaps():
    phi = smooth()[0]
    X = table(1, e=phi)
    time = DT * np.arange(N)
    assert check_channels(X) == []
    jitter = np.random.default_rng(0).uniform(-0.02, 0.02, N) * DT
    X.index = pd.MultiIndex.from_arrays([np.zeros(N, int), time + jitter], names=["run", "time"])
    assert "tolerated" in only(check_channels(X)).evidence
    jitter *= 10
    X.index = pd.MultiIndex.from_arrays([np.zeros(N, int), time + jitter], names=["run", "time"])
    finding = only(check_channels(X))
    assert finding.name == "clock jitter"
    assert "more than models accept" in finding.evidence
    X.index = pd.Index(time + np.where(time > 9.995, 0.5, 0.0), name="time")
    finding = only(check_channels(X))
    assert finding.name == "gaps"
    assert "0.51 s (51.0 steps), after run 0, t = 9.99 s" in finding.evidence


def test_runs_that_differ_in_sampling_time():
    phi = smooth()[0]
    X = table(e=phi)
    time = np.concatenate([0.01 * np.arange(1000), 0.02 * np.arange(1000)])
    X.index = pd.MultiIndex.from_arrays([np.repeat([1, 2], 1000), time], names=["run", "time"])
    finding = check_channels(X)[0]
    assert finding.name == "sampling time"
    assert "0.01 s in one run and 0.02 s" in finding.evidence


def test_rows_out_of_order_are_an_error():
    X = table(1, e=smooth()[0])
    with pytest.raises(RunIndexError, match="shuffled"):
        check_channels(X.sample(frac=1, random_state=0))
    with pytest.raises(RunIndexError):
        check_channels(X.iloc[:0])


# Slower recordings


@pytest.mark.parametrize("factor", [2, 20])
def test_held_samples(factor):
    x = np.repeat(smooth(n=N // factor, dt=factor * DT)[0], factor)
    finding = only(check_channels(table(1, x=x)))
    assert finding.title == f"x is held over {factor} samples"
    assert f"recorded at {100 / factor:g} Hz" in finding.meaning


def test_samples_held_from_another_clock():
    t = DT * np.arange(N)
    x = smooth(n=N, dt=1 / 60)[0][np.floor(t * 60 + 1e-9).astype(int)]
    finding = only(check_channels(table(1, x=x)))
    assert finding.name == "held samples"
    found = float(finding.meaning.removeprefix("It was recorded at ").split()[0])
    assert found == pytest.approx(60, rel=0.01)


@pytest.mark.parametrize("single", [False, True])
def test_linear_interpolation(single):
    coarse = smooth(n=N // 3 + 2, dt=3 * DT)[0]
    x = np.interp(np.arange(N), 3 * np.arange(coarse.size), coarse)
    x = x.astype(np.float32) if single else x
    finding = only(check_channels(table(1, x=x)))
    assert finding.title == "x is interpolated over 3 samples"


def test_what_is_no_slower_recording():
    x = smooth(n=8192)[0]
    steps = np.repeat(np.random.default_rng(0).standard_normal(9), 1000)[:8192]
    ramp = np.interp(np.arange(8192), np.arange(0, 9000, 1000), np.arange(9.0) % 2)
    rounded = [np.round(x, digits) for digits in (0, 1, 2)]
    for channel in (x, steps, ramp, x.astype(np.float32), *rounded):
        assert check_channels(table(1, e=channel)) == []
    X, y = make_tracking_runs("C1", 1, remnant_intensity=0.1, random_state=0)
    fine, fine_y = resample_runs(X, y, dt=0.005)
    assert check_channels(fine, fine_y) == []


# Missing and constant channels


def test_missing_and_constant_channels():
    x = smooth()[0]
    partly = x.copy()
    partly[200:230] = np.nan
    partly[1500] = np.nan
    some = np.where(np.arange(N) < N // 2, 3.0, x)
    X = table(x=x, y=partly, supply=np.full(N, 5.0), nothing=np.full(N, np.nan), some=some)
    found = {finding.title: finding for finding in check_channels(X)}
    assert (
        "longest stretch 30 rows (0.3 s) from run 1, t = 2 s"
        in found["y has 31 missing samples"].evidence
    )
    assert found["nothing has no values"].next_step == "Leave the channel out."
    assert found["supply is constant"].evidence == "It is 5 in every row."
    assert found["some is constant in run 1"].evidence == "It is 3 in every row of run 1."


def test_arrays_and_run_columns():
    phi, rate = smooth()
    X = table(run_number=np.repeat([1.0, 2.0], N // 2), phi=phi, phi_rate=np.rad2deg(rate))
    plain = X.reset_index(drop=True)
    assert only(check_channels(plain, dt=DT, run="run_number")).name == "rate unit"
    assert check_channels(np.column_stack([phi, rate]), dt=DT) == []
    copied = check_channels(np.column_stack([phi, phi]), 2 * phi, dt=DT)
    assert names(copied) == ["copy"] * 3


def turning(turn, *, start=0.0, slope=0.3, n=2000):
    """An angle that goes on turning, slowly and unevenly."""
    return np.mod(turn * (start + np.cumsum(slope + np.sin(np.arange(n) / 90)) / 400), turn)


@pytest.mark.parametrize(
    "angle",
    [
        turning(360.0),
        turning(2 * np.pi),
        turning(360.0, start=0.9) - 180.0,
        turning(2 * np.pi, slope=-0.4) - np.pi,
        turning(360.0, start=0.4, slope=0.2),
    ],
)
def test_an_angle_that_wraps_is_said(angle):
    found = [one for one in check_channels(angle[:, None], dt=0.02) if one.name == "wrapped angle"]
    assert len(found) == 1
    turn = 360.0 if np.ptp(angle) > 7 else 2 * np.pi
    assert f"period={turn:.8g}" in found[0].next_step
    whole = np.unwrap(angle, period=turn)
    assert not [o for o in check_channels(whole[:, None], dt=0.02) if o.name == "wrapped angle"]


@pytest.mark.parametrize(
    "other",
    [
        np.sign(np.sin(np.arange(2000) / 90)) * 3.0,  # a square wave of 6
        np.where(np.arange(2000) % 500 == 7, 300.0, 0.0),  # spikes
        np.repeat(np.random.default_rng(0).uniform(0, 6, 40), 50),
        360 * np.random.default_rng(0).uniform(size=2000),
    ],
)
def test_what_jumps_and_is_no_angle_is_not(other):
    assert not [o for o in check_channels(other[:, None], dt=0.02) if o.name == "wrapped angle"]
