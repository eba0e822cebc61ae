// Effects that could be added, as the search ranks them: hover or focus shows what each would do.

const WAIT = 150;
const GROUPS = [
  ["named", "Named by the search", ["found"]],
  ["gains", "Gain too, but are not named", ["helps"]],
  ["untried", "Not tried yet", ["untried"]],
  ["no", "Tried, and not named", ["no"]],
  ["refused", "Do not apply here", ["refused"]],
];

function candidatesPart(bench) {
  const title = el("h3", { id: `${bench.id}-candidates`, tabindex: "-1" }, "Effects to try");
  const of = el("p", { class: "sk-soft" });
  const search = searchRow(bench);
  const groups = GROUPS.map(([key, words, statuses]) =>
    candidateGroup(bench, key, words, statuses),
  );
  const limits = limitsPart();
  const node = el(
    "div",
    {
      class: "sk-candidates sk-part",
      role: "group",
      "aria-labelledby": title.id,
      "data-sk-place": "",
      tabindex: "-1",
    },
    title,
    of,
    search.node,
    ...groups.map((group) => group.node),
    limits.node,
    csvButton(bench, "effects to try", () => columnsOfCards(bench.state)),
  );
  let before = "";
  const update = () => {
    const { cards, cards_of } = bench.state;
    setText(of, cards_of);
    node.hidden = cards.length === 0 && !bench.view.can.search && !bench.state.search;
    search.update();
    const most = Math.max(...cards.map((card) => card.gain ?? 0), 1e-9);
    for (const group of groups) group.update(cards, most);
    // What is open stays as the user left it, until the kinds of cards change.
    const kinds = groups.map((group) => group.size > 0).join();
    if (kinds !== before) openFirst(groups);
    before = kinds;
    limits.update(bench.state.limits);
  };
  return { node, update };
}

function columnsOfCards({ cards }) {
  return columnsByKey(cards, {
    effect: "title",
    outcome: "status",
    "gain, points": "gain",
    "evidence, nats": "evidence",
    probability: "probability",
    "allowed (95 %)": "limit",
    parameters: "parameters",
    reason: "reason",
  });
}

// What brings nothing stays folded.
function openFirst(groups) {
  const first = groups.slice(0, 3).find((group) => group.size > 0);
  for (const group of groups) group.node.open = group === first;
}

// How large effects may be that were not named.
function limitsPart() {
  const summary = el("summary", { "data-sk-key": "limits" }, "What these runs allow");
  const table = el("table");
  const node = el("details", { class: "sk-group" }, summary, table);
  const update = ([headings, ...rows]) => {
    node.hidden = rows.length === 0;
    const row = (cells, tag, given) =>
      el("tr", {}, ...cells.map((cell, i) => el(i ? tag : "th", i ? given : { scope: "row" }, named(cell))));
    table.replaceChildren(
      ...(rows.length
        ? [
            el("thead", {}, row(headings, "th", { scope: "col" })),
            el("tbody", {}, ...rows.map((cells) => row(cells, "td", {}))),
          ]
        : []),
    );
  };
  return { node, update };
}

function candidateGroup(bench, key, words, statuses) {
  const summary = el("summary", { "data-sk-key": `group ${key}` });
  const list = el("div", { class: "sk-cards" });
  const node = el("details", { class: "sk-group" }, summary, list);
  const known = new Map();
  const group = { node, size: 0 };
  group.update = (cards, most) => {
    const own = cards.filter((card) => statuses.includes(card.status));
    group.size = own.length;
    node.hidden = own.length === 0;
    setText(summary, `${words} (${own.length})`);
    for (const card of own) if (!known.has(card.id)) known.set(card.id, candidateCard(bench, card));
    arrange(
      list,
      own.map((card) => known.get(card.id).node),
    );
    own.forEach((card) => known.get(card.id).update(card, most));
  };
  return group;
}

function candidateCard(bench, card) {
  const gain = el("span", { class: "sk-gain" });
  const bar = el("span", { class: "sk-gain-bar", "aria-hidden": "true" });
  const about = el("p");
  const form = el("p", { class: "sk-form" });
  const reason = el("p", { class: "sk-soft" });
  const add = button("Add", () => isUsable(add) && addEffect(bench, card), {
    class: "sk-button sk-primary",
    "data-sk-key": `card ${card.id}`,
    "aria-label": `Add ${isolated(card.title)}`,
  });
  const node = el(
    "div",
    { class: "sk-card sk-candidate", role: "group", "aria-label": card.title },
    el("div", { class: "sk-head" }, el("h4", {}, named(card.title)), add),
    gain,
    bar,
    about,
    form,
    reason,
  );
  previewOn(bench, node, add, card);
  const update = (now, most) => {
    const usable = bench.view.can.change && (now.ready || bench.view.can.any);
    add.hidden = !usable || now.status === "refused";
    setText(gain, figuresInWords(now));
    bar.hidden = !(now.gain > 0);
    bar.style.width = `${(100 * Math.max(now.gain ?? 0, 0)) / most}%`;
    setText(about, now.words);
    setText(form, now.form);
    form.hidden = !now.form;
    setText(reason, reasonInWords(now));
    reason.hidden = !reason.textContent;
    node.dataset.preview = String(!add.hidden);
  };
  return { node, update };
}

function figuresInWords({ gain, probability }) {
  if (gain === null) return "";
  const chance = probability >= 0.005 ? `, ${Math.round(100 * probability)} % probable` : "";
  return `${points(gain)} points${chance}`;
}

function reasonInWords({ reason, parameters, evidence, limit }) {
  const parts = [
    parameters && `${parameters}.`,
    evidence !== null && `Evidence ${Math.round(evidence).toString().replace("-", "−")} nats.`,
    reason,
    limit && `If it is there, ${limit}.`,
  ];
  return parts.filter(Boolean).join(" ");
}

// All that the verdict names, as one step.
function addNamed(bench) {
  const added = bench.state.to_add;
  const words = added.length === 1 ? "It is added" : "They are added";
  bench.act(
    "add",
    { effect: added },
    (before, after) => `${words}: ${fromTo(before.vaf.train, after.vaf.train)}`,
  );
}

function addEffect(bench, { id, title }) {
  bench.endPreview();
  bench.act(
    "add",
    { effect: id },
    (before, after) => `${isolated(title)} added: ${fromTo(before.vaf.train, after.vaf.train)}`,
  );
}

function previewOn(bench, node, add, { id, title }) {
  let timer = null;
  const start = () => {
    if (node.dataset.preview !== "true") return;
    clearTimeout(timer);
    timer = setTimeout(() => bench.startPreview(id, title), WAIT);
  };
  const end = () => {
    clearTimeout(timer);
    bench.endPreview(id);
  };
  node.addEventListener("pointerenter", start);
  node.addEventListener("pointerleave", end);
  add.addEventListener("focus", start);
  add.addEventListener("blur", end);
}

function searchRow(bench) {
  const { can } = bench.view;
  const go = button(
    "Search for effects",
    () => isUsable(go) && bench.act("search", {}, () => "The search has started."),
    {
      class: "sk-button sk-primary",
      "data-sk-key": "search",
    },
  );
  const stop = button("Stop", () => bench.act("stop", {}, () => "The search is asked to stop."), {
    "data-sk-key": "stop",
    "aria-label": "Stop the search",
  });
  const bar = el("progress", { max: "1", "aria-label": "Progress of the search" });
  const words = el("span", { class: "sk-soft" });
  const running = el("div", { class: "sk-row sk-running" }, bar, words, stop);
  const node = el("div", {}, can.search ? go : null, running);
  let ran = null; // the search that was running when this was last drawn
  const update = () => {
    const { search } = bench.state;
    if (ran && !search) bench.say("The search has ended.");
    ran = search;
    go.hidden = Boolean(search);
    running.hidden = !search;
    if (!search) return;
    bar.value = search.share;
    setText(words, search.words);
    stop.hidden = !can.search;
  };
  return { node, update };
}
