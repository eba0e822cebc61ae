// People side by side: the same effects fitted to each person alone, in small panels on the same axes.

const ROW = 16; // units of a panel of dots, whose width is 260
const NAMES = 84; // of them for the names of people
const SHORT = 13; // letters of a name beside dots
const MOST_WIDE = 3; // usual intervals beyond the values

function peoplePart(bench) {
  const { can, people, most_people: most } = bench.view;
  const node = el("details", { class: "sk-people sk-part" });
  if (!can.people) {
    node.hidden = true;
    return { node, update() {} };
  }
  const begin = button("Fit each person", () => bench.act("fit_people", {}, () => "Each person is being fitted."), {
    "data-sk-key": "fit people",
  });
  const stop = button("Stop", () => bench.act("stop_people", {}, () => "No further person is fitted."), {
    "data-sk-key": "stop people",
    "aria-label": "Stop fitting people",
  });
  const shown = people.slice(0, most).map(({ name }) => name);
  const bar = el("progress", { max: `${shown.length}`, "aria-label": "People fitted" });
  const words = el("p", { class: "sk-soft" });
  const lines = shown.map((name) => personPanel(bench, name));
  const dots = el("div", { class: "sk-multiples" });
  const scale = el("p", { class: "sk-soft" });
  const table = el("table");
  const results = el(
    "div",
    {},
    el("h4", {}, "VAF and parameters, a row for each person"),
    dots,
    el("h4", {}, "Measured and simulated, a panel for each person"),
    el("div", { class: "sk-legend" }, keyOf("measured", "measured"), keyOf("simulated", "simulated")),
    el("div", { class: "sk-multiples" }, ...lines.map((panel) => panel.node)),
    scale,
    el(
      "details",
      {},
      el("summary", { "data-sk-key": "people table" }, "The same as a table"),
      el("div", { class: "sk-scroll", tabindex: "0", role: "region", "aria-label": "People side by side" }, table),
    ),
    csvButton(bench, "people", () => columnsOfPeople(rows)),
  );
  node.append(
    el("summary", { "data-sk-key": "people" }, el("h3", {}, `People side by side (${people.length})`)),
    el(
      "p",
      { class: "sk-soft" },
      "Each person is fitted alone, with the effects of the present model. " +
        (people.length > most ? `The first ${most} of ${people.length} are fitted. ` : "") +
        "A line is the 95 % interval; a dot without one has none that is known.",
    ),
    el("div", { class: "sk-row" }, begin, stop, bar, words),
    results,
  );
  let rows = [];
  let drawn = "";
  const fetch = async () => {
    try {
      rows = (await bench.backend.call("people", {})).people;
    } catch (error) {
      if (!bench.gone) fail(bench, error);
      return;
    }
    if (bench.gone) return;
    const fitted = rows.filter((row) => !row.failure);
    if (!fitted.length) dots.replaceChildren();
    else dots.replaceChildren(...panelsOf(fitted).map((panel) => dotPanel(panel, shown)));
    const size = Math.max(...fitted.flatMap(({ measured }) => [...measured].map(Math.abs)).filter(Number.isFinite));
    lines.forEach((panel, i) => panel.draw(rows[i], size));
    setText(scale, fitted.length ? scaleInWords(bench, fitted, size) : "");
    peopleInto(table, rows);
  };
  const update = () => {
    const told = bench.state.people;
    const running = Boolean(told && told.running);
    begin.hidden = running;
    stop.hidden = bar.hidden = !running;
    results.hidden = !told;
    if (told) bar.value = told.done;
    setText(words, told ? peopleInWords(told, shown.length) : "");
    for (const panel of lines) panel.update();
    const now = told ? JSON.stringify([told.title, told.done]) : "";
    if (told && now !== drawn) fetch();
    drawn = now;
  };
  return { node, update };
}

function peopleInWords({ title, done, running, changed }, of) {
  const now = changed ? " The present model is another: fit each person again." : "";
  return `${done} of ${of} fitted with: ${title}.${running || done === of ? "" : " It was stopped."}${now}`;
}

function scaleInWords({ view }, rows, size) {
  const seconds = Math.max(...rows.map(({ t }) => t[t.length - 1] - t[0]));
  const range = withUnit(`± ${figure(size, 3)}`, view.output.unit);
  return `${figure(seconds, 2)} s of the first run of each; from top to bottom each panel is ${range}.`;
}

// Some seconds of a person; a click leads to the run.
function personPanel(bench, name) {
  const svg = svgEl("svg", { viewBox: "0 0 100 100", preserveAspectRatio: "none", class: "sk-lines", "aria-hidden": "true" });
  const about = el("span", { class: "sk-rows" });
  let run = null;
  const node = button("", () => isUsable(node) && bench.show(run), {
    class: "sk-person-panel",
    "data-sk-key": `panel ${name}`,
  });
  node.append(el("strong", {}, named(name)), svg, about);
  const update = () => {
    setUsable(node, run !== null);
    if (run !== null && bench.run === run) node.setAttribute("aria-current", "true");
    else node.removeAttribute("aria-current");
  };
  const draw = (row, size) => {
    run = row ? row.run : null;
    setText(about, row ? row.failure || `VAF ${percent(row.vaf)}` : "not fitted yet");
    svg.replaceChildren();
    if (row && !row.failure) {
      for (const [key, look] of [["measured", "sk-seen"], ["simulated", "sk-with"]]) {
        svg.append(svgEl("path", { d: traceDrawn(row[key], size), class: look }));
      }
    }
    update();
  };
  return { node, update, draw };
}

function traceDrawn(values, size) {
  const step = 100 / Math.max(values.length - 1, 1);
  let [d, pen] = ["", "M"];
  values.forEach((value, i) => {
    if (Number.isFinite(value)) d += `${pen}${(i * step).toFixed(2)} ${(50 - (48 * value) / size).toFixed(2)}`;
    pen = Number.isFinite(value) ? "L" : "M";
  });
  return d;
}

// What is compared: VAF, and each parameter of any person, with where everybody stands.
function panelsOf(rows) {
  const names = [...new Set(rows.flatMap(({ parameters }) => parameters.map(({ name }) => name)))];
  const of = (row, name) => row.parameters.find((one) => one.name === name);
  return [
    { title: "VAF", unit: "%", people: rows.map((row) => [row.name, { value: row.vaf }]) },
    ...names.map((name) => ({
      title: name,
      unit: rows.map((row) => of(row, name)).find(Boolean).unit,
      people: rows.map((row) => [row.name, of(row, name)]).filter(([, one]) => one),
    })),
  ];
}

function dotPanel({ title, unit, people }, names) {
  const [low, high] = extentOfDots(people.map(([, one]) => one));
  const at = (value) => NAMES + 8 + (160 * (clamp(value, [low, high]) - low)) / (high - low);
  const height = ROW * names.length;
  const svg = svgEl("svg", { viewBox: `0 0 260 ${height + 18}`, class: "sk-dots", role: "img" });
  const said = people.map(([name, { value }]) => `${isolated(name)} ${figure(value, 3)}`);
  svg.setAttribute("aria-label", `${withUnit(title, unit)}: ${said.join(", ")}`);
  [low, (low + high) / 2, high].forEach((value, i) => {
    svg.append(svgEl("path", { d: `M${at(value)} 0v${height}`, class: "sk-grid" }));
    const where = { x: at(value), y: height + 13, "text-anchor": ["start", "middle", "end"][i] };
    svg.append(textDrawn(figure(value, 3), { ...where, class: "sk-tick-text" }));
  });
  names.forEach((name, i) => {
    const y = ROW * (i + 0.5);
    svg.append(textDrawn(shortened(seenName(name), SHORT), { x: 0, y: y + 4 }));
    const one = (people.find(([other]) => other === name) ?? [])[1];
    if (!one || !Number.isFinite(one.value)) return;
    if (Number.isFinite(one.low) && Number.isFinite(one.high)) {
      svg.append(svgEl("path", { d: `M${at(one.low)} ${y}H${at(one.high)}` }));
    }
    svg.append(svgEl("circle", { cx: at(one.value), cy: y, r: 3.5 }));
  });
  return el("div", {}, el("h4", {}, named(title), unit && unit !== "-" ? `, ${unit}` : ""), svg);
}

// Values and intervals; one that is many times as wide as the others is cut.
function extentOfDots(all) {
  const values = all.map(({ value }) => value).filter(Number.isFinite);
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const widths = all.map(({ low, high }) => high - low).filter(Number.isFinite);
  const usual = widths.sort((a, b) => a - b)[widths.length >> 1] ?? 0;
  const room = MOST_WIDE * (usual || most - least || Math.abs(most) || 1);
  const ends = all.flatMap(({ low, high }) => [low, high]).filter(Number.isFinite);
  const low = Math.max(Math.min(least, ...ends), least - room);
  const high = Math.min(Math.max(most, ...ends), most + room);
  const edge = (high - low || room) / 20;
  return [low - edge, high + edge];
}

function columnsOfPeople(rows) {
  const all = rows.flatMap(({ name: person, vaf, failure, parameters }) => [
    { person, quantity: "VAF", value: vaf, unit: "%", failure },
    ...(parameters ?? []).map(({ name, ...one }) => ({ person, quantity: name, ...one })),
  ]);
  const keys = { person: "person", quantity: "quantity", value: "value", "standard error": "sd" };
  return columnsByKey(all, { ...keys, low: "low", high: "high", unit: "unit", failure: "failure" });
}

function peopleInto(table, rows) {
  const panels = panelsOf(rows.filter((row) => !row.failure));
  const head = ["person", ...panels.map(({ title, unit }) => withUnit(title, unit))];
  const cell = (row, { people }) => {
    const one = (people.find(([name]) => name === row.name) ?? [])[1];
    const known = one && Number.isFinite(one.low) && Number.isFinite(one.high);
    const interval = known ? `${figure(one.low, 3)} to ${figure(one.high, 3)}` : "";
    return el("td", { class: "sk-figure" }, figure(one && one.value), el("span", { class: "sk-rows" }, interval));
  };
  table.replaceChildren(
    el("thead", {}, el("tr", {}, ...head.map((text) => el("th", { scope: "col" }, text)))),
    el(
      "tbody",
      {},
      ...rows.map((row) =>
        el("tr", {}, el("th", { scope: "row" }, named(row.name)), ...panels.map((panel) => cell(row, panel))),
      ),
    ),
  );
}
