// The response of the linear part to a step.

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
    const { time, steps, input, output } = state.reply;
    const { unit } = bench.view.output;
    labelKept(bench, made.plot);
    const line = (one, name = "output") => (one ? { x: time, y: one[name] } : NOTHING);
    made.plot.axes[1].label = labelOf(output, unit);
    made.plot.setData(
      aligned([
        line(steps[0], "low"),
        line(steps[0], "high"),
        line(steps[0]),
        ...keptOf(bench, steps).map((one) => line(one)),
      ]),
    );
    const end = withUnit(figure(steps[0].output[time.length - 1], 3), unit);
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
