// The title, the verdict, what went wrong, and what was done last.

function topPart(bench) {
  const words = el("span");
  const add = button("", () => isUsable(add) && addNamed(bench), {
    class: "sk-button sk-primary",
    "data-sk-key": "add named",
  });
  const verdict = el("div", { class: "sk-verdict sk-head" }, words, add);
  const list = el("ul", { class: "sk-findings" });
  const summary = el("summary", { "data-sk-key": "findings" });
  const findings = el("details", {}, summary, list);
  const message = el("span", { dir: "auto" });
  const trouble = el("div", { class: "sk-alert", role: "alert" });
  const dismiss = button("Dismiss", () => bench.alert(null), { class: "sk-button sk-small" });
  const status = el("p", { class: "sk-status", role: "status" });
  const busy = el("span", { class: "sk-busy" });
  const saving = savingParts(bench);
  bench.busyNode = busy;
  const node = el(
    "div",
    { class: "sk-top" },
    el(
      "div",
      { class: "sk-head" },
      bench.view.title ? el("h2", {}, named(bench.view.title)) : null,
      saving.buttons,
    ),
    verdict,
    el("div", { class: "sk-under" }, findings, status),
    ...saving.results,
    bench.view.note ? el("p", { class: "sk-soft" }, bench.view.note) : null,
    trouble,
  );
  bench.say = (text) => {
    status.textContent = text;
  };
  bench.alert = (text) => {
    setText(message, text ?? "");
    trouble.replaceChildren(...(text ? [message, dismiss] : []));
  };
  bench.busy = (words) => {
    if (!words) return () => {};
    bench.computing += 1;
    busy.textContent = words;
    bench.root.setAttribute("aria-busy", "true");
    return () => {
      bench.computing -= 1;
      if (bench.computing > 0) return;
      busy.textContent = "";
      bench.root.removeAttribute("aria-busy");
    };
  };
  const update = () => {
    const { verdict: told, verdict_kind: kind, findings: found, to_add: left } = bench.state;
    setText(words, told);
    verdict.hidden = !told;
    verdict.dataset.kind = kind;
    add.hidden = left.length === 0 || !bench.view.can.any;
    setText(add, ["", "Add it", "Add both"][left.length] ?? `Add all ${left.length}`);
    findings.hidden = found.length === 0;
    setText(summary, `Findings (${found.length})`);
    list.replaceChildren(
      ...found.map(({ what, why }) => el("li", {}, el("strong", {}, what), " ", why)),
    );
  };
  return { node, update };
}

function columnsOfParameters({ model, effects }) {
  const all = [...model, ...effects.flatMap((effect) => effect.parameters)];
  const keys = { parameter: "name", value: "value", "standard error": "sd" };
  return columnsByKey(all, { ...keys, unit: "unit", meaning: "meaning" });
}

// The other parameters: those of an operator can be moved too.
function modelPart(bench) {
  const title = el("h3", { id: `${bench.id}-model` }, "Other parameters");
  const list = el("div", { class: "sk-model" });
  const summary = el("summary", { class: "sk-summary", "data-sk-key": "model" });
  const node = el(
    "details",
    { class: "sk-model-part", role: "group", "aria-labelledby": title.id },
    summary,
    title,
    list,
    csvButton(bench, "parameters", () => columnsOfParameters(bench.state)),
  );
  const rows = new Map();
  const update = () => {
    const { model } = bench.state;
    node.hidden = model.length === 0;
    setText(summary, `Other parameters (${model.length})`);
    for (const p of model) {
      if (!rows.has(p.name)) rows.set(p.name, parameterRow(bench, { name: "", title: "the model" }, p));
    }
    arrange(
      list,
      model.map(({ name }) => rows.get(name).node),
    );
    for (const p of model) rows.get(p.name).update(p);
  };
  return { node, update };
}
