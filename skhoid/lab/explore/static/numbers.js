// What the page computes itself. Tested against Python: keep both the same.

const FFT_TABLES = new Map();

// Cosines, sines and bit-reversed places of a length that is a power of two.
function fftTable(n) {
  if (FFT_TABLES.has(n)) return FFT_TABLES.get(n);
  const cos = new Float64Array(n / 2);
  const sin = new Float64Array(n / 2);
  for (let k = 0; k < n / 2; k++) {
    cos[k] = Math.cos((2 * Math.PI * k) / n);
    sin[k] = Math.sin((2 * Math.PI * k) / n);
  }
  const place = new Uint32Array(n);
  for (let i = 1; i < n; i++) place[i] = (place[i >> 1] >> 1) | (i & 1 ? n >> 1 : 0);
  const table = { cos, sin, place };
  FFT_TABLES.set(n, table);
  return table;
}

// In place; the length is a power of two. Forward: exp(-i...), not scaled.
function fft(re, im) {
  const n = re.length;
  const { cos, sin, place } = fftTable(n);
  for (let i = 0; i < n; i++) {
    const j = place[i];
    if (j <= i) continue;
    const a = re[i];
    const b = im[i];
    re[i] = re[j];
    im[i] = im[j];
    re[j] = a;
    im[j] = b;
  }
  for (let half = 1; half < n; half *= 2) {
    const stride = n / (2 * half);
    for (let start = 0; start < n; start += 2 * half) {
      for (let k = 0, w = 0; k < half; k++, w += stride) {
        const p = start + k;
        const q = p + half;
        const c = cos[w];
        const s = -sin[w];
        const a = re[q] * c - im[q] * s;
        const b = re[q] * s + im[q] * c;
        re[q] = re[p] - a;
        im[q] = im[p] - b;
        re[p] += a;
        im[p] += b;
      }
    }
  }
}

function meanOf(x, from = 0, to = x.length) {
  let sum = 0;
  let count = 0;
  for (let i = from; i < to; i++) {
    if (Number.isFinite(x[i])) {
      sum += x[i];
      count += 1;
    }
  }
  return count ? sum / count : NaN;
}

// Sums of (y - yhat)², of y², and how many rows they are of.
function squaresOf(y, yhat, scored, from, to) {
  let error = 0;
  let whole = 0;
  let count = 0;
  for (let i = Math.max(from, 0); i < Math.min(to, y.length); i++) {
    if (!scored[i] || !Number.isFinite(y[i])) continue;
    const e = y[i] - yhat[i];
    error += e * e;
    whole += y[i] * y[i];
    count += 1;
  }
  return { error, whole, count };
}

function vafOf(y, yhat, scored, from, to) {
  const { error, whole, count } = squaresOf(y, yhat, scored, from, to);
  return count && whole > 0 ? 100 * (1 - error / whole) : NaN;
}

function rmseOf(y, yhat, scored, from, to) {
  const { error, count } = squaresOf(y, yhat, scored, from, to);
  return count ? Math.sqrt(error / count) : NaN;
}

// Welch's spectrum, one-sided: density per rad/s over rad/s; null where there are too few rows.
function spectrumOf(x, dt, from, to) {
  const n = to - from;
  if (n < 16) return null;
  const p = Math.min(4096, 2 ** Math.floor(Math.log2(n)));
  const level = meanOf(x, from, to);
  const hann = new Float64Array(p);
  let power = 0;
  for (let i = 0; i < p; i++) {
    hann[i] = 0.5 - 0.5 * Math.cos((2 * Math.PI * i) / p);
    power += hann[i] * hann[i];
  }
  const step = p - p / 2;
  const segments = Math.floor((n - p / 2) / step);
  const sum = new Float64Array(p / 2 + 1);
  const re = new Float64Array(p);
  const im = new Float64Array(p);
  // Two real segments go through one complex transform: their powers come out as a sum.
  for (let k = 0; k < segments; k += 2) {
    segmentInto(re, x, from + k * step, level, hann);
    if (k + 1 < segments) segmentInto(im, x, from + (k + 1) * step, level, hann);
    else im.fill(0);
    fft(re, im);
    for (let j = 0; j <= p / 2; j++) {
      const m = (p - j) & (p - 1);
      sum[j] += (re[j] * re[j] + im[j] * im[j] + re[m] * re[m] + im[m] * im[m]) / 2;
    }
  }
  const scale = dt / (power * segments * 2 * Math.PI);
  const omega = new Float64Array(p / 2 + 1);
  for (let j = 0; j <= p / 2; j++) {
    omega[j] = (2 * Math.PI * j) / (p * dt);
    sum[j] *= j === 0 || j === p / 2 ? scale : 2 * scale;
  }
  return { omega, density: sum };
}

// Rows of a segment, without what is missing and without its own mean, under the window.
function segmentInto(target, x, start, level, hann) {
  const p = hann.length;
  let sum = 0;
  for (let i = 0; i < p; i++) {
    const value = x[start + i];
    target[i] = Number.isFinite(value) ? value - level : 0;
    sum += target[i];
  }
  const mean = sum / p;
  for (let i = 0; i < p; i++) target[i] = (target[i] - mean) * hann[i];
}

// The Fourier transform of a run, ready for any number of bands.
function transformOf(x) {
  const level = meanOf(x);
  const size = 2 ** Math.ceil(Math.log2(Math.max(x.length, 2)));
  const re = new Float64Array(size);
  const im = new Float64Array(size);
  let whole = 0;
  for (let i = 0; i < x.length; i++) {
    if (Number.isFinite(x[i])) re[i] = x[i] - level;
    whole += re[i] * re[i];
  }
  fft(re, im);
  return { re, im, n: x.length, whole };
}

function bandOfTransform({ re, im, n }, dt, low, high) {
  const size = re.length;
  const a = new Float64Array(size);
  const b = new Float64Array(size);
  for (let k = 0; k <= size / 2; k++) {
    const omega = (2 * Math.PI * k) / (size * dt);
    if (omega < low || omega > high) continue;
    const m = (size - k) & (size - 1);
    // Conjugated: the forward transform of the conjugate is the inverse.
    a[k] = re[k];
    b[k] = -im[k];
    a[m] = re[m];
    b[m] = -im[m];
  }
  fft(a, b);
  const band = a.subarray(0, n);
  for (let i = 0; i < n; i++) band[i] /= size;
  return band;
}

function bandOf(x, dt, low, high) {
  return bandOfTransform(transformOf(x), dt, low, high);
}

function bandShare(x, dt, low, high) {
  const transform = transformOf(x);
  return shareOf(bandOfTransform(transform, dt, low, high), transform.whole);
}

function shareOf(band, whole) {
  let sum = 0;
  for (let i = 0; i < band.length; i++) sum += band[i] * band[i];
  return whole > 0 ? sum / whole : NaN;
}

// Mean and rms of r in n bins of a, over rows from <= i < to that the mask (null: all) has.
function overAmplitude(r, a, mask, from, to, n = 21) {
  const counts = (i) => (!mask || mask[i]) && Number.isFinite(r[i]) && Number.isFinite(a[i]);
  let low = Infinity;
  let high = -Infinity;
  for (let i = from; i < to; i++) {
    if (!counts(i)) continue;
    if (a[i] < low) low = a[i];
    if (a[i] > high) high = a[i];
  }
  const centre = new Float64Array(n).fill(NaN);
  const sum = new Float64Array(n);
  const squares = new Float64Array(n);
  const count = new Float64Array(n);
  const width = (high - low) / n;
  for (let i = from; i < to; i++) {
    if (!counts(i)) continue;
    const k = width > 0 ? Math.min(n - 1, Math.floor((a[i] - low) / width)) : 0;
    sum[k] += r[i];
    squares[k] += r[i] * r[i];
    count[k] += 1;
  }
  for (let k = 0; k < n && low <= high; k++) centre[k] = low + (k + 0.5) * width;
  const mean = sum.map((s, k) => (count[k] ? s / count[k] : NaN));
  const rms = squares.map((s, k) => (count[k] ? Math.sqrt(s / count[k]) : NaN));
  return { low, high, centre, mean, rms, count };
}

const numbers = {
  fft,
  vafOf,
  rmseOf,
  spectrumOf,
  bandOf,
  bandShare,
  overAmplitude,
};
