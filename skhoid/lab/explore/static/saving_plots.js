// Plots as SVG and PNG, and what they and the tables hold as CSV.

const ABOVE = 24; // px, for a row of the key to the lines
const BELOW = 46; // px, for the axis
const ASIDE = 14; // px, for its label
const LETTER = 6.8; // px, of which a letter of the key has about so many
const SHARP = 2; // pixels of a PNG for one of the screen

// What has a plot, or draws itself for a picture. What is of all runs is not called after one.
function saveMenu(bench, what, { plot, draw }, columns, ofRun = true) {
  const name = () => (ofRun ? `${runName(bench.view.runs[bench.run].label)} ${what}` : what);
  const svg = () => new XMLSerializer().serializeToString(plot ? plotDrawn(bench, plot) : draw());
  const kinds = {
    SVG: async () => download(`${name()}.svg`, svg(), "image/svg+xml"),
    PNG: async () => download(`${name()}.png`, await pngOf(svg())),
    CSV: async () => download(`${name()}.csv`, csvOf(await columns()), "text/csv"),
  };
  const save = async (kind) => {
    node.open = false;
    summary.focus();
    const saved = upperFirst(isolated(name()));
    try {
      await kinds[kind]();
      bench.say(`${saved} is saved as ${kind}.`);
    } catch (error) {
      fail(bench, error);
    }
  };
  const summary = el("summary", { "data-sk-key": `save ${what}`, "aria-label": `Save ${what}` }, "Save");
  const buttons = Object.keys(kinds).map((kind) =>
    button(kind, () => save(kind), {
      class: "sk-button sk-small",
      "aria-label": `Save ${what} as ${kind}`,
    }),
  );
  const node = el("details", { class: "sk-save" }, summary, el("div", {}, ...buttons));
  node.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !node.open) return;
    node.open = false;
    summary.focus();
  });
  node.addEventListener("focusout", (event) => {
    if (!node.contains(event.relatedTarget)) node.open = false;
  });
  return node;
}

function csvButton(bench, what, columns) {
  return button(
    "CSV",
    () => {
      download(`${what}.csv`, csvOf(columns()), "text/csv");
      bench.say(`The ${what} are saved as CSV.`);
    },
    { class: "sk-button sk-small sk-csv", "aria-label": `Save the ${what} as CSV`, "data-sk-key": `csv ${what}` },
  );
}

// Columns of a table by their heads, of rows that have them under keys.
function columnsByKey(rows, keys) {
  return Object.entries(keys).map(([head, key]) => [head, rows.map((row) => row[key])]);
}

function download(name, content, type) {
  const href = URL.createObjectURL(new Blob([content], { type: type ?? content.type }));
  const safe = name.replace(/[^\p{L}\p{N}.-]+/gu, "-").replace(/^[-.]+/, "");
  el("a", { href, download: safe }).click();
  setTimeout(() => URL.revokeObjectURL(href), 1000);
}

// Columns: names with their values, which may differ in number.
function csvOf(columns) {
  const cell = (value) => {
    if (value === null || value === undefined || Number.isNaN(value)) return "";
    return typeof value === "number" ? String(value) : `"${String(value).replaceAll('"', '""')}"`;
  };
  const n = Math.max(...columns.map(([, values]) => values.length));
  const rows = [columns.map(([name]) => cell(name)).join(",")];
  for (let i = 0; i < n; i++) rows.push(columns.map(([, values]) => cell(values[i])).join(","));
  return `${rows.join("\r\n")}\r\n`;
}

// The lines that a plot draws, with what they are called.
function columnsDrawn(plot) {
  return plot.series.flatMap((series, i) =>
    i === 0 || isDrawn(plot, i)
      ? [[i ? series.label : plot.axes[0].label, [...plot.data[i]]]]
      : [],
  );
}

function isDrawn({ data, series }, i) {
  return series[i].show && data[i].some((y) => y !== null && y !== undefined);
}

function heightOf(plot) {
  return aboveOf(plot) + (plot.bbox.top + plot.bbox.height) / uPlot.pxRatio + BELOW;
}

function aboveOf(plot) {
  return ABOVE * (1 + Math.max(0, ...keyPlaces(plot).map(({ row }) => row)));
}

// Where each line of the plot stands in the key: in the next row where one is full.
function keyPlaces(plot) {
  const left = ASIDE + plot.bbox.left / uPlot.pxRatio;
  let [at, row] = [left, 0];
  return plot.series.flatMap((series, i) => {
    if (!i || series.inKey === false || !isDrawn(plot, i)) return [];
    const width = 50 + LETTER * [...series.label].length;
    if (at > left && at + width > ASIDE + plot.width) [at, row] = [left, row + 1];
    at += width;
    return [{ series, i, x: at - width, row }];
  });
}

// A plot as it is seen: drawn again, since a canvas has no lines to take.
function plotDrawn(bench, plot) {
  const { colours } = bench;
  const [left, top, width, height] = ["left", "top", "width", "height"].map(
    (side) => plot.bbox[side] / uPlot.pxRatio,
  );
  const svg = sheet(bench, ASIDE + plot.width, heightOf(plot));
  svg.append(keyDrawn(bench, plot));
  const inner = svgEl("g", { transform: `translate(${ASIDE + left} ${top + aboveOf(plot)})` });
  svg.append(inner);
  axesInto(inner, plot, colours, width, height);
  const clip = svgEl("svg", { width, height, overflow: "hidden" });
  inner.append(clip);
  const shade = plot.over.querySelector(".sk-window:not([hidden])");
  if (shade) {
    const { left: from } = plot.over.getBoundingClientRect();
    const box = shade.getBoundingClientRect();
    clip.append(
      svgEl("rect", { x: box.left - from, width: box.width, height, fill: colours.brush }),
    );
  }
  for (const { series: ends, fill } of plot.bands) clip.append(bandDrawn(plot, ends, fill(plot)));
  plot.series.forEach((series, i) => {
    if (i && isDrawn(plot, i)) clip.append(...lineDrawn(plot, series, i));
  });
  return svg;
}

function sheet({ colours }, width, height) {
  const svg = svgEl("svg", {
    xmlns: SVG,
    width,
    height,
    "font-family": "system-ui, sans-serif",
    "font-size": 12,
  });
  svg.append(svgEl("rect", { width: "100%", height: "100%", fill: colours.paper }));
  return svg;
}

function bandDrawn(plot, ends, fill) {
  const [high, low] = ends.map((i) => placesOf(plot, i).filter((place) => place));
  return svgEl("polygon", { points: [...high, ...low.reverse()].join(" "), fill });
}

// Where the points of a line are; null where it has a gap.
function placesOf(plot, i) {
  return plot.data[i].flatMap((y, k) => {
    if (y === undefined) return []; // the row of another line
    if (y === null) return [null];
    return [[plot.valToPos(plot.data[0][k], "x").toFixed(1), plot.valToPos(y, "y").toFixed(1)]];
  });
}

function textDrawn(text, given) {
  const node = svgEl("text", given);
  node.textContent = text;
  return node;
}

function strokeOf(plot, series, i) {
  return typeof series.stroke === "function" ? series.stroke(plot, i) : series.stroke;
}

function keyDrawn({ colours }, plot) {
  const key = svgEl("g", {});
  for (const { series, i, x, row } of keyPlaces(plot)) {
    const y = 14 + ABOVE * row;
    const line = svgEl("path", { d: `M${x} ${y}h24`, stroke: strokeOf(plot, series, i) });
    line.setAttribute("stroke-width", 3);
    if (series.dash) line.setAttribute("stroke-dasharray", series.dash.join(" "));
    key.append(line, textDrawn(series.label, { x: x + 30, y: y + 4, fill: colours.ink }));
  }
  return key;
}

function axesInto(inner, plot, colours, width, height) {
  plot.axes.forEach((axis, k) => {
    (axis._splits ?? []).forEach((value, i) => {
      const at = plot.valToPos(value, k ? "y" : "x");
      // In a column of plots only the last one has figures below.
      const words = axis._values[i] === "" ? tick(value) : axis._values[i];
      if (words === null || !(at >= -1 && at <= (k ? height : width) + 1)) return;
      const d = k ? `M0 ${at}h${width}` : `M${at} 0v${height}`;
      inner.append(svgEl("path", { d, stroke: colours.line }));
      const where = k
        ? { x: -8, y: at + 4, "text-anchor": "end" }
        : { x: at, y: height + 18, "text-anchor": "middle" };
      inner.append(textDrawn(words, { ...where, fill: colours.soft }));
    });
    const where = k
      ? { transform: `translate(${-MARGIN} ${height / 2}) rotate(-90)` }
      : { x: width / 2, y: height + 38 };
    const label = axis.label ?? axis.said;
    if (label) {
      inner.append(textDrawn(label, { ...where, "text-anchor": "middle", fill: colours.soft }));
    }
  });
}

function lineDrawn(plot, series, i) {
  const stroke = strokeOf(plot, series, i);
  const places = placesOf(plot, i);
  const d = places.map((place, k) => place && `${k && places[k - 1] ? "L" : "M"}${place.join(" ")}`);
  const path = svgEl("path", {
    d: d.filter(Boolean).join(""),
    fill: "none",
    stroke,
    "stroke-width": series.width,
  });
  if (series.dash) path.setAttribute("stroke-dasharray", series.dash.join(" "));
  const dots = series.dots ? places.filter((place) => place) : [];
  return [path, ...dots.map(([cx, cy]) => svgEl("circle", { cx, cy, r: 3, fill: stroke }))];
}

async function pngOf(svg) {
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  await image.decode();
  const canvas = el("canvas", { width: SHARP * image.width, height: SHARP * image.height });
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise((go) => canvas.toBlob(go, "image/png"));
}
