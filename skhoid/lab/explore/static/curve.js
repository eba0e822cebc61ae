// The curve of an effect: with it as lines, without it dashed.

const SVG = "http://www.w3.org/2000/svg";
const DASHES = ["none", "9 3", "3 3", "9 3 3 3"];

function svgEl(tag, given) {
  const node = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(given)) node.setAttribute(key, value);
  return node;
}

function curvePlot() {
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
  const key = el("p", { class: "sk-legend" });
  const node = el(
    "div",
    { class: "sk-curve" },
    ylabel,
    most,
    least,
    picture,
    el("div", { class: "sk-curve-below" }, first, xlabel, last),
    key,
  );
  const update = (curve, title) => {
    node.hidden = !curve;
    if (!curve) return;
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
  const path = (line) => {
    let d = "";
    let pen = "M";
    for (let i = 0; i < line.x.length; i++) {
      const a = (100 * (line.x[i] - x[0])) / (x[1] - x[0]);
      const b = 96 - (92 * (line.y[i] - y[0])) / (y[1] - y[0]);
      if (!Number.isFinite(a) || !Number.isFinite(b)) {
        pen = "M";
        continue;
      }
      d += `${pen}${a.toFixed(2)} ${b.toFixed(2)}`;
      pen = "L";
    }
    return d;
  };
  const paths = lines.map((line, i) =>
    svgEl("path", {
      d: path(line),
      class: "sk-with",
      "stroke-dasharray": DASHES[i % DASHES.length],
    }),
  );
  if (without) paths.unshift(svgEl("path", { d: path(without), class: "sk-without" }));
  svg.replaceChildren(...paths);
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
