// The linear part of the models: frequency response, poles and step response, each in a tab.

const LINEAR_REST = 150; // ms without a move, before a number that is dragged is looked at

function linearParts(bench) {
  const state = { reply: null, key: null, timer: null, shown: false };
  const keys = el(
    "p",
    { class: "sk-hidden", id: `${bench.id}-linear-keys` },
    "Press the arrow keys to read values.",
  );
  const gain = responsePlot(bench, state, keys, "gain");
  const phase = responsePlot(bench, state, keys, "phase");
  const poles = polesPlot(bench, state, keys);
  const step = stepPlot(bench, state, keys);
  const figures = [gain, phase, poles, step];
  const table = polesTable(state);
  const abouts = figures.slice(1).map(() => el("p", { class: "sk-sentence" }, "Computing …"));
  const fromRuns = [gain, phase].map(() => keyOf("measured", "from the runs"));
  const columns = (make) => () => (isReady(state.reply) ? make(bench, state.reply) : [["", []]]);
  const save = (what, made, make) => saveMenu(bench, what, made, columns(make), false);
  const tabs = [
    {
      title: "Frequency response",
      nodes: [
        keys,
        pairOf(
          [
            linearKey(fromRuns[0], save("gain over frequency", gain, responseColumns)),
            gain.frame,
            gain.out,
          ],
          [
            linearKey(fromRuns[1], save("phase over frequency", phase, responseColumns)),
            phase.frame,
            phase.out,
          ],
        ),
        abouts[0],
      ],
    },
    {
      title: "Poles",
      nodes: [
        pairOf(
          [
            linearKey(null, save("poles", poles, polesColumns)),
            poles.frame,
            poles.out,
          ],
          [table.node],
        ),
        abouts[1],
      ],
    },
    {
      title: "Step response",
      nodes: [
        linearKey(null, save("step response", step, stepColumns)),
        step.frame,
        step.out,
        abouts[2],
      ],
    },
  ];
  const draw = () => {
    for (const { plot, draw: drawOne } of figures) {
      if (isReady(state.reply)) drawOne();
      else plot.setData(plot.series.map(() => []));
    }
    table.update();
    for (const node of fromRuns) node.classList.toggle("sk-unseen", !state.reply.measured);
    abouts.forEach((about, i) => setText(about, linearInWords(bench, state.reply, i === 0)));
    for (const node of bench.root.querySelectorAll(".sk-kept-linear")) keptInto(bench, node);
  };
  return {
    tabs,
    figures,
    show: (shown) => {
      state.shown = shown;
      lookAtLinear(bench, state, draw);
    },
    update: () => lookAtLinear(bench, state, draw),
    resize: () => figures.forEach((one) => one.resize()),
  };
}

function isReady(reply) {
  return Boolean(reply) && !reply.refused;
}

function linearInWords(bench, reply, withMeasured) {
  if (reply.refused) return reply.refused;
  const responds = `how ${isolated(reply.output)} responds to ${isolated(reply.input)}.`;
  const of = reply.without_effects
    ? `This is the linear part of the model, without its effects: ${responds}`
    : `This is ${responds}`;
  if (!withMeasured) return of;
  const measured = reply.measured
    ? "The points are measured without a model, by way of the target, where their 95 % interval " +
      "leaves zero out."
    : bench.state.ceiling_pending && bench.view.can.any
      ? "The estimate without a model is on its way …"
      : "These runs allow no estimate without a model.";
  return `${of} ${measured}`;
}

function pairOf(...columns) {
  return el("div", { class: "sk-pair" }, ...columns.map((nodes) => el("div", {}, ...nodes)));
}

// Asks for what is seen, once it is seen and has changed; what is dragged has the server first.
function lookAtLinear(bench, state, draw) {
  if (!state.shown || bench.gone) return;
  const { of, value } = bench.drag;
  const args = { models: bench.lines.filter((id) => id !== null) };
  if (of !== null) Object.assign(args, { name: of, value });
  const key = JSON.stringify([bench.state.revision, args]);
  if (key === state.key) return;
  state.key = key;
  clearTimeout(state.timer);
  state.timer = setTimeout(
    async () => {
      try {
        const reply = await bench.backend.call("linear", { ...args, run: bench.run });
        if (bench.gone || key !== state.key) return;
        state.reply = reply;
        draw();
      } catch (error) {
        if (!bench.gone && key === state.key) fail(bench, error);
      }
    },
    of === null ? 0 : LINEAR_REST,
  );
}

function linearKey(measured, save) {
  return el(
    "div",
    { class: "sk-legend" },
    keyOf("simulated", "this model"),
    measured,
    el("span", { class: "sk-legend sk-kept-linear" }),
    save,
  );
}

function keptInto(bench, node) {
  const kept = keptShown(bench).map((one, i) => one && keyOf(`kept-${i + 1}`, named(modelName(one))));
  node.replaceChildren(...kept.filter(Boolean));
}

// A figure that reads itself out: the nearest point below the pointer, or by the arrow keys.
function readable(bench, made, { points, words, plane }) {
  const { frame, plot } = made;
  const out = el("p", { class: "sk-readout sk-reserved", "aria-hidden": "true" });
  let at = null;
  const place = ([x, y]) => [plot.valToPos(x, "x"), plot.valToPos(y, "y")];
  const nearest = (left, top) => {
    const off = points().map((point) => {
      const [a, b] = place(point);
      return (a - left) ** 2 + (plane ? (b - top) ** 2 : 0);
    });
    return off.length ? off.indexOf(Math.min(...off)) : null;
  };
  plot.hooks.setCursor = [
    () => {
      const { left, top } = plot.cursor;
      if (left >= 0) at = nearest(left, top);
      setText(out, left >= 0 && at !== null ? words(at) : "");
    },
  ];
  frame.addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    const n = points().length;
    const [before, after] = [(at ?? n) - 1, (at ?? -1) + 1];
    const to = { ArrowLeft: before, ArrowRight: after, Home: 0, End: n - 1 }[event.key];
    if (to === undefined || !n) return;
    event.preventDefault();
    event.stopPropagation();
    at = clamp(to, [0, n - 1]);
    const [left, top] = place(points()[at]);
    plot.setCursor({ left, top });
    bench.say(words(at));
  });
  return { ...made, out };
}

// This model with its interval, and kept ones in their colours.
function modelSeries(bench) {
  const interval = { label: "95 % interval", width: 0 };
  return [
    {},
    lineOf(bench, "brush", interval),
    lineOf(bench, "brush", { ...interval, inKey: false }),
    lineOf(bench, "simulated", { label: "this model", width: 2 }),
    ...bench.lines.map((_, i) => lineOf(bench, `kept-${i + 1}`)),
  ];
}

function intervalOf(bench) {
  return [{ series: [2, 1], fill: () => bench.colours.brush }];
}

// Kept models are the series behind two of an interval or an edge, and this model.
function labelKept(bench, plot) {
  keptShown(bench).forEach((one, i) => {
    if (one) plot.series[4 + i].label = modelName(one);
  });
}

function pointsOf(x, y) {
  return x ? Array.from(x, (value, i) => [value, y[i]]) : [];
}

// Lines of their own abscissae in one table: missing rows of a line are no gaps of it.
function aligned(lines) {
  const rows = lines.flatMap(({ x, y }, k) => Array.from(x, (v, i) => [v, k, y[i]]));
  rows.sort((a, b) => a[0] - b[0]);
  const seen = (v) => (Number.isFinite(v) ? v : null);
  return [
    rows.map(([x]) => x),
    ...lines.map((_, k) => rows.map(([, of, y]) => (of === k ? seen(y) : undefined))),
  ];
}

const NOTHING = { x: [], y: [] };

function keptOf(bench, ofModels) {
  return bench.lines.map((id) => ofModels.find((one) => id !== null && one.id === id) ?? null);
}

function gainUnit({ view }, { input }) {
  const from = view.channels.find(({ name }) => name === input)?.unit;
  return from && view.output.unit ? `${view.output.unit}/${from}` : "";
}

function endsOf(reply, name, without) {
  const values = reply?.[name];
  return values ? [values[0], values[values.length - 1]] : without;
}

function between(low, high, unit = "") {
  return Number.isFinite(low) ? ` (${figure(low, 3)} to ${figure(high, 3)}${unit})` : "";
}

function nameOf(bench, id) {
  const model = bench.state.models.find((one) => one.id === id);
  return model ? modelName(model) : "this model";
}
