// Models side by side: what was kept, its VAF and numbers, and its line over time.

function modelsPart(bench) {
  const title = el("h3", { id: `${bench.id}-models` }, "Models");
  const keep = button("Keep this model", () => bench.act("keep", {}, () => "The model is kept."), {
    class: "sk-button sk-small",
    "data-sk-key": "keep",
  });
  const list = el("tbody");
  const heads = ["model", "VAF"].map((words) => el("th", { scope: "col" }, words));
  const table = el(
    "table",
    { class: "sk-models" },
    el("caption", { class: "sk-hidden" }, "Models, and their VAF on the runs that are fitted now"),
    el("thead", {}, el("tr", {}, ...heads)),
    list,
  );
  const numbers = el("table");
  const beside = el(
    "details",
    {},
    el("summary", { "data-sk-key": "beside" }, "Parameters side by side"),
    el("div", { class: "sk-scroll", tabindex: "0", role: "region", "aria-label": "Parameters side by side" }, numbers),
    csvButton(bench, "parameters of the models", () => columnsOfModels(bench.state.models)),
  );
  const summary = el("summary", { class: "sk-summary", "data-sk-key": "models" });
  const node = el(
    "details",
    { class: "sk-models-part", role: "group", "aria-labelledby": title.id },
    summary,
    title,
    table,
    keep,
    beside,
  );
  const rows = new Map();
  const update = () => {
    const { models } = bench.state;
    node.hidden = !bench.view.can.any;
    setText(summary, `Models (${models.length})`);
    for (const id of rows.keys()) {
      if (models.some((model) => model.id === id)) continue;
      rows.delete(id);
      bench.lines = bench.lines.map((shown) => (shown === id ? null : shown));
      bench.traces.clear(); // its number may be given again
      bench.redraw("time");
    }
    for (const model of models) if (!rows.has(model.id)) rows.set(model.id, modelRow(bench, model));
    arrange(list, models.map(({ id }) => rows.get(id).node));
    models.forEach((model) => rows.get(model.id).update(model));
    beside.hidden = models.length < 2;
    numbersInto(numbers, models);
  };
  return { node, update };
}

function modelName({ id, title }) {
  return id ? `${id}: ${title}` : `this model: ${title}`;
}

function modelRow(bench, { id }) {
  const swatch = el("span", { class: "sk-swatch" });
  const tick = el("input", {
    type: "checkbox",
    "data-sk-key": `line ${id}`,
    onchange: () => {
      if (showModel(bench, id, tick.checked)) return;
      tick.checked = false;
      bench.say(`At most ${LINES} models are shown at once.`);
    },
  });
  const name = el("span", {});
  const about = el("span", { class: "sk-rows" });
  const vaf = el("td", { class: "sk-figure" });
  const act = (word, action, said) =>
    button(word, () => bench.act(action, { model: id }, said), {
      class: "sk-button sk-small",
      "data-sk-key": `${action} ${id}`,
      "aria-label": `${word}: model ${id}`,
    });
  const gone = (before, after) => `Model ${id}: ${fromTo(before.vaf.train, after.vaf.train)}`;
  const buttons = [
    act("Go to", "recall", gone),
    act("Drop", "drop", () => `Model ${id} is dropped.`),
  ];
  const node = el(
    "tr",
    {},
    el(
      "th",
      { scope: "row" },
      el("label", {}, id ? tick : null, swatch, name),
      about,
      id ? el("span", { class: "sk-row" }, ...buttons) : null,
    ),
    vaf,
  );
  const update = (model) => {
    const slot = bench.lines.indexOf(id);
    tick.checked = slot >= 0;
    swatch.className = `sk-swatch sk-is-${id ? (slot < 0 ? "off" : `kept-${slot + 1}`) : "simulated"}`;
    setText(name, modelName(model));
    const { train, hold } = model.vaf;
    const notes = [
      hold !== null && `held out ${percent(hold)}`,
      model.other_runs && "fitted to other runs than now",
    ];
    setText(about, notes.filter(Boolean).join(", "));
    about.hidden = !about.textContent;
    setText(vaf, percent(train).replace(" %", ""));
  };
  return { node, update };
}

// Gives a model a line over time, or takes it away; false where no colour is left.
function showModel(bench, id, shown) {
  const slot = bench.lines.indexOf(shown ? null : id);
  if (shown && slot < 0) return false;
  if (slot >= 0) bench.lines[slot] = shown ? id : null;
  if (shown) traceModel(bench, id);
  else bench.redraw("time");
  bench.render();
  return true;
}

async function traceModel(bench, id) {
  const { run } = bench;
  try {
    await traceOfModel(bench, id, run);
    if (!bench.gone && run === bench.run) bench.redraw("time");
  } catch (error) {
    if (!bench.gone) fail(bench, error);
  }
}

// What a kept model simulates in a run, asked for once.
async function traceOfModel({ traces, backend }, id, run) {
  const key = `${id} ${run}`;
  if (!traces.has(key)) traces.set(key, (await backend.call("model", { model: id, run })).simulated);
  return traces.get(key);
}

// What is known of the lines that are shown, in the run that is shown.
function tracesOf({ lines, traces, run }) {
  return lines.map((id) => (id === null ? null : (traces.get(`${id} ${run}`) ?? null)));
}

// The models whose lines are shown, each by its place among the colours.
function keptShown({ lines, state }) {
  return lines.map((id) => state.models.find((model) => id !== null && model.id === id) ?? null);
}

function columnsOfModels(models) {
  const names = [...new Set(models.flatMap(({ parameters }) => parameters.map(({ name }) => name)))];
  const known = (model) => new Map(model.parameters.map((one) => [one.name, one]));
  const units = new Map(models.flatMap((model) => [...known(model)].map(([k, { unit }]) => [k, unit])));
  return [
    ["parameter", names],
    ...models.map((model) => [modelName(model), names.map((name) => known(model).get(name)?.value)]),
    ["unit", names.map((name) => units.get(name))],
  ];
}

function numbersInto(table, models) {
  const [[, names], ...columns] = columnsOfModels(models);
  const units = columns.pop()[1];
  table.replaceChildren(
    el(
      "thead",
      {},
      el("tr", {}, ...["", ...models.map(({ id }) => (id ? `${id}` : "this"))].map((words) => el("th", { scope: "col" }, words || "parameter"))),
    ),
    el(
      "tbody",
      {},
      ...names.map((name, i) =>
        el(
          "tr",
          {},
          el("th", { scope: "row" }, named(name), el("span", { class: "sk-rows" }, unitOf({ unit: units[i] }))),
          ...columns.map(([, values]) => el("td", { class: "sk-figure" }, figure(values[i]))),
        ),
      ),
    ),
  );
}
