// Poles of the linear part, as points and as a table.

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
    points: () => inPlane(state.reply).map(({ real, imag }) => [real, imag]),
    words: (i) => poleInWords(inPlane(state.reply)[i]),
  });
  const draw = () => {
    const { plane } = state.reply;
    const poles = inPlane(state.reply);
    labelKept(bench, made.plot);
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
    const told = own.map((pole) => poleInWords(pole)).join(" ");
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

// Those of an operator are in s and those of ARX in z: the table has both, the picture its own.
function inPlane(reply) {
  return (reply?.poles ?? []).filter(({ plane }) => plane === reply.plane);
}

function realsOf(reply) {
  if (!reply?.poles?.length || reply.plane === "z") return [-1.1, 1.1];
  const reals = inPlane(reply).map(({ real }) => real);
  const [low, high] = [Math.min(...reals, 0), Math.max(...reals, 0)];
  const room = 0.15 * (high - low) || 1;
  return [low - room, high + room];
}

function imaginariesOf(reply) {
  if (!reply?.poles?.length || reply.plane === "z") return [-1.1, 1.1];
  const reach = 1.2 * Math.max(...inPlane(reply).map(({ imag }) => Math.abs(imag))) || 1;
  return [-reach, reach];
}

function withError(value, sd) {
  return `${figure(value, 3)}${Number.isFinite(sd) ? ` ± ${figure(sd, 2)}` : ""}`;
}

function poleInWords(pole) {
  const sign = pole.imag < 0 ? "−" : "+";
  const at = `${figure(pole.real, 3)}${pole.imag ? ` ${sign} ${figure(Math.abs(pole.imag), 3)}j` : ""}`;
  return (
    `${pole.plane} = ${at}: ${withError(pole.frequency, pole.sd_frequency)} rad/s, ` +
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
    plane: "plane",
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
