// Gain and phase of the linear part over frequency, and what was measured without a model.

const HALF_TURNS = [45, 90, 180, 360, 720]; // deg, between the lines of the phase

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
    labelKept(bench, made.plot);
    const bar = (w, i) => [`${part}_low`, `${part}_high`].map((end) => [w, measured[end][i]]);
    const bars = measured ? Array.from(measured.omega).flatMap((w, i) => [...bar(w, i), [w, null]]) : [];
    if (isGain) made.plot.axes[1].label = labelOf("gain", gainUnit(bench, state.reply));
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
