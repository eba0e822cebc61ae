"""Forcing functions: Table I, phases, interleaved lines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skhoid import Multisine

# Multisines


def test_target_of_the_thesis():
    f_t = Multisine()
    f = f_t(np.arange(8192) / 100)
    assert np.var(f, ddof=1) == pytest.approx(2.2490040366255646, abs=5e-5)  # ft.variance_deg2
    assert f_t.crest_factor() == pytest.approx(2.6930107053410755, abs=5e-5)  # ft.crest_factor
    assert np.mean(f) == pytest.approx(0.0, abs=1e-12)
    spectrum = np.abs(np.fft.rfft(f)) / 4096
    np.testing.assert_allclose(spectrum[list(f_t.multiples)], f_t.amplitudes, rtol=1e-10)
    assert np.delete(spectrum, f_t.multiples).max() < 1e-12
    np.testing.assert_allclose(
        f_t.omega,
        [0.230, 0.383, 0.614, 0.997, 1.687, 2.608, 4.065, 6.596, 10.661, 17.564],
        atol=5e-4,
    )


@settings(max_examples=40, deadline=None)
@given(
    st.integers(-20_000, 20_000),
    st.integers(1, 3000),
    st.sampled_from([50.0, 100.0, 99.7, 1000.0]),
    st.sampled_from([81.92, 1.7, 3.0, 2.345678]),
)
def test_samples_are_values(first, n_samples, rate, period):
    f = Multisine((1, 3), (1.0, 0.5), (0.2, 1.0), period)
    expected = f(np.arange(first, first + n_samples) / rate)
    np.testing.assert_allclose(f.sample(first, n_samples, rate), expected, rtol=0, atol=1e-9)


def test_samples_repeat_exactly():
    f = Multisine().sample(-8192, 3 * 8192, 100.0)
    np.testing.assert_array_equal(f[:8192], f[8192:16384])
    np.testing.assert_array_equal(f[:8192], f[16384:])


def test_random_phases():
    f = Multisine()
    one, same, other = (f.with_random_phases(seed) for seed in (0, 0, 1))
    assert one == same
    assert one != other
    assert (one.multiples, one.amplitudes, one.period) == (f.multiples, f.amplitudes, f.period)
    phases = np.concatenate([f.with_random_phases(seed).phases for seed in range(400)])
    assert np.abs(phases).max() <= np.pi
    # 4000 draws: mean resultant length below 4 sigma, sigma = 1 / sqrt(4000).
    assert np.abs(np.exp(1j * phases).mean()) < 4 / np.sqrt(4000)


def test_crest_factor_of_one_line():
    line = Multisine((2,), (3.0,), (0.3,), 10.0)
    assert line.crest_factor() == pytest.approx(np.sqrt(2), rel=1e-4)


@pytest.mark.parametrize(("multiples", "offset"), [((3, 9, 20), 1), ((3, 4, 6), 4)])
def test_interleaved(multiples, offset):
    f = Multisine(multiples, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    second = f.interleaved(scale=0.5, random_state=3)
    assert second.multiples == tuple(n + offset for n in f.multiples)
    assert second.amplitudes == (0.5, 1.0, 1.5)
    assert second == f.interleaved(scale=0.5, random_state=3)
    t = np.arange(8192) / 100
    assert np.dot(f(t), second(t)) == pytest.approx(0.0, abs=1e-8)
