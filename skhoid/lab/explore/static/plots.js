// What all plots have in common: axes, colours, sizes, a heading with a key to the lines.

const LETTERS = '13px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
const MARGIN = 58;

const COLOURS = [
  "paper",
  "brush",
  "ink",
  "soft",
  "line",
  "measured",
  "simulated",
  "preview",
  "residual",
  "misfit",
  "shade",
  "bar",
  "noise",
  "line-1",
  "line-2",
  "line-3",
  "line-4",
  "kept-1",
  "kept-2",
  "kept-3",
  "kept-4",
];

function coloursOf(root) {
  const style = getComputedStyle(root);
  return Object.fromEntries(
    COLOURS.map((name) => [name, style.getPropertyValue(`--sk-${name}`).trim()]),
  );
}

function tick(value) {
  return value === null || value === undefined ? "" : figure(value, 5);
}

function axisOf(bench, given = {}) {
  return {
    font: LETTERS,
    labelFont: LETTERS,
    labelSize: 20,
    labelGap: 0,
    stroke: () => bench.colours.soft,
    grid: { stroke: () => bench.colours.line, width: 1 },
    ticks: { stroke: () => bench.colours.line, width: 1, size: 5 },
    values: (plot, splits) => splits.map(tick),
    ...given,
  };
}

function lineOf(bench, colour, given = {}) {
  return {
    label: colour,
    stroke: () => bench.colours[colour],
    width: 1.5,
    points: { show: false },
    ...given,
  };
}

// Powers of ten for a logarithmic axis, or 1, 2, 5 of each where there are few.
function decadesOf(low, high, most = 6) {
  const first = Math.ceil(Math.log10(low) - 1e-9);
  const last = Math.floor(Math.log10(high) + 1e-9);
  const every = Math.max(Math.ceil((last - first + 1) / most), 1);
  const out = [];
  for (let k = first - 1; k <= last; k++) {
    const steps = last - first < 2 ? [1, 2, 5] : k >= first && (k - first) % every === 0 ? [1] : [];
    for (const step of steps) {
      const value = step * 10 ** k;
      if (value >= low && value <= high) out.push(value);
    }
  }
  return out;
}

function logAxisOf(bench, given) {
  return axisOf(bench, {
    splits: (plot, axis, low, high) => decadesOf(low, high),
    filter: (plot, splits) => splits,
    ...given,
  });
}

// A uPlot with a heading, a key, and a frame that takes the focus and the keys.
function plotFigure(bench, { key, height, options, help }) {
  const frame = el("div", {
    class: "sk-plot",
    role: "group",
    tabindex: "0",
    "data-sk-key": key,
    "aria-describedby": help.id,
  });
  const plot = new uPlot(
    {
      width: 300,
      height: height(),
      legend: { show: false },
      padding: [8, 10, 0, 0],
      cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
      ...options,
    },
    options.series.map(() => []),
    frame,
  );
  const resize = () => {
    const width = Math.max(Math.floor(frame.clientWidth), 100);
    if (width !== plot.width || height() !== plot.height) {
      plot.setSize({ width, height: height() });
    }
  };
  const describe = (text) => frame.setAttribute("aria-label", text);
  return { frame, plot, resize, describe };
}

// The pixels that a plot has to draw on.
function pixelsOf(plot) {
  return Math.max(Math.round(plot.bbox.width), 50);
}

function keyOf(kind, text) {
  return el(
    "span",
    { class: "sk-key" },
    el("span", { class: `sk-swatch sk-is-${kind}` }),
    el("span", {}, text),
  );
}

// Stretches of rows as a shade below the lines.
function shadeRows(plot, t, stretches, colour) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.fillStyle = colour;
  for (const [from, to] of stretches) {
    const left = Math.max(plot.valToPos(t[from], "x", true), bbox.left);
    const right = Math.min(
      plot.valToPos(t[Math.min(to, t.length - 1)], "x", true),
      bbox.left + bbox.width,
    );
    if (right > left) ctx.fillRect(left, bbox.top, Math.max(right - left, 1), bbox.height);
  }
  ctx.restore();
}
