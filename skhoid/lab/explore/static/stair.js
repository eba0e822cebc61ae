// The stair of the error: what each step leaves unexplained, down to the noise ceiling.

const LEAST_STEP = 84; // px

function stairPart(bench) {
  const sentence = el("p", { class: "sk-sentence" });
  const steps = el("ol", { class: "sk-steps" });
  const held = el("p", { class: "sk-soft" });
  const note = el("p", { class: "sk-soft" });
  const about = el(
    "details",
    { class: "sk-soft" },
    el("summary", {}, "About the noise ceiling"),
    note,
  );
  const key = keyOf("noise", "noise ceiling");
  const now = () => ({ ...bench.state, ...bench.live });
  const save = saveMenu(
    bench,
    "error that remains",
    { draw: () => stairDrawn(bench, now()) },
    () => stairColumns(now()),
    false,
  );
  const title = el("h3", { id: `${bench.id}-stair` }, "Error that remains");
  const node = el(
    "div",
    { class: "sk-stair sk-part", role: "group", "aria-labelledby": title.id },
    el("div", { class: "sk-head" }, title, bench.busyNode),
    sentence,
    el("div", { class: "sk-legend" }, key, save),
    steps,
    held,
    about,
  );
  // Bars lie where upright ones are too narrow for a word of their names.
  let stood = "";
  const lieDown = (stair) => {
    const now = JSON.stringify([bench.stairWidth, ...stair.map((step) => step.title)]);
    if (now === stood) return;
    stood = now;
    steps.classList.remove("sk-many");
    const names = [...steps.querySelectorAll(".sk-step-name")];
    const tight = names.some((name) => name.scrollWidth > name.clientWidth);
    steps.classList.toggle("sk-many", tight || bench.stairWidth < LEAST_STEP * stair.length);
  };
  const where = bench.view.state.uses.some(Boolean) ? "On the runs fitted: " : "";
  const update = () => {
    const { stair, vaf, ceiling, ceiling_pending: pending, impossible } = now();
    setText(sentence, impossible ?? where + stairInWords(stair, ceiling, pending));
    sentence.classList.toggle("sk-warning", Boolean(impossible));
    key.classList.toggle("sk-unseen", !ceiling);
    const most = topOf(stair, ceiling);
    arrange(
      steps,
      stair.map((step, i) => stepNode(steps.children[i], step, stair[i - 1], most, ceiling)),
    );
    lieDown(stair);
    setText(held, vaf.hold === null ? "" : `On held-out runs: VAF ${percent(vaf.hold)}.`);
    held.hidden = vaf.hold === null;
    setText(note, ceiling && ceiling.note ? ceiling.note : "");
    about.classList.toggle("sk-unseen", !note.textContent);
  };
  return { node, update };
}

function errorOf(vaf) {
  return vaf === null || Number.isNaN(vaf) ? 100 : clamp(100 - vaf, [0, 100]);
}

function topOf(stair, ceiling) {
  const errors = stair.map((step) => errorOf(step.vaf));
  if (ceiling) errors.push(100 - ceiling.vaf);
  return Math.max(...errors, 1e-9);
}

function stepNode(old, step, before, most, ceiling) {
  const node = old ?? newStep();
  const error = errorOf(step.vaf);
  const [bar, line] = ["bar", "ceiling"].map((name) => node.querySelector(`.sk-${name}`));
  node.style.setProperty("--sk-size", `${(100 * error) / most}%`);
  line.hidden = !ceiling;
  if (ceiling) {
    node.style.setProperty("--sk-ceiling", `${(100 * errorOf(ceiling.vaf)) / most}%`);
  }
  bar.classList.toggle("sk-beyond", !(100 - step.vaf <= 100));
  const [name, vaf, gain, held] = ["name", "vaf", "gain", "held"].map((part) =>
    node.querySelector(`.sk-step-${part}`),
  );
  setText(name, step.title);
  setText(vaf, `VAF ${percent(step.vaf)}`);
  setText(gain, before ? `${points(gained(before.vaf, step.vaf))} points` : "");
  setText(
    held,
    step.held === null || step.held === undefined ? "" : `held out ${percent(step.held)}`,
  );
  return node;
}

function newStep() {
  const part = (name) => el("span", { class: `sk-step-${name}` });
  return el(
    "li",
    { class: "sk-step" },
    el(
      "span",
      { class: "sk-well", "aria-hidden": "true" },
      el("span", { class: "sk-bar" }),
      el("span", { class: "sk-ceiling" }),
    ),
    el("bdi", { class: "sk-step-name" }),
    part("vaf"),
    part("gain"),
    part("held"),
  );
}

const BAR = 150; // px, of a step in a picture
const HIGH = 160; // px, of the largest error
const FLOOR = ABOVE + 10 + HIGH; // px, where the bars stand

// The picture of the stair, for a file: upright bars with their figures below.
function stairDrawn(bench, { stair, ceiling }) {
  const { colours } = bench;
  const svg = sheet(bench, 20 + BAR * stair.length, FLOOR + 70);
  const most = topOf(stair, ceiling);
  const heightOfBar = (vaf) => (HIGH * errorOf(vaf)) / most;
  stair.forEach(({ title, vaf }, i) => {
    const x = 10 + BAR * i;
    const height = heightOfBar(vaf);
    const fill = i === stair.length - 1 ? colours.simulated : colours.bar;
    const gain = i ? `${points(gained(stair[i - 1].vaf, vaf))} points` : "";
    svg.append(
      svgEl("rect", { x, y: FLOOR - height, width: BAR - 2, height, fill }),
      textDrawn(shortened(title, 20), { x, y: FLOOR + 20, fill: colours.ink, "font-weight": 600 }),
      textDrawn(`VAF ${percent(vaf)}`, { x, y: FLOOR + 38, fill: colours.ink }),
      textDrawn(gain, { x, y: FLOOR + 56, fill: colours.soft }),
    );
  });
  if (ceiling) {
    const dotted = { stroke: colours.noise, "stroke-width": 3, "stroke-dasharray": "3 3" };
    const y = FLOOR - heightOfBar(ceiling.vaf);
    const words = `noise ceiling: VAF at least ${percent(ceiling.vaf)}`;
    svg.append(
      svgEl("path", { d: `M10 ${y}h${BAR * stair.length}`, ...dotted }),
      svgEl("path", { d: "M10 14h24", ...dotted }),
      textDrawn(words, { x: 40, y: 18, fill: colours.ink }),
    );
  }
  return svg;
}

function stairColumns({ stair, ceiling }) {
  return [
    ...columnsByKey(stair, { step: "title", "VAF, %": "vaf", RMSE: "rmse", "VAF held out, %": "held" }),
    ["noise ceiling at least, % VAF", ceiling ? [ceiling.vaf] : []],
  ];
}

function stairInWords(stair, ceiling, pending) {
  const last = stair[stair.length - 1].vaf;
  const gained = stair.length > 1 ? fromTo(stair[0].vaf, last) : `VAF ${percent(last)}`;
  if (!ceiling) {
    return `${gained}.${pending ? " The noise ceiling is being estimated …" : ""}`;
  }
  const { vaf } = ceiling;
  const left = vaf - last;
  const rest =
    left > 0.05
      ? `${left > 1000 ? "more than 1,000" : left.toFixed(1)} points are left to explain.`
      : left > -0.5
        ? "nothing is left that these runs show."
        : "the model is above it: it was estimated from a model that lacks more.";
  return `${gained}. Noise ceiling at least ${percent(vaf)}: ${rest}`;
}
