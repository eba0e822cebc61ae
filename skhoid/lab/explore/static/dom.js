// Elements and their texts: what comes from the data is only ever text.

let mounted = 0;

function el(tag, given = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(given)) {
    if (value === null || value === undefined || value === false) continue;
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

// A name from the data: its direction must not turn the sentence around it.
function named(text) {
  return el("bdi", {}, seenName(text));
}

// A name of nothing but spaces and marks cannot be seen, or be clicked on.
function seenName(text) {
  return /^[\s\p{C}]*$/u.test(text) ? "(no name)" : text;
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function button(text, onclick, given = {}) {
  return el("button", { type: "button", class: "sk-button", ...given, onclick }, text);
}

// Focus stays on a button that cannot be used now.
function setUsable(node, usable) {
  node.setAttribute("aria-disabled", String(!usable));
}

function isUsable(node) {
  return node.getAttribute("aria-disabled") !== "true";
}

function focusedIn(root) {
  const at = root.getRootNode().activeElement;
  return at && root.contains(at) ? at : null;
}

// What is drawn again may take away or move what has the focus: its like gets it, or its place.
function keepFocus(root, draw) {
  const at = focusedIn(root);
  const key = at && at.dataset.skKey;
  const place = at && at.closest("[data-sk-place]");
  draw();
  if (!at || focusedIn(root) === at) return;
  const like =
    key && [...root.querySelectorAll("[data-sk-key]")].find((n) => n.dataset.skKey === key);
  const next = root.contains(at) && isSeen(at) ? at : like || place;
  if (next) next.focus({ preventScroll: true });
}

function isSeen(node) {
  return node.getClientRects().length > 0;
}

// Puts nodes into a parent in this order, and moves only what is out of place.
function arrange(parent, nodes) {
  const wanted = new Set(nodes);
  for (const node of [...parent.children]) if (!wanted.has(node)) node.remove();
  nodes.forEach((node, i) => {
    if (parent.children[i] !== node) parent.insertBefore(node, parent.children[i] ?? null);
  });
}

// Who empties a box is about to type: it gets its number back only some time after it was left.
function emptiedBox(box, restore) {
  let emptied = false;
  let timer = null;
  const look = () => {
    emptied = box.value === "";
  };
  box.addEventListener("input", look);
  box.addEventListener("change", look);
  box.addEventListener("focus", () => clearTimeout(timer));
  box.addEventListener("blur", () => {
    if (!emptied) return;
    timer = setTimeout(() => {
      emptied = false;
      restore();
    }, 1000);
  });
  return () => emptied && box.value === "";
}

// Two numbers that bound what is brushed, and a button that takes the brush away.
function rangeInputs(bench, { legend, low, high, unit, get, set }) {
  const change = () => {
    const given = [from.valueAsNumber, to.valueAsNumber];
    if (given.every(Number.isFinite)) set(given[0] <= given[1] ? given : given.reverse());
    else if (from.value === "" && to.value === "") set(null);
  };
  const box = (label) =>
    el("input", {
      type: "number",
      step: "any",
      class: "sk-number",
      onchange: change,
      "aria-label": label,
    });
  const sign = el("legend");
  const from = box(low);
  const to = box(high);
  const emptied = [from, to].map((input) => emptiedBox(input, () => update()));
  const clear = button("Clear", () => isUsable(clear) && set(null), {
    class: "sk-button sk-small",
    "aria-label": `Clear the ${legend.toLowerCase()}`,
  });
  const node = el("fieldset", { class: "sk-range" }, sign, from, el("span", {}, "to"), to, clear);
  let before = null;
  let typed = false;
  node.addEventListener("input", () => {
    typed = true;
  });
  const update = () => {
    const range = get();
    if (range !== before) typed = false;
    before = range;
    [from, to].forEach((input, i) => {
      const text = range ? String(rounded(range[i], 5)) : "";
      // Of a range that is not there yet one number may have been typed.
      const half = typed && !range;
      if (input.value !== text && !half && !emptied[i]()) input.value = text;
    });
    setText(sign, unit() ? `${legend}, ${isolated(shortened(unit(), 12))}` : legend);
    setUsable(clear, range !== null);
  };
  return { node, update };
}
