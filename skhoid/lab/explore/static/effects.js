// Effects that were added: each with its curve and its parameters.

const ESTIMATED_AGAIN =
  "A refit keeps the numbers of effects that you moved, and estimates those of the operator again.";

function effectsPart(bench) {
  const title = el("h3", { id: `${bench.id}-effects`, tabindex: "-1" }, "Effects in the model");
  const list = el("div", { class: "sk-cards" });
  const none = el("p", { class: "sk-soft" }, "None yet: this is the baseline.");
  const can = bench.view.can;
  const undo = stepButton(bench, "undo", "Undo", "Control+Z");
  const redo = stepButton(bench, "redo", "Redo", "Control+Shift+Z");
  const refit = button("Refit the others", () => isUsable(refit) && refitOthers(bench), {
    "data-sk-key": "refit",
  });
  const told = el("p", { class: "sk-soft" });
  const history = el(
    "div",
    { class: "sk-row" },
    can.change ? undo.node : null,
    can.change ? redo.node : null,
  );
  const after = el("div", { class: "sk-row" }, can.drag ? refit : null);
  const node = el(
    "div",
    {
      class: "sk-effects sk-part",
      role: "group",
      "aria-labelledby": title.id,
      "data-sk-place": "",
      tabindex: "-1",
    },
    el("div", { class: "sk-head" }, title, history),
    none,
    list,
    after,
    told,
  );
  const cards = new Map();
  const update = () => {
    const { effects, settled } = { ...bench.state, ...bench.live };
    none.hidden = effects.length > 0;
    node.hidden = effects.length === 0 && !can.change;
    const kept = effects.map((effect) => {
      const key = `${effect.name} ${effect.parameters.map((p) => p.name).join(" ")}`;
      if (!cards.has(key)) cards.set(key, effectCard(bench, effect));
      return [key, cards.get(key)];
    });
    arrange(
      list,
      kept.map(([, card]) => card.node),
    );
    const present = new Set(kept.map(([key]) => key));
    for (const key of cards.keys()) if (!present.has(key)) cards.delete(key);
    kept.forEach(([, card], i) => card.update(effects[i]));
    undo.update(bench.state.undo);
    redo.update(bench.state.redo);
    setUsable(refit, !settled);
    refit.hidden = settled && effects.every((effect) => !effect.parameters.length);
    const own = bench.state.model.some((p) => p.moved);
    const words = "Moved by hand: the other parameters are still those of the last fit.";
    setText(told, settled ? "" : `${words}${own ? ` ${ESTIMATED_AGAIN}` : ""}`);
    told.hidden = settled;
  };
  return { node, update };
}

function refitOthers(bench) {
  bench.act(
    "refit",
    {},
    (before, after) =>
      `The other parameters were refitted: ${fromTo(before.vaf.train, after.vaf.train)}`,
  );
}

function stepButton(bench, name, word, keys) {
  const node = button(word, () => isUsable(node) && stepHistory(bench, name), {
    "data-sk-key": name,
    "aria-keyshortcuts": keys,
  });
  const update = (words) => {
    setUsable(node, words !== null);
    setText(node, words ? `${word}: ${words[0].toLowerCase()}${words.slice(1)}` : word);
  };
  return { node, update };
}

function stepHistory(bench, name) {
  const done = { undo: "Undone", redo: "Done again" }[name];
  bench.act(
    name,
    {},
    (before, after) => `${done}: ${before[name]}. ${fromTo(before.vaf.train, after.vaf.train)}`,
  );
}

function effectCard(bench, effect) {
  const heading = el("h4", {}, named(effect.title));
  const about = el("p");
  const form = el("p", { class: "sk-form" });
  const curve = curvePlot(bench, effect.title);
  const rows = effect.parameters.map((p) => parameterRow(bench, effect, p));
  const live = el("p", { class: "sk-live" });
  const remove = button("Remove", () => removeEffect(bench, effect), {
    "data-sk-key": `card ${effect.name}`,
    "aria-label": `Remove ${isolated(effect.title)}`,
  });
  const node = el(
    "div",
    { class: "sk-card sk-added", role: "group", "aria-label": effect.title },
    el("div", { class: "sk-head" }, heading, bench.view.can.change ? remove : null),
    about,
    form,
    curve.node,
    ...rows.map((row) => row.node),
    live,
  );
  const update = (now) => {
    const shown =
      bench.live && bench.live.curve && bench.live.of === now.name ? bench.live.curve : now.curve;
    setText(about, now.words);
    setText(form, now.form);
    form.hidden = !now.form;
    curve.update(shown);
    now.parameters.forEach((p, i) => rows[i].update(p));
    const own = bench.live && bench.live.of === now.name;
    setText(live, own ? `By hand: ${fromTo(bench.state.vaf.train, bench.live.vaf.train)}` : "");
    live.hidden = !own;
  };
  return { node, update };
}

function removeEffect(bench, { name, title }) {
  bench.act(
    "remove",
    { effect: name },
    (before, after) => `${isolated(title)} removed: ${fromTo(before.vaf.train, after.vaf.train)}`,
  );
}

// A slider, a box for the number and its unit, and below them what is known of it.
function parameterRow(bench, effect, first) {
  const { can } = bench.view;
  const id = `${bench.id}-${effect.name}-${first.name}`.replace(/\s+/g, "-");
  const slider = el("input", {
    type: "range",
    class: "sk-slider",
    "data-sk-key": `slider ${first.name}`,
    "aria-label": `${isolated(first.label)} of ${isolated(effect.title)}, slider`,
    "aria-describedby": `${id}-about`,
  });
  const box = el("input", {
    type: "number",
    step: "any",
    class: "sk-number",
    id,
    "data-sk-key": `box ${first.name}`,
    "aria-describedby": `${id}-about`,
  });
  const free = button("Estimate again", () => estimateAgain(bench, first), {
    class: "sk-button sk-small",
    "data-sk-key": `free ${first.name}`,
    "aria-label": `Estimate ${isolated(first.label)} again`,
  });
  const about = el("p", { class: "sk-about", id: `${id}-about` });
  const beyond = el("p", { class: "sk-warning" });
  const figureOf = el("span", { class: "sk-value" });
  const moves = can.drag && first.movable;
  const label = moves
    ? el("label", { for: id }, named(first.label))
    : el("span", {}, named(first.label));
  const controls = moves
    ? el(
        "div",
        { class: "sk-controls" },
        slider,
        box,
        el("span", { class: "sk-unit" }, unitOf(first)),
      )
    : figureOf;
  const node = el("div", { class: "sk-parameter" }, label, controls, beyond, about, free);
  let now = first;
  const editing = listen(bench, effect, slider, box, () => now);
  const update = (p) => {
    now = p;
    const moving = bench.drag.of === p.name;
    const value = moving ? bench.drag.value : p.value;
    if (!moving || focusedIn(bench.root) !== slider) sliderAt(slider, p, value);
    if (!editing()) box.value = String(rounded(value, 6));
    slider.setAttribute("aria-valuetext", withUnit(figure(value), p.unit));
    setText(figureOf, withUnit(figure(value), p.unit));
    setText(about, parameterInWords(p));
    setText(beyond, beyondInWords(p, value));
    beyond.hidden = !beyond.textContent;
    box.setAttribute("aria-invalid", String(!beyond.hidden));
    free.hidden = !(can.drag && p.fixed && !p.moved);
  };
  return { node, update };
}

function unitOf({ unit }) {
  return unit && unit !== "-" ? named(shortened(unit, 14)) : "";
}

function sliderAt(slider, p, value) {
  slider.min = p.from;
  slider.max = p.to;
  slider.step = p.step > 0 ? p.step : "any";
  slider.value = value;
}

function listen(bench, effect, slider, box, now) {
  let typing = false;
  const sent = (value) => {
    const { name, label, unit } = now();
    return { name, label, unit, of: effect.name, value };
  };
  slider.addEventListener("input", () => {
    box.value = String(rounded(slider.valueAsNumber, 6));
    bench.drag.move(sent(slider.valueAsNumber));
  });
  slider.addEventListener("change", () => bench.drag.release(sent(slider.valueAsNumber)));
  box.addEventListener("input", () => {
    typing = true;
    // Half a number may be any number: only what the slider could say is tried at once.
    const value = box.valueAsNumber;
    if (!(value >= now().from && value <= now().to)) return;
    slider.value = value;
    bench.drag.move(sent(value));
  });
  box.addEventListener("blur", () => {
    typing = false;
    bench.drag.end();
  });
  slider.addEventListener("blur", () => bench.drag.end());
  const emptied = emptiedBox(box, () => bench.renderLive());
  box.addEventListener("change", () => {
    typing = false;
    if (Number.isFinite(box.valueAsNumber)) bench.drag.release(sent(box.valueAsNumber));
    else bench.drag.cancel();
  });
  return () => typing || emptied();
}

function estimateAgain(bench, { name, label }) {
  bench.act(
    "free",
    { name },
    (before, after) =>
      `${isolated(label)} is estimated again: ${fromTo(before.vaf.train, after.vaf.train)}`,
  );
}

function boundsInWords({ low, high, unit }) {
  if (low !== null && high !== null) return `${figure(low)} to ${withUnit(figure(high), unit)}`;
  if (low !== null) return `at least ${withUnit(figure(low), unit)}`;
  return high !== null ? `at most ${withUnit(figure(high), unit)}` : "";
}

function parameterInWords(p) {
  const bounds = boundsInWords(p);
  const parts = [
    p.meaning,
    p.sd === null ? "" : `± ${withUnit(figure(p.sd, 2), p.unit)}`,
    bounds && `possible: ${bounds}`,
    p.fixed ? "kept at this number" : p.moved ? "moved by hand" : "",
  ];
  return parts.filter(Boolean).join("; ");
}

function beyondInWords(p, value) {
  const outside = (p.low !== null && value < p.low) || (p.high !== null && value > p.high);
  return outside ? `Beyond the possible, ${boundsInWords(p)}.` : "";
}
