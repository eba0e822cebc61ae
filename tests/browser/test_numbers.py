"""What the component computes in the page is what Python computes, to 1e-9 of its size."""

import base64

import numpy as np
import pytest
from scipy.signal import welch
from scipy.stats import binned_statistic

from skhoid import vaf_score
from skhoid.lab.explore import component
from skhoid.lab.explore import payloads as wire
from skhoid.metrics import vaf_of_rows
from skhoid.runs import read_layout

CALL = """
const [name, packed] = arguments;
const bytes = Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0));
const found = skhoidBench.numbers[name](...skhoidBench.wire.unpack(bytes.buffer));
const plain = (value) => {
  if (value === null || typeof value === "string") return value;
  if (typeof value === "number") return String(value);
  if (ArrayBuffer.isView(value)) return Array.from(value, String);
  return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, plain(one)]));
};
return plain(found);
"""


@pytest.fixture(scope="module")
def numbers(browser, tmp_path_factory):
    """Call a function of the page's by its name; numbers travel without rounding."""
    path = tmp_path_factory.mktemp("numbers") / "page.html"
    script = f"{component.script()}window.skhoidBench = skhoidBench;"
    head = (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>Numbers</title></head>'
    )
    path.write_text(f"{head}<body><script>{script}</script></body></html>", encoding="utf-8")

    def call(name, *arguments):
        if browser.driver.current_url != path.as_uri():
            browser.open(path)
        packed = base64.b64encode(wire.pack(list(arguments))).decode()
        return as_numbers(browser.js(CALL, name, packed))

    return call


def as_numbers(value):
    if isinstance(value, dict):
        return {key: as_numbers(one) for key, one in value.items()}
    if isinstance(value, list):
        return np.array(value, dtype=float)
    return None if value is None else float(value)


def close(found, expected):
    scale = np.nanmax(np.abs(expected), initial=1e-300)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * scale)


def signals(seed, n, missing=0.0):
    """A measured output with holes, a simulated one and which rows are scored."""
    rng = np.random.default_rng(seed)
    y = np.cumsum(rng.normal(size=n)) * 0.1 + rng.normal() * 3
    simulated = y + rng.normal(size=n) * rng.choice([0.01, 1.0, 100.0])
    y[rng.random(n) < missing] = np.nan
    return y, simulated, rng.random(n) > 0.1


WINDOWS = [(0, 8192), (0, 1), (17, 33), (100, 5000), (8000, 8192), (4096, 8192)]


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_vaf_and_rmse_of_a_window(numbers, window, missing):
    y, simulated, scored = signals(sum(window), 8192, missing)
    scored[window[0]] = True
    y[window[0]] = 1.5
    rows = np.zeros(y.size, dtype=bool)
    rows[slice(*window)] = True
    layout = read_layout(y.reshape(-1, 1), dt=0.01)
    keep = rows & scored & ~np.isnan(y)
    expected = vaf_of_rows(y, simulated, keep, layout, "pooled", False)
    found = numbers("vafOf", y, simulated, scored, *window)
    if expected > -1000:  # the floor of scores
        close(found, expected)
    error = (y - simulated)[keep]
    close(numbers("rmseOf", y, simulated, scored, *window), np.sqrt(np.mean(error**2)))


def test_vaf_is_that_of_the_public_function(numbers):
    y, _, _ = signals(5, 3000)
    simulated = y + 0.1
    found = numbers("vafOf", y, simulated, np.ones(3000, dtype=bool), 1000, 2500)
    close(found, vaf_score(y, simulated, window=(10.0, 25.0), dt=0.01))


@pytest.mark.parametrize("missing", [0.0, 0.1])
@pytest.mark.parametrize("window", [(0, 8192), (5, 21), (0, 4096), (0, 4095), (300, 7777)])
def test_spectrum_is_welchs(numbers, window, missing):
    x, _, _ = signals(sum(window) + 1, 8192, missing)
    part = x[slice(*window)]
    filled = np.where(np.isnan(part), 0.0, part - np.nanmean(part))
    length = min(4096, 2 ** int(np.log2(part.size)))
    options = {"window": "hann", "nperseg": length, "noverlap": length // 2}
    f, density = welch(filled, fs=50.0, detrend="constant", **options)
    found = numbers("spectrumOf", x, 0.02, *window)
    close(found["omega"], 2 * np.pi * f)
    close(found["density"], density / (2 * np.pi))


def test_too_few_rows_have_no_spectrum(numbers):
    assert numbers("spectrumOf", np.arange(100.0), 0.01, 10, 25) is None


@pytest.mark.parametrize("n", [1, 2, 1000, 4096, 8191])
@pytest.mark.parametrize("band", [(0.0, 1e9), (1.0, 4.0), (0.5, 0.6), (300.0, 400.0)])
def test_band_is_what_the_transform_has_in_it(numbers, n, band):
    x, _, _ = signals(n, n, missing=0.05 if n > 10 else 0.0)
    level = np.where(np.isnan(x), 0.0, x - np.nanmean(x))
    size = 2 ** int(np.ceil(np.log2(max(n, 2))))
    spectrum = np.fft.rfft(level, size)
    omega = 2 * np.pi * np.fft.rfftfreq(size, 0.01)
    spectrum[(omega < band[0]) | (omega > band[1])] = 0.0
    expected = np.fft.irfft(spectrum, size)[:n]
    scale = max(np.abs(level).max(), 1e-12)
    np.testing.assert_allclose(numbers("bandOf", x, 0.01, *band), expected, atol=1e-9 * scale)
    whole = np.sum(level**2)
    share = numbers("bandShare", x, 0.01, *band)
    if whole > 0:
        np.testing.assert_allclose(share, np.sum(expected**2) / whole, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_residual_over_amplitude(numbers, seed):
    r, a, mask = signals(seed, 4000, missing=0.05)
    begin, end = 100 * seed, 4000 - 300 * seed
    found = numbers("overAmplitude", r, a, mask, begin, end)
    rows = np.zeros(4000, dtype=bool)
    rows[begin:end] = True
    rows &= mask & ~np.isnan(r)
    edges = np.linspace(a[rows].min(), a[rows].max(), 22)
    mean, _, _ = binned_statistic(a[rows], r[rows], "mean", edges)
    square, _, _ = binned_statistic(a[rows], r[rows] ** 2, "mean", edges)
    count, _, _ = binned_statistic(a[rows], r[rows], "count", edges)
    np.testing.assert_array_equal(found["count"], count)
    close(found["mean"], mean)
    close(found["rms"], np.sqrt(square))
    close(found["centre"], (edges[1:] + edges[:-1]) / 2)


def test_a_channel_that_does_not_move_has_one_bin(numbers):
    found = numbers("overAmplitude", np.arange(10.0), np.full(10, 2.0), None, 0, 10)
    assert found["count"].tolist() == [10.0] + [0.0] * 20
    assert found["mean"][0] == 4.5


def test_a_compact_array_is_read_as_python_reads_it(browser, numbers):
    values = np.r_[np.nan, np.sin(np.arange(500.0)), 1e3, -1e3, np.nan]
    packed = base64.b64encode(wire.pack(values, compact=True)).decode()
    numbers("rmseOf", np.ones(1), np.ones(1), np.ones(1), 0, 1)  # opens the page
    found = browser.js(
        "const bytes = Uint8Array.from(atob(arguments[0]), (c) => c.charCodeAt(0));"
        "return Array.from(skhoidBench.wire.unpack(bytes.buffer), String);",
        packed,
    )
    np.testing.assert_array_equal(as_numbers(found), wire.unpack(wire.pack(values, compact=True)))
