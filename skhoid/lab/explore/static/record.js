// The run that is shown: its rows, what the model leaves, and which rows are meant.

const AWAY = 10;
const ROOM = 1.5;

function recordOf(trace, run) {
  const { t, measured, scored } = trace;
  let least = Infinity;
  let most = -Infinity;
  let first = -1;
  let end = 0;
  for (let i = 0; i < measured.length; i++) {
    if (measured[i] < least) least = measured[i];
    if (measured[i] > most) most = measured[i];
    if (!scored[i]) continue;
    if (first < 0) first = i;
    end = i + 1;
  }
  if (!(least <= most)) [least, most] = [-1, 1];
  const unscored = new Uint8Array(t.length);
  for (let i = 0; i < t.length; i++) unscored[i] = scored[i] ? 0 : 1;
  return {
    run,
    t,
    measured,
    scored,
    unscored,
    counted: onlyWhere(scored, measured),
    channels: trace.channels ?? {},
    first: Math.max(first, 0),
    end,
    middle: (least + most) / 2,
    half: (most - least) / 2 || Math.abs(most) || 1,
    until: t.length ? t[t.length - 1] : 1,
    since: t.length ? t[0] : 0,
  };
}

function onlyWhere(mask, x) {
  const out = new Float64Array(x.length);
  for (let i = 0; i < x.length; i++) out[i] = mask[i] ? x[i] : NaN;
  return out;
}

// What the model makes of the run. Its transform is made when it is first asked for.
function modelOf(record, simulated) {
  const { measured, scored, t, first, middle, half } = record;
  const n = measured.length;
  const residual = new Float64Array(n);
  let away = null;
  let reach = half;
  let largest = 0;
  for (let i = 0; i < n; i++) {
    residual[i] = measured[i] - simulated[i];
    const size = Math.abs(simulated[i] - middle);
    if (i < first || !Number.isFinite(measured[i])) continue;
    if (away === null && !(size <= AWAY * half)) away = t[i];
    if (size > reach) reach = size;
    if (scored[i] && Math.abs(residual[i]) > largest) largest = Math.abs(residual[i]);
  }
  return {
    simulated,
    residual,
    counted: onlyWhere(scored, residual),
    away,
    reach: Math.min(reach, ROOM * half),
    largest: Math.min(largest || half, ROOM * half),
    transform: null,
  };
}

function transformOfModel(model) {
  model.transform ??= transformOf(model.counted);
  return model.transform;
}

// Rows that are meant: those of the window, or all that count.
function rowsOf(bench) {
  const { record, time } = bench;
  if (!time) return [record.first, record.end];
  const slack = bench.view.dt * 1e-6;
  return [rowAt(record.t, time[0] - slack), rowAt(record.t, time[1] + slack)];
}

function channelOf(bench) {
  const { record, over, view } = bench;
  return over === OUTPUT ? record.measured : record.channels[view.channels[over].name];
}

// Rows whose amplitude is brushed, and their share of the squared residual.
function amplitudeRows(bench) {
  const { record, model, amplitude } = bench;
  const a = channelOf(bench);
  if (!amplitude || !a) return null;
  const mask = new Uint8Array(record.t.length);
  let inside = 0;
  let whole = 0;
  let rows = 0;
  for (let i = 0; i < mask.length; i++) {
    const r = model.counted[i];
    if (!Number.isFinite(r)) continue;
    whole += r * r;
    if (!(a[i] >= amplitude[0] && a[i] <= amplitude[1])) continue;
    mask[i] = 1;
    inside += r * r;
    rows += 1;
  }
  return { mask, rows, share: whole > 0 ? inside / whole : NaN };
}

function windowFigures(bench) {
  const { record, model } = bench;
  const [from, to] = rowsOf(bench);
  const {
    error,
    whole,
    count: rows,
  } = squaresOf(record.measured, model.simulated, record.scored, from, to);
  return {
    from,
    to,
    rows,
    vaf: rows && whole > 0 ? 100 * (1 - error / whole) : NaN,
    rmse: rows ? Math.sqrt(error / rows) : NaN,
  };
}
