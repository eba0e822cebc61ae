// Measured and simulated over time, and below it, on the same axis, the residual and the inputs.

const TIME = "time in the run, s";
const LINES = 4; // colours of inputs, and as many of models

function timePlots(bench) {
  const keys = el(
    "p",
    { class: "sk-keys sk-soft", id: `${bench.id}-time-keys` },
    "Drag to brush a window. Keys: arrows, Shift with arrows, Escape; + − 0 zoom.",
  );
  const state = { columns: null, rows: null, data: null };
  const hooks = {
    drawClear: [
      (plot) => {
        if (!state.columns) return;
        const { t } = bench.record;
        shadeRows(plot, t, state.out, bench.colours.shade);
        if (state.rows) shadeRows(plot, t, state.rows, bench.colours.misfit);
      },
    ],
    setCursor: [(plot) => readOut(bench, plot)],
  };
  const x = { time: false, range: () => seenOf(bench) };
  const upper = plotFigure(bench, {
    key: "plot time",
    help: keys,
    height: () => 190,
    options: timeOptions(bench, x, hooks),
  });
  const lower = plotFigure(bench, {
    key: "plot residual",
    help: keys,
    height: () => (bench.view.channels.length ? 108 : 160),
    options: residualOptions(bench, x, hooks),
  });
  const inputs = plotFigure(bench, {
    key: "plot inputs",
    help: keys,
    height: () => 120,
    options: inputsOptions(bench, x, hooks),
  });
  const figures = bench.view.channels.length ? [upper, lower, inputs] : [upper, lower];
  const brush = {
    get: () => bench.time,
    set: (range) => bench.brush("time", range),
    limits: () => [bench.record.since, bench.record.until],
  };
  const places = figures.map((figure) => brushOn(bench, figure, brush));
  for (const { frame, plot } of figures) {
    frame.addEventListener("keydown", (event) => zoomByKey(bench, event));
    plot.over.addEventListener("wheel", (event) => zoomByWheel(bench, plot, event), {
      passive: false,
    });
  }
  const resize = () => figures.forEach((figure) => figure.resize());
  const place = () => places.forEach((f) => f());
  return {
    upper,
    lower,
    inputs,
    figures,
    keys,
    resize,
    place,
    draw: () => drawTime(bench, state, figures),
  };
}

function timeOptions(bench, x, hooks) {
  const { output } = bench.view;
  return {
    scales: { x, y: { range: () => aroundMeasured(bench) } },
    cursor: cursorOf(bench),
    axes: [
      bareAxisOf(bench),
      axisOf(bench, { size: MARGIN, space: 30, label: labelOf(output.name, output.unit) }),
    ],
    series: [
      {},
      lineOf(bench, "measured", { width: 1.75 }),
      lineOf(bench, "simulated"),
      lineOf(bench, "preview", { dash: [7, 4], width: 2 }),
      ...bench.lines.map((_, i) => lineOf(bench, `kept-${i + 1}`)),
    ],
    hooks,
  };
}

function residualOptions(bench, x, hooks) {
  return {
    scales: { x, y: { range: () => aroundZero(bench) } },
    cursor: cursorOf(bench),
    axes: [
      bench.view.channels.length ? bareAxisOf(bench) : timeAxisOf(bench),
      axisOf(bench, {
        size: MARGIN,
        space: 26,
        label: labelOf("residual", bench.view.output.unit),
      }),
    ],
    series: [
      {},
      lineOf(bench, "residual", { width: 1.25 }),
      lineOf(bench, "ink", { width: 1.75, label: "within the band" }),
    ],
    hooks,
  };
}

// What the operator has seen: the channels, on the same axis of time.
function inputsOptions(bench, x, hooks) {
  const { channels } = bench.view;
  const units = new Set(channels.map(({ unit }) => unit));
  const unit = units.size === 1 ? channels[0].unit : null;
  return {
    scales: { x, y: { range: (plot, low, high) => (low < high ? [low, high] : [-1, 1]) } },
    cursor: cursorOf(bench),
    axes: [
      timeAxisOf(bench),
      axisOf(bench, { size: MARGIN, space: 26, label: labelOf("inputs", unit) }),
    ],
    series: [
      {},
      ...channels
        .slice(0, LINES)
        .map(({ name }, i) => lineOf(bench, `line-${i + 1}`, { label: shortened(name, 24) })),
    ],
    hooks,
  };
}

function bareAxisOf(bench) {
  return axisOf(bench, { size: 10, said: TIME, values: (plot, splits) => splits.map(() => "") });
}

function timeAxisOf(bench) {
  return axisOf(bench, { size: 30, label: TIME });
}

function cursorOf(bench) {
  return {
    y: false,
    drag: { x: false, y: false },
    points: { show: false },
    sync: { key: bench.id, setSeries: false, scales: ["x", null] },
  };
}

function labelOf(name, unit) {
  const short = isolated(shortened(name, 24));
  return unit ? `${short}, ${isolated(shortened(unit, 12))}` : short;
}

function seenOf(bench) {
  if (!bench.record) return [0, 1];
  const { since, until } = bench.record;
  return bench.zoom ?? [since, until > since ? until : since + 1];
}

function aroundMeasured({ record, model }) {
  if (!model) return [-1, 1];
  const reach = 1.06 * model.reach;
  return [record.middle - reach, record.middle + reach];
}

function aroundZero({ model }) {
  const reach = model ? 1.06 * model.largest : 1;
  return [-reach, reach];
}

function drawTime(bench, state, figures) {
  const [upper, lower, inputs] = figures.map(({ plot }) => plot);
  const { record, model, preview } = bench;
  const columns = columnsOf(record.t, ...seenOf(bench), pixelsOf(upper));
  const [low, high] = aroundMeasured(bench);
  const far = 4 * (high - low);
  const drawn = (y) => valuesOf(y, columns, low - far, high + far);
  const nothing = () => new Array(times.length).fill(null);
  const times = timesOf(record.t, columns);
  state.columns = columns;
  state.out = stretchesOf(record.unscored, columns);
  state.rows = bench.rows ? stretchesOf(bench.rows.mask, columns) : null;
  upper.setData([
    times,
    drawn(record.measured),
    drawn(model.simulated),
    preview ? drawn(preview.simulated) : nothing(),
    ...tracesOf(bench).map((simulated) => (simulated ? drawn(simulated) : nothing())),
  ]);
  keptShown(bench).forEach((model, i) => {
    if (model) upper.series[4 + i].label = modelName(model);
  });
  lower.setData([
    times,
    drawn(model.residual),
    bench.filtered ? drawn(bench.filtered.band) : nothing(),
  ]);
  if (!inputs) return;
  const seen = bench.view.channels.slice(0, LINES).map(({ name }) => record.channels[name]);
  const all = (y) => (y ? valuesOf(y, columns, -Infinity, Infinity) : nothing());
  inputs.setData([times, ...seen.map(all)]);
}

// Of the run that is shown, all rows of it, with all models that were kept.
async function columnsOverTime(bench) {
  const { record, model, view, run, state } = bench;
  const others = state.models.filter(({ id }) => id);
  const kept = await Promise.all(
    others.map(async (one) => [modelName(one), await traceOfModel(bench, one.id, run)]),
  );
  return [
    ["time, s", record.t],
    [`measured ${view.output.name}`, record.measured],
    ["simulated", model.simulated],
    ["residual", model.residual],
    ...kept,
    ...Object.entries(record.channels),
  ];
}

function readOut(bench, plot) {
  const { record, model } = bench;
  const { left } = plot.cursor;
  if (!record || !model || left === null || left === undefined || left < 0) {
    setText(bench.readOut, "");
    return;
  }
  const at = plot.posToVal(left, "x");
  const i = clamp(rowAt(record.t, at - bench.view.dt / 2), [0, record.t.length - 1]);
  const { unit } = bench.view.output;
  setText(
    bench.readOut,
    `at ${figure(record.t[i], 6)} s: measured ${figure(record.measured[i], 3)}, simulated ` +
      `${figure(model.simulated[i], 3)}, residual ${withUnit(figure(model.residual[i], 3), unit)}`,
  );
}

function zoomByKey(bench, event) {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  const factor = { "+": 0.5, "=": 0.5, "-": 2, 0: Infinity }[event.key];
  if (factor === undefined) return;
  event.preventDefault();
  const [low, high] = seenOf(bench);
  const centre = bench.time ? (bench.time[0] + bench.time[1]) / 2 : (low + high) / 2;
  zoomAround(bench, centre, factor);
}

// With Ctrl only: without it the wheel scrolls the page, as everywhere.
function zoomByWheel(bench, plot, event) {
  if (!event.ctrlKey) return;
  event.preventDefault();
  const left = plot.over.getBoundingClientRect().left;
  zoomAround(bench, plot.posToVal(event.clientX - left, "x"), event.deltaY > 0 ? 1.25 : 0.8);
}

function zoomAround(bench, centre, factor) {
  const { since, until } = bench.record;
  const [low, high] = seenOf(bench);
  const span = Math.max((high - low) * factor, 8 * bench.view.dt);
  if (!(span < until - since)) return bench.see(null);
  const share = clamp((centre - low) / (high - low), [0, 1]);
  const start = clamp(centre - share * span, [since, until - span]);
  return bench.see([start, start + span]);
}
