// Tabs: one panel is seen, and all have their room, so that nothing below moves.

function tabsOf(bench, label, tabs, onShow) {
  const buttons = tabs.map(({ title }, i) =>
    button(title, () => show(i), {
      class: "sk-tab",
      role: "tab",
      id: `${bench.id}-tab-${i}`,
      "aria-controls": `${bench.id}-panel-${i}`,
      "data-sk-key": `tab ${title}`,
    }),
  );
  const panels = tabs.map(({ nodes }, i) =>
    el(
      "div",
      {
        class: "sk-panel",
        role: "tabpanel",
        id: `${bench.id}-panel-${i}`,
        "aria-labelledby": `${bench.id}-tab-${i}`,
      },
      ...nodes,
    ),
  );
  const show = (shown) => {
    buttons.forEach((one, i) => {
      one.setAttribute("aria-selected", String(i === shown));
      one.tabIndex = i === shown ? 0 : -1;
      panels[i].classList.toggle("sk-away", i !== shown);
    });
    onShow(shown);
  };
  const list = el("div", { class: "sk-tabs", role: "tablist", "aria-label": label }, ...buttons);
  list.addEventListener("keydown", (event) => {
    const at = buttons.indexOf(event.target);
    const n = buttons.length;
    const to = { ArrowLeft: at - 1, ArrowRight: at + 1, Home: 0, End: n - 1 }[event.key];
    if (to === undefined || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    const next = (to + n) % n;
    show(next);
    buttons[next].focus();
  });
  show(0);
  return el("div", {}, list, el("div", { class: "sk-panels" }, ...panels));
}
