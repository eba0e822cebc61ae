// What the residual has to do with itself, and with an input, some time before.

const LONGEST_LAG = 2; // s: operators have answered by then
const LAGS = 100; // at most, drawn

function lagPlot(bench) {
  const keys = el("p", { class: "sk-hidden", id: `${bench.id}-lag-keys` }, "Nothing to brush here.");
  const state = { bound: NaN, outside: 0 };
  const made = plotFigure(bench, {
    key: "plot lag",
    help: keys,
    height: () => 150,
    options: {
      scales: { x: { time: false }, y: { range: () => [-1, 1] } },
      axes: [
        axisOf(bench, { size: 30, label: "lag, s" }),
        axisOf(bench, { size: MARGIN, space: 26, label: "correlation" }),
      ],
      series: [
        {},
        lineOf(bench, "residual", { label: "with itself", width: 2 }),
        lineOf(bench, "ink", { label: "with the input", width: 1.75 }),
        lineOf(bench, "soft", { label: "chance (95 %)", dash: [3, 4] }),
        lineOf(bench, "soft", { label: "", dash: [3, 4] }),
      ],
    },
  });
  const draw = () => {
    made.plot.series[2].label = `with ${shortened(bench.view.channels[bench.lagTo].name, 24)}`;
    const found = lagsOf(bench);
    Object.assign(state, found);
    made.plot.setData([
      found.lag,
      found.own,
      found.cross,
      found.lag.map(() => found.bound),
      found.lag.map(() => -found.bound),
    ]);
    made.describe(`Residual over lag. ${lagsInWords(bench, state)}`);
  };
  return { ...made, keys, draw, inWords: () => lagsInWords(bench, state) };
}

// Correlations of the rows that are meant. By Bartlett's formula two signals that have nothing to do
// with each other correlate by chance with a variance of the sum of the products of their own, by n.
function lagsOf(bench) {
  const { record, model, view } = bench;
  const { name } = view.channels[bench.lagTo];
  const [from, to] = rowsOf(bench);
  const r = centred(model.counted, from, to);
  const x = centred(record.channels[name] ?? [], from, to);
  const most = Math.min(Math.round(LONGEST_LAG / view.dt), r.length - 1);
  const step = Math.max(1, Math.ceil(most / LAGS));
  const lags = [];
  for (let k = 0; k <= most; k += step) lags.push(k);
  const own = lags.map((k) => correlation(r, r, k));
  if (x.length !== r.length) {
    return { lag: lags.map((k) => k * view.dt), own, cross: lags.map(() => null), bound: NaN };
  }
  const cross = lags.map((k) => correlation(r, x, k));
  let sum = 1;
  for (let i = 1; i < lags.length; i++) sum += 2 * step * own[i] * correlation(x, x, lags[i]);
  const bound = 1.96 * Math.sqrt(Math.max(sum, 1) / r.length);
  return { lag: lags.map((k) => k * view.dt), own, cross, bound };
}

// What is missing counts as the mean.
function centred(signal, from, to) {
  const x = Float64Array.from(signal.slice(from, to));
  const level = meanOf(x);
  for (let i = 0; i < x.length; i++) x[i] = Number.isFinite(x[i]) ? x[i] - level : 0;
  return x;
}

function correlation(r, x, lag) {
  let [sum, rr, xx] = [0, 0, 0];
  for (let i = 0; i < r.length; i++) {
    rr += r[i] * r[i];
    xx += x[i] * x[i];
    if (i >= lag) sum += r[i] * x[i - lag];
  }
  return rr > 0 && xx > 0 ? sum / Math.sqrt(rr * xx) : 0;
}

function lagsInWords(bench, { lag, cross, bound }) {
  const channel = bench.view.channels[bench.lagTo];
  if (!Number.isFinite(bound)) return "";
  let at = 0;
  cross.forEach((value, i) => {
    if (Math.abs(value) > Math.abs(cross[at])) at = i;
  });
  const beyond = Math.abs(cross[at]) > bound ? "beyond" : "within";
  return (
    `It follows ${isolated(channel.name)} most after ${figure(lag[at], 3)} s, by ` +
    `${figure(cross[at], 2)}: ${beyond} chance for one lag (${figure(bound, 2)}).`
  );
}
