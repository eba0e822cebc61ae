// What the model leaves, over the amplitude of a channel.

const OUTPUT = -1;

function amplitudePlot(bench) {
  const keys = el(
    "p",
    { class: "sk-hidden", id: `${bench.id}-amplitude-keys` },
    "Drag, or press the arrow keys, to brush a range of amplitudes; Escape clears it.",
  );
  const state = { bins: null };
  const dots = { show: true, size: 6, width: 1 };
  const figureMade = plotFigure(bench, {
    key: "plot amplitude",
    help: keys,
    height: () => 150,
    options: {
      scales: {
        x: { time: false, range: () => amplitudesOf(state) },
        y: { range: () => residualsOf(bench, state) },
      },
      axes: [
        axisOf(bench, { size: 30, label: " " }),
        axisOf(bench, {
          size: MARGIN,
          space: 26,
          label: labelOf("residual", bench.view.output.unit),
        }),
      ],
      series: [
        {},
        lineOf(bench, "residual", {
          label: "mean of the residual",
          width: 2,
          dots: true,
          points: { ...dots, fill: () => bench.colours.residual },
        }),
        lineOf(bench, "ink", { label: "rms", width: 1.5, dash: [5, 4] }),
      ],
    },
  });
  const brush = {
    get: () => bench.amplitude,
    set: (range) => bench.brush("amplitude", range),
    limits: () => amplitudesOf(state),
  };
  const draw = (plot) => drawAmplitude(bench, state, plot);
  const inWords = () => amplitudeInWords(bench, state);
  return brushedFigure(bench, figureMade, keys, brush, draw, inWords);
}

function overName(bench) {
  const { over, view } = bench;
  return over === OUTPUT ? view.output : view.channels[over];
}

function drawAmplitude(bench, state, plot) {
  const a = channelOf(bench);
  const { name, unit } = overName(bench);
  plot.axes[0].label = labelOf(name, unit);
  const [from, to] = rowsOf(bench);
  const bins = a ? overAmplitude(bench.model.counted, a, null, from, to) : null;
  state.bins = bins && bins.low <= bins.high ? bins : null;
  if (!state.bins) {
    plot.setData([[], [], []]);
    return;
  }
  const least = -1e3 * bench.model.largest;
  const drawn = (x) => Array.from(x, (v) => (v === v ? clamp(v, [least, -least]) : null));
  plot.setData([Array.from(bins.centre), drawn(bins.mean), drawn(bins.rms)]);
}

function amplitudesOf({ bins }) {
  if (!bins) return [-1, 1];
  return bins.high > bins.low ? [bins.low, bins.high] : [bins.low - 1, bins.high + 1];
}

function residualsOf(bench, { bins }) {
  if (!bins || !bench.model) return [-1, 1];
  let reach = 0;
  for (const r of bins.rms) if (r > reach) reach = r;
  reach = 1.1 * (Math.min(reach, bench.record.half * ROOM) || 1);
  return [-reach, reach];
}

function amplitudeInWords(bench, { bins }) {
  const { name, unit } = overName(bench);
  if (!bins) return `Residual over ${isolated(name)}: no rows with it here.`;
  let most = 0;
  for (let k = 0; k < bins.rms.length; k++) if (!(bins.rms[k] <= bins.rms[most])) most = k;
  const rows = rowsInWords(bench);
  return (
    `Mean and rms of the residual over ${isolated(name)}. The rms is greatest, ` +
    `${withUnit(figure(bins.rms[most], 3), bench.view.output.unit)}, at ` +
    `${withUnit(figure(bins.centre[most], 3), unit)}.${rows ? ` ${rows}` : ""}`
  );
}

function rowsInWords(bench) {
  const { rows, amplitude } = bench;
  if (!rows) return "";
  const { name, unit } = overName(bench);
  const between = `${figure(amplitude[0], 3)} to ${withUnit(figure(amplitude[1], 3), unit)}`;
  return (
    `${percent(100 * rows.share)} of the squared residual is in ${count(rows.rows, "row")} ` +
    `where ${isolated(name)} is ${between}; they are shaded over time.`
  );
}
