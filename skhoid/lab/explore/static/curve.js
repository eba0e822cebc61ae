// The curve of an effect: with it as lines, without it dashed.

const SVG = "http://www.w3.org/2000/svg";
const DASHES = ["none", "9 3", "3 3", "9 3 3 3"];

function svgEl(tag, given) {
  const node = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(given)) node.setAttribute(key, value);
  return node;
}

function curvePlot(bench, title) {
  const svg = svgEl("svg", {
    viewBox: "0 0 100 100",
    preserveAspectRatio: "none",
    class: "sk-lines",
  });
  const picture = el("div", { class: "sk-well-of-curve", role: "img" }, svg);
  const part = (name) => el("span", { class: `sk-curve-${name}` });
  const [ylabel, most, least, xlabel, first, last] = [
    "ylabel",
    "most",
    "least",
    "xlabel",
    "first",
    "last",
  ].map(part);
  const key = el("span", { class: "sk-legend" });
  let shown = null;
  const save = saveMenu(
    bench,
    `curve of ${title}`,
    { draw: () => curveDrawn(bench, shown) },
    () => curveColumns(shown),
    false,
  );
  const node = el(
    "div",
    { class: "sk-curve" },
    ylabel,
    most,
    least,
    picture,
    el("div", { class: "sk-curve-below" }, first, xlabel, last),
    el("div", { class: "sk-legend" }, key, save),
  );
  const update = (curve) => {
    node.hidden = !curve;
    if (!curve) return;
    shown = curve;
    const { x, y } = extentOf(curve);
    setText(ylabel, curve.ylabel);
    setText(xlabel, curve.xlabel);
    [
      [most, y[1]],
      [least, y[0]],
      [first, x[0]],
      [last, x[1]],
    ].forEach(([part, value]) => setText(part, figure(value, 3)));
    drawCurve(svg, curve, x, y);
    picture.setAttribute(
      "aria-label",
      `Curve of ${isolated(title)}: ${isolated(curve.ylabel)} over ${isolated(curve.xlabel)}.`,
    );
    keyInto(key, curve);
  };
  return { node, update };
}

function extentOf({ lines, without }) {
  const ends = (name) => {
    let [low, high] = [Infinity, -Infinity];
    for (const line of [...lines, without]) {
      for (const value of line ? line[name] : []) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    return low < high ? [low, high] : [(low || 0) - 1, (low || 0) + 1];
  };
  return { x: ends("x"), y: ends("y") };
}

function drawCurve(svg, { lines, without }, x, y) {
  const paths = lines.map((line, i) =>
    svgEl("path", {
      d: pathOf(line, x, y, 100, 100),
      class: "sk-with",
      "stroke-dasharray": DASHES[i % DASHES.length],
    }),
  );
  if (without) {
    paths.unshift(svgEl("path", { d: pathOf(without, x, y, 100, 100), class: "sk-without" }));
  }
  svg.replaceChildren(...paths);
}

// A line in a box of some size, with a little room above and below.
function pathOf(line, x, y, width, height) {
  let d = "";
  let pen = "M";
  for (let i = 0; i < line.x.length; i++) {
    const a = (width * (line.x[i] - x[0])) / (x[1] - x[0]);
    const b = height * (0.96 - (0.92 * (line.y[i] - y[0])) / (y[1] - y[0]));
    if (!Number.isFinite(a) || !Number.isFinite(b)) {
      pen = "M";
      continue;
    }
    d += `${pen}${a.toFixed(2)} ${b.toFixed(2)}`;
    pen = "L";
  }
  return d;
}

const PICTURE = [360, 200]; // px, of a curve
const ROOM_OF_CURVE = [70, 44]; // px, to its left and above

// The picture of a curve, for a file: its key, its ends as figures, and the lines.
function curveDrawn(bench, curve) {
  const { colours } = bench;
  const [width, height] = PICTURE;
  const [left, above] = ROOM_OF_CURVE;
  const svg = sheet(bench, left + width + 20, above + height + 40);
  const { x, y } = extentOf(curve);
  const soft = { fill: colours.soft };
  const inner = svgEl("g", { transform: `translate(${left} ${above})` });
  svg.append(textDrawn(curve.ylabel, { x: 8, y: 36, ...soft }), inner);
  const frame = { d: `M0 0V${height}H${width}`, fill: "none", stroke: colours.soft };
  inner.append(
    svgEl("path", frame),
    textDrawn(figure(y[1], 3), { x: -8, y: 0.04 * height + 4, "text-anchor": "end", ...soft }),
    textDrawn(figure(y[0], 3), { x: -8, y: 0.96 * height + 4, "text-anchor": "end", ...soft }),
    textDrawn(figure(x[0], 3), { x: 0, y: height + 18, ...soft }),
    textDrawn(figure(x[1], 3), { x: width, y: height + 18, "text-anchor": "end", ...soft }),
    textDrawn(curve.xlabel, { x: width / 2, y: height + 32, "text-anchor": "middle", ...soft }),
  );
  let at = 8;
  for (const { line, label, ...look } of linesDrawn(bench, curve)) {
    const drawn = { ...look, fill: "none", "stroke-width": 2 };
    inner.append(svgEl("path", { d: pathOf(line, x, y, width, height), ...drawn }));
    svg.append(
      svgEl("path", { d: `M${at} 14h24`, ...drawn }),
      textDrawn(label, { x: at + 30, y: 18, fill: colours.ink }),
    );
    at += 50 + LETTER * [...label].length;
  }
  return svg;
}

function linesDrawn({ colours }, { lines, without }) {
  const drawn = lines.map((line, i) => ({
    line,
    label: line.label,
    stroke: colours.simulated,
    "stroke-dasharray": DASHES[i % DASHES.length],
  }));
  const dashed = { stroke: colours.soft, "stroke-dasharray": "5 4" };
  return without ? [...drawn, { line: without, label: "without it", ...dashed }] : drawn;
}

function curveColumns({ lines, without, xlabel, ylabel }) {
  const named = without ? [...lines, { ...without, label: "without it" }] : lines;
  return named.flatMap(({ label, x, y }) => [
    [`${label}: ${xlabel}`, x],
    [`${label}: ${ylabel}`, y],
  ]);
}

function keyInto(key, { lines, without }) {
  const text = JSON.stringify([lines.map((line) => line.label), Boolean(without)]);
  if (key.dataset.of === text) return;
  key.dataset.of = text;
  const kinds = ["simulated", "simulated-2", "simulated-3", "simulated-4"];
  key.replaceChildren(
    ...lines.map((line, i) => keyOf(kinds[i % kinds.length], named(line.label))),
    without ? keyOf("without", "without it") : "",
  );
}
