// The linear part of the models: frequency response, poles and step response, each in a tab.

const LINEAR_REST = 150; // ms without a move, before a number that is dragged is looked at
const HALF_TURNS = [45, 90, 180, 360, 720];

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
    ? "The points are measured without a model, by way of the target, where their 95 % interval leaves zero out."
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
function modelSeries(bench, given = {}) {
  const interval = { label: "95 % interval", width: 0 };
  return [
    {},
    lineOf(bench, "brush", { ...interval, inKey: true }),
    lineOf(bench, "brush", { ...interval, inKey: false }),
    lineOf(bench, "simulated", { label: "this model", width: 2, ...given }),
    ...bench.lines.map((_, i) => lineOf(bench, `kept-${i + 1}`, given)),
  ];
}

function intervalOf(bench) {
  return [{ series: [2, 1], fill: () => bench.colours.brush }];
}

function labelKept(bench, plot, first) {
  keptShown(bench).forEach((one, i) => {
    if (one) plot.series[first + i].label = modelName(one);
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

function linearUnits(bench, { input, output }) {
  const from = bench.view.channels.find(({ name }) => name === input)?.unit;
  const to = bench.view.output.unit;
  return { from, to, ratio: from && to ? `${to}/${from}` : "", output, input };
}

function responsePlot(bench, state, help, part) {
  const isGain = part === "gain";
  const dots = { show: true, size: 6, width: 1, fill: () => bench.colours.measured };
  const made = plotFigure(bench, {
    key: `plot ${part}`,
    help,
    height: () => 200,
    options: {
      scales: {
        x: { time: false, distr: 3, range: () => endsOf(state.reply, "omega", [0.1, 30]) },
        y: isGain
          ? { distr: 3, range: () => gainsOf(state.reply) }
          : { range: () => phasesOf(state.reply) },
      },
      axes: [
        logAxisOf(bench, { size: 30, label: "frequency, rad/s" }),
        isGain
          ? logAxisOf(bench, { size: MARGIN, label: "gain" })
          : axisOf(bench, {
              size: MARGIN,
              label: "phase, deg",
              splits: (plot, axis, low, high) => turnsOf(low, high),
            }),
      ],
      bands: intervalOf(bench),
      series: [
        ...modelSeries(bench),
        lineOf(bench, "measured", {
          label: "from the runs (95 %)",
          dots: true,
          width: 0,
          paths: () => null,
          points: dots,
        }),
        lineOf(bench, "measured", { label: "", inKey: false, width: 1.25, paths: barsOf }),
      ],
    },
  });
  const readOut = readable(bench, made, {
    points: () => pointsOf(state.reply?.omega, state.reply?.responses?.[0][part]),
    words: (i) => responseInWords(state.reply, i),
  });
  const draw = () => {
    const { omega, responses, measured } = state.reply;
    const line = (one, name = part) => (one ? { x: omega, y: one[name] } : NOTHING);
    labelKept(bench, made.plot, 4);
    const bar = (w, i) => [`${part}_low`, `${part}_high`].map((end) => [w, measured[end][i]]);
    const bars = measured ? Array.from(measured.omega).flatMap((w, i) => [...bar(w, i), [w, null]]) : [];
    const { ratio } = linearUnits(bench, state.reply);
    made.plot.axes[1].label = isGain ? labelOf("gain", ratio) : "phase, deg";
    made.plot.setData(
      aligned([
        line(responses[0], `${part}_low`),
        line(responses[0], `${part}_high`),
        line(responses[0]),
        ...keptOf(bench, responses).map((one) => line(one)),
        measured ? { x: measured.omega, y: measured[part] } : NOTHING,
        { x: bars.map(([w]) => w), y: bars.map(([, y]) => y) },
      ]),
    );
    made.describe(`${upperFirst(part)} over frequency. ${responseSummary(state.reply)}`);
  };
  return { ...readOut, draw };
}

// Upright bars, from each low end to the high one behind it.
function barsOf(plot, series) {
  const stroke = new Path2D();
  const ends = plot.data[series].flatMap((y, k) => (Number.isFinite(y) ? [[plot.data[0][k], y]] : []));
  ends.forEach(([x, y], k) => {
    const place = [plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)];
    if (k % 2) stroke.lineTo(...place);
    else stroke.moveTo(...place);
  });
  return { stroke };
}

function endsOf(reply, name, without) {
  const values = reply?.[name];
  return values ? [values[0], values[values.length - 1]] : without;
}

function valuesIn(reply, part) {
  if (!reply?.responses) return [];
  const all = [...reply.responses.map((one) => one[part]), reply.measured?.[part] ?? []];
  return all.flatMap((values) => [...values]).filter(Number.isFinite);
}

function gainsOf(reply) {
  const gains = valuesIn(reply, "gain").filter((gain) => gain > 0);
  return gains.length ? [Math.min(...gains) / 1.8, Math.max(...gains) * 1.8] : [0.1, 1];
}

function phasesOf(reply) {
  const phases = valuesIn(reply, "phase");
  const [low, high] = phases.length ? [Math.min(...phases), Math.max(...phases)] : [-180, 0];
  return [45 * Math.floor(low / 45 - 0.1), 45 * Math.ceil(high / 45 + 0.1)];
}

function turnsOf(low, high) {
  const step = HALF_TURNS.find((size) => (high - low) / size <= 6) ?? 3600;
  const out = [];
  for (let at = step * Math.ceil(low / step); at <= high; at += step) out.push(at);
  return out;
}

function nameOf(bench, id) {
  const model = bench.state.models.find((one) => one.id === id);
  return model ? modelName(model) : "this model";
}

function between(low, high, unit = "") {
  return Number.isFinite(low) ? ` (${figure(low, 3)} to ${figure(high, 3)}${unit})` : "";
}

function responseInWords({ omega, responses: [own] }, i) {
  const part = (name, unit = "") => {
    const within = between(own[`${name}_low`][i], own[`${name}_high`][i], unit);
    return `${name} ${figure(own[name][i], 3)}${unit}${within}`;
  };
  return `at ${figure(omega[i], 3)} rad/s: ${part("gain")}, ${part("phase", "°")}`;
}

function responseSummary({ input, output, omega, responses: [own] }) {
  let at = 0;
  own.gain.forEach((gain, i) => {
    if (gain > own.gain[at]) at = i;
  });
  return (
    `The response of ${isolated(output)} to ${isolated(input)} is largest at ` +
    `${figure(omega[at], 3)} rad/s: gain ${figure(own.gain[at], 3)}, phase ${figure(own.phase[at], 3)}°.`
  );
}

const ENDS = { "": "", _low: ", low (95 %)", _high: ", high (95 %)" };

function responseColumns(bench, { omega, responses, measured }) {
  const [own, ...kept] = responses;
  const parts = (of, before) =>
    ["gain", "phase"].flatMap((part) =>
      Object.entries(ENDS).map(([end, words]) => [
        `${before}${part}${words}${part === "phase" ? ", deg" : ""}`,
        of[part + end],
      ]),
    );
  return [
    ["frequency, rad/s", omega],
    ...parts(own, ""),
    ...kept.flatMap((one) => parts(one, `${nameOf(bench, one.id)}: `)),
    ...(measured
      ? [
          ["from the runs: frequency, rad/s", measured.omega],
          ...parts(measured, "from the runs: "),
          ["from the runs: coherence", measured.coherence],
        ]
      : []),
  ];
}

function polesPlot(bench, state, help) {
  const dots = (colour, size) => ({
    paths: () => null,
    width: 0,
    dots: true,
    points: { show: true, size, width: 2, fill: () => bench.colours[colour] },
  });
  const edge = { label: "", inKey: false, dash: [3, 4] };
  const made = plotFigure(bench, {
    key: "plot poles",
    help,
    height: () => 200,
    options: {
      scales: {
        x: { time: false, range: () => realsOf(state.reply) },
        y: { range: () => imaginariesOf(state.reply) },
      },
      axes: [
        axisOf(bench, { size: 30, label: "real" }),
        axisOf(bench, { size: MARGIN, label: "imaginary" }),
      ],
      series: [
        {},
        lineOf(bench, "soft", { ...edge, label: "edge of stability", inKey: true }),
        lineOf(bench, "soft", edge),
        lineOf(bench, "simulated", { label: "this model", ...dots("simulated", 12) }),
        ...bench.lines.map((_, i) => lineOf(bench, `kept-${i + 1}`, dots(`kept-${i + 1}`, 7))),
      ],
    },
  });
  const readOut = readable(bench, made, {
    plane: true,
    points: () => (state.reply?.poles ?? []).map(({ real, imag }) => [real, imag]),
    words: (i) => poleInWords(state.reply.poles[i], state.reply.plane),
  });
  const draw = () => {
    const { poles, plane } = state.reply;
    labelKept(bench, made.plot, 4);
    const of = (id) => {
      const own = poles.filter((pole) => pole.id === id);
      return { x: own.map(({ real }) => real), y: own.map(({ imag }) => imag) };
    };
    const unit = plane === "s" ? ", rad/s" : "";
    made.plot.axes[0].label = `real part of ${plane}${unit}`;
    made.plot.axes[1].label = `imaginary part${unit}`;
    made.plot.setData(
      aligned([
        ...edgeOf(plane, state.reply),
        of(0),
        ...bench.lines.map((id) => (id === null ? NOTHING : of(id))),
      ]),
    );
    const own = poles.filter(({ id, imag }) => id === 0 && imag >= 0);
    const told = own.map((pole) => poleInWords(pole, plane)).join(" ");
    made.describe(`Poles in the plane of ${plane}. ${told}`);
  };
  return { ...readOut, draw };
}

// Stable is what lies to the left of the imaginary axis, or inside the unit circle.
function edgeOf(plane, reply) {
  if (plane === "s") return [{ x: [0, 0], y: imaginariesOf(reply) }, NOTHING];
  const x = Array.from({ length: 121 }, (_, i) => -Math.cos((Math.PI * i) / 120));
  const y = x.map((v) => Math.sqrt(Math.max(1 - v * v, 0)));
  return [{ x, y }, { x, y: y.map((v) => -v) }];
}

function realsOf(reply) {
  if (!reply?.poles?.length || reply.plane === "z") return [-1.1, 1.1];
  const reals = reply.poles.map(({ real }) => real);
  const [low, high] = [Math.min(...reals, 0), Math.max(...reals, 0)];
  const room = 0.15 * (high - low) || 1;
  return [low - room, high + room];
}

function imaginariesOf(reply) {
  if (!reply?.poles?.length || reply.plane === "z") return [-1.1, 1.1];
  const reach = 1.2 * Math.max(...reply.poles.map(({ imag }) => Math.abs(imag))) || 1;
  return [-reach, reach];
}

function withError(value, sd) {
  return `${figure(value, 3)}${Number.isFinite(sd) ? ` ± ${figure(sd, 2)}` : ""}`;
}

function poleInWords(pole, plane) {
  const sign = pole.imag < 0 ? "−" : "+";
  const at = `${figure(pole.real, 3)}${pole.imag ? ` ${sign} ${figure(Math.abs(pole.imag), 3)}j` : ""}`;
  return (
    `${plane} = ${at}: ${withError(pole.frequency, pole.sd_frequency)} rad/s, ` +
    `damping ${withError(pole.damping, pole.sd_damping)}.`
  );
}

// A row for a pair.
function polesTable(state) {
  const body = el("tbody");
  const heads = ["model", "frequency, rad/s", "damping", "time constant, s"];
  const table = el(
    "table",
    { class: "sk-poles" },
    el("caption", { class: "sk-hidden" }, "Poles with their standard errors; a pair is one row"),
    el("thead", {}, el("tr", {}, ...heads.map((words) => el("th", { scope: "col" }, words)))),
    body,
  );
  const node = el(
    "div",
    { class: "sk-scroll", tabindex: "0", role: "region", "aria-label": "Poles" },
    table,
  );
  const update = () => {
    const rows = (state.reply.poles ?? []).filter(({ imag }) => imag >= 0);
    body.replaceChildren(
      ...rows.map((pole) =>
        el(
          "tr",
          {},
          el("th", { scope: "row" }, pole.id ? `${pole.id}` : "this"),
          ...["frequency", "damping", "time_constant"].map((name) =>
            el("td", { class: "sk-figure" }, withError(pole[name], pole[`sd_${name}`])),
          ),
        ),
      ),
    );
  };
  return { node, update };
}

function polesColumns(bench, { poles }) {
  const names = {
    "real part": "real",
    "imaginary part": "imag",
    "frequency, rad/s": "frequency",
    "standard error of the frequency": "sd_frequency",
    damping: "damping",
    "standard error of the damping": "sd_damping",
    "time constant, s": "time_constant",
    "standard error of the time constant": "sd_time_constant",
  };
  return [["model", poles.map(({ id }) => nameOf(bench, id))], ...columnsByKey(poles, names)];
}

function stepPlot(bench, state, help) {
  const made = plotFigure(bench, {
    key: "plot step",
    help,
    height: () => 220,
    options: {
      scales: {
        x: { time: false, range: () => endsOf(state.reply, "time", [0, 1]) },
        y: { range: (plot, low, high) => withRoom(low, high) },
      },
      axes: [
        axisOf(bench, { size: 30, label: "time after the step, s" }),
        axisOf(bench, { size: MARGIN, label: "response" }),
      ],
      bands: intervalOf(bench),
      series: modelSeries(bench),
    },
  });
  const readOut = readable(bench, made, {
    points: () => pointsOf(state.reply?.time, state.reply?.steps?.[0].output),
    words: (i) => {
      const { time, steps: [own] } = state.reply;
      const value = withUnit(figure(own.output[i], 3), bench.view.output.unit);
      return `at ${figure(time[i], 3)} s: ${value}${between(own.low[i], own.high[i])}`;
    },
  });
  const draw = () => {
    const { time, steps } = state.reply;
    labelKept(bench, made.plot, 4);
    const line = (one, name = "output") => (one ? { x: time, y: one[name] } : NOTHING);
    const { to, output, input } = linearUnits(bench, state.reply);
    made.plot.axes[1].label = labelOf(output, to);
    made.plot.setData(
      aligned([
        line(steps[0], "low"),
        line(steps[0], "high"),
        line(steps[0]),
        ...keptOf(bench, steps).map((one) => line(one)),
      ]),
    );
    const end = withUnit(figure(steps[0].output[time.length - 1], 3), to);
    made.describe(
      `Step response: ${isolated(output)} after a step of one in ${isolated(input)}. ` +
        `It ends at ${end} after ${figure(time[time.length - 1], 3)} s.`,
    );
  };
  return { ...readOut, draw };
}

function withRoom(low, high) {
  const room = 0.08 * (high - low);
  return low < high ? [low - room, high + room] : [-1, 1];
}

function stepColumns(bench, { time, steps }) {
  const [own, ...kept] = steps;
  return [
    ["time, s", time],
    ["response", own.output],
    ["low (95 %)", own.low],
    ["high (95 %)", own.high],
    ...kept.map(({ id, output }) => [nameOf(bench, id), output]),
  ];
}
