// Runs and people: which the model is fitted to, which it is tested on, which are left out.

const USES = [
  ["train", "train"],
  ["hold", "hold out"],
  ["out", "leave out"],
];
const USED = { train: "fitted", hold: "held out", out: "left out" };

function runsPart(bench) {
  const { view } = bench;
  const groups = view.people.length
    ? view.people
    : [{ name: null, runs: view.runs.map((_, i) => i) }];
  const rows = [];
  const people = [];
  const body = [];
  for (const { name, runs } of groups) {
    const tbody = el("tbody");
    if (name !== null) people.push(personRow(bench, tbody, name, runs, people.length));
    for (const run of runs) rows.push(runRow(bench, tbody, run));
    body.push(tbody);
  }
  const split = view.can.split;
  const heads = split ? USES.map(([, words]) => words) : usesAreKnown(view) ? ["use"] : [];
  const table = el(
    "table",
    { class: split ? "sk-runs sk-split" : "sk-runs" },
    el("caption", { class: "sk-hidden" }, "Runs, their VAF and their use"),
    el(
      "thead",
      {},
      el("tr", {}, ...["run", "VAF", ...heads].map((words) => el("th", { scope: "col" }, words))),
    ),
    ...body,
  );
  const list = el("div", { class: "sk-run-list" }, table);
  const summary = el("summary", { class: "sk-summary", "data-sk-key": "runs" });
  const title = el("h3", { id: `${bench.id}-runs` }, "Runs");
  const node = el(
    "details",
    { class: "sk-runs-part", role: "group", "aria-labelledby": title.id },
    summary,
    title,
    list,
    csvButton(bench, "runs", () => columnsOfRuns(bench)),
  );
  const update = () => {
    const { uses } = bench.state;
    const run_vaf = (bench.live ?? bench.state).run_vaf ?? bench.state.run_vaf;
    for (const row of rows) row.update(uses, run_vaf);
    for (const person of people) person.update(uses);
    setText(summary, usesInWords(uses));
  };
  return { node, update };
}

function columnsOfRuns({ view, state }) {
  return [
    ["run", view.runs.map(({ label }) => label)],
    ["person", view.runs.map(({ person }) => person)],
    ["rows", view.runs.map(({ n }) => n)],
    ["use", state.uses.map((use) => USED[use] ?? "")],
    ["VAF, %", state.run_vaf],
  ];
}

// Of a comparison it is not known what its rows were used for.
function usesAreKnown({ state }) {
  return state.uses.some(Boolean);
}

function usesInWords(uses) {
  const parts = Object.entries(USED).map(([use, words]) => [
    uses.filter((u) => u === use).length,
    words,
  ]);
  const told = parts.filter(([n]) => n > 0).map(([n, words]) => `${n} ${words}`);
  return told.length ? `Runs: ${told.join(", ")}` : `Runs: ${uses.length}`;
}

function runRow(bench, tbody, run) {
  const { label, n } = bench.view.runs[run];
  const kept = bench.backend.kept ? bench.backend.kept(run) : true;
  const show = button("", () => isUsable(show) && bench.show(run), {
    class: "sk-run",
    "data-sk-key": `run ${run}`,
  });
  show.append(named(runName(label)));
  setUsable(show, kept);
  const vaf = el("td", { class: "sk-figure" });
  const cells = useCells(bench, [run], `run ${run}`, runName(label));
  const sizes = new Set(bench.view.runs.map((other) => other.n));
  const parts = [sizes.size > 1 && count(n, "row"), !kept && "not kept on this page"];
  const about = parts.filter(Boolean).join(", ");
  tbody.append(
    el(
      "tr",
      {},
      el("th", { scope: "row" }, show, about && el("span", { class: "sk-rows" }, about)),
      vaf,
      ...cells.nodes,
    ),
  );
  return {
    update: (uses, run_vaf) => {
      if (bench.run === run) show.setAttribute("aria-current", "true");
      else show.removeAttribute("aria-current");
      setText(vaf, percent(run_vaf[run]).replace(" %", "").replace("below ", "< "));
      vaf.classList.toggle("sk-soft", uses[run] === "hold" || uses[run] === "out");
      cells.update(uses);
    },
  };
}

function personRow(bench, tbody, name, runs, k) {
  const cells = useCells(bench, runs, `person ${k}`, name);
  tbody.append(
    el(
      "tr",
      { class: "sk-person" },
      el("th", { scope: "rowgroup", colspan: "2" }, named(name)),
      ...cells.nodes,
    ),
  );
  return cells;
}

// Three ticks for a run, or for all runs of a person; words where nothing can be changed.
function useCells(bench, runs, key, name) {
  const common = (uses) => (runs.every((r) => uses[r] === uses[runs[0]]) ? uses[runs[0]] : null);
  if (!usesAreKnown(bench.view)) return { nodes: [], update() {} };
  if (!bench.view.can.split) {
    const cell = el("td");
    const update = (uses) => setText(cell, USED[common(uses)] ?? "");
    return { nodes: [cell], update };
  }
  const ticks = USES.map(([use, words]) =>
    el("input", {
      type: "radio",
      name: `${bench.id} ${key}`,
      value: use,
      "data-sk-key": `${key} ${use}`,
      "aria-label": `${words}: ${isolated(name)}`,
      onchange: () =>
        bench.act(
          "use",
          { runs, use },
          (before, after) =>
            `${upperFirst(isolated(name))} ${USED[use]}: ` +
            fromTo(before.vaf.train, after.vaf.train),
        ),
    }),
  );
  const update = (uses) => {
    for (const tickBox of ticks) tickBox.checked = tickBox.value === common(uses);
  };
  return { nodes: ticks.map((t) => el("td", { class: "sk-tick" }, t)), update };
}
