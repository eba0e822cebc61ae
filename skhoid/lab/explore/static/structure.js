// What is fitted: the operator's physics or an ARX model, each of them a step beside the others.

const CORES = { operator: "the operator's physics", arx: "an ARX model" };
const ORDERS = { na: ["output lags", 1], nb: ["input coefficients", 1], nk: ["delay in rows", 0] };

function structurePart(bench) {
  const { can } = bench.view;
  const title = el("h3", { id: `${bench.id}-structure` }, "Structure");
  const summary = el("summary", { class: "sk-summary", "data-sk-key": "structure" });
  const core = el(
    "select",
    { class: "sk-select", "data-sk-key": "core", "aria-label": "Structure", onchange: () => choose() },
    ...Object.entries(CORES).map(([value, words]) => el("option", { value }, words)),
  );
  const boxes = Object.entries(ORDERS).map(([name, [words, min]]) => {
    const attributes = { type: "number", step: "1", min, class: "sk-number", "data-sk-key": `order ${name}` };
    const box = el("input", { ...attributes, "aria-label": `${name}, ${words}` });
    return { name, box, node: el("label", {}, name, box) };
  });
  const orders = el("div", { class: "sk-row" }, ...boxes.map(({ node }) => node));
  const hint = el("p", { class: "sk-soft" });
  const fit = el("button", { class: "sk-button sk-small", "data-sk-key": "fit structure" }, "Fit this structure");
  const form = el("form", { class: "sk-structure" }, core, orders, hint, fit);
  const node = el("details", { class: "sk-structure-part", role: "group", "aria-labelledby": title.id }, summary, title, form);
  const choose = () => {
    const isARX = core.value === "arx";
    for (const { box } of boxes) box.disabled = !isARX;
    setText(hint, isARX ? "na and nb empty: 2. nk empty: it is found." : "Its delay is estimated.");
  };
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const asked = { core: core.value };
    if (asked.core === "arx") {
      for (const { name, box } of boxes) asked[name] = box.value === "" ? null : box.valueAsNumber;
    }
    bench.act("structure", asked, (before, after) => `${after.structure.name}: ${fromTo(before.vaf.train, after.vaf.train)}`);
  });
  let shown = "";
  const update = () => {
    const { structure } = bench.state;
    node.hidden = !can.structure;
    if (!can.structure || structure.name === shown) return; // what was typed stays
    shown = structure.name;
    setText(summary, `Structure: ${structure.name}`);
    core.value = structure.core;
    if (structure.core === "arx") for (const { name, box } of boxes) box.value = structure[name];
    choose();
  };
  return { node, update };
}
