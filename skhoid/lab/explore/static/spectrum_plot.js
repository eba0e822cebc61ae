// Power over frequency of what was measured and of what the model leaves.

const DECADES = 8;

function spectrumPlot(bench) {
  const keys = el(
    "p",
    { class: "sk-hidden", id: `${bench.id}-band-keys` },
    "Drag, or press the arrow keys, to brush a band of frequencies; Escape clears it.",
  );
  const state = { spectra: null };
  const unit = bench.view.output.unit;
  const figureMade = plotFigure(bench, {
    key: "plot spectrum",
    help: keys,
    height: () => 150,
    options: {
      scales: {
        x: { time: false, distr: 3, range: () => omegasOf(state) },
        y: { distr: 3, range: () => densitiesOf(state) },
      },
      axes: [
        logAxisOf(bench, { size: 30, label: "frequency, rad/s" }),
        logAxisOf(bench, { size: MARGIN, label: densityOf(unit) }),
      ],
      series: [
        {},
        lineOf(bench, "measured", { width: 1.75 }),
        lineOf(bench, "residual", { width: 2 }),
      ],
    },
  });
  const brush = {
    log: true,
    get: () => bench.band,
    set: (range) => bench.brush("band", range),
    limits: () => omegasOf(state),
  };
  const draw = (plot) => drawSpectrum(bench, state, plot);
  const inWords = () => spectrumInWords(bench, state);
  return brushedFigure(bench, figureMade, keys, brush, draw, inWords);
}

function densityOf(unit) {
  return unit ? `${isolated(shortened(unit, 12))}² s/rad` : "density, s/rad"; // as high as the plot
}

function drawSpectrum(bench, state, plot) {
  const { record, model, view } = bench;
  const [from, to] = rowsOf(bench);
  const measured = spectrumOf(record.counted, view.dt, from, to);
  const residual = measured && spectrumOf(model.counted, view.dt, from, to);
  state.spectra = measured && { omega: measured.omega, measured, residual };
  if (!measured) {
    plot.setData([[], [], []]);
    return;
  }
  const drawn = (x) => Array.from(x.subarray(1), (v) => (v > 0 && Number.isFinite(v) ? v : null));
  plot.setData([
    Array.from(measured.omega.subarray(1)),
    drawn(measured.density),
    drawn(residual.density),
  ]);
}

function omegasOf({ spectra }) {
  if (!spectra) return [0.1, 100];
  return [spectra.omega[1], spectra.omega[spectra.omega.length - 1]];
}

function densitiesOf({ spectra }) {
  if (!spectra) return [1e-6, 1];
  let least = Infinity;
  let most = 0;
  for (const [k, densities] of [spectra.measured.density, spectra.residual.density].entries()) {
    for (let j = 1; j < densities.length; j++) {
      const value = densities[j];
      if (!(value > 0 && Number.isFinite(value))) continue;
      if (value < least) least = value;
      // The scale is that of what was measured, also where a model runs away.
      if (k === 0 && value > most) most = value;
    }
  }
  if (!(most > 0)) return [1e-6, 1];
  return [Math.max(least, most / 10 ** DECADES) / 1.5, most * 3];
}

function spectrumInWords(bench, { spectra }) {
  if (!spectra) return "Spectrum: fewer than 16 rows in the window, too few for one.";
  const { omega, residual } = spectra;
  let at = 1;
  for (let j = 1; j < omega.length; j++) if (residual.density[j] > residual.density[at]) at = j;
  const band = bandInWords(bench);
  return (
    "Spectrum of measured and residual output. " +
    `The residual is strongest at ${figure(omega[at], 3)} rad/s.${band ? ` ${band}` : ""}`
  );
}

function bandInWords({ filtered, band, time }) {
  if (!filtered) return "";
  const between = `between ${figure(band[0], 3)} and ${figure(band[1], 3)} rad/s`;
  const inside = time ? ` In the window: ${percent(100 * filtered.inside)}.` : "";
  return `${percent(100 * filtered.share)} of the residual's power is ${between}.${inside}`;
}
