"use strict";
// The page around the component: files, columns, and which of the steps is shown.
(() => {
  const at = (id) => document.getElementById(id);
  const me = crypto.randomUUID();
  const SILENT =
    'The workbench does not answer: it has ended, or was killed. Start it again with "skhoid ' +
    'workbench --session" and the folder below; what you did is kept there.';
  const SVG = "http://www.w3.org/2000/svg";
  let opening = null;
  let seen = { state: -1, opening: -1 };
  let mounted = null;
  let asking = 0;

  // Asking the server.

  async function fetched(path, options = {}) {
    let reply;
    try {
      reply = await fetch(path, options);
    } catch {
      throw new Error(SILENT);
    }
    if (reply.ok) return reply;
    let told = { message: `The workbench answers with error ${reply.status}.` };
    try {
      told = await reply.json();
    } catch {
      // It has said nothing that can be read.
    }
    throw Object.assign(new Error(told.message), { field: told.field });
  }

  function post(path, args = {}) {
    const headers = { "Content-Type": "application/json", "X-Page": me };
    return fetched(`api/${path}`, { method: "POST", headers, body: JSON.stringify(args) });
  }

  async function call(name, args) {
    return skhoidBench.wire.unpack(await (await post(name, args)).arrayBuffer());
  }

  // What is wrong with a field is said beside it.
  function says(error) {
    const field = fieldOf(error);
    at("wrong").textContent = error && !field ? error.message : "";
    for (const one of settings()) {
      const hint = at(`${one.id}-hint`);
      if (!hint) continue;
      const wrong = one === field;
      hint.textContent = wrong ? error.message : hint.dataset.hint;
      one.setAttribute("aria-invalid", String(wrong));
    }
  }

  const settings = () => [...at("choices").querySelectorAll(".settings [name]")];

  function fieldOf(error) {
    const field = error?.field ? at(error.field) : null;
    return field?.checkVisibility() ? field : null;
  }

  // Does something the user asked for; buttons rest meanwhile.
  async function tried(work) {
    trial += 1;
    says(null);
    asking += 1;
    rest();
    try {
      await work();
    } catch (error) {
      says(error);
    } finally {
      asking -= 1;
      rest();
    }
  }

  function rest() {
    const busy = asking > 0 || Boolean(opening?.doing);
    for (const id of ["fit", "fit-search", "check"]) at(id).disabled = busy;
    at("chooser").disabled = asking > 0;
  }

  // What is shown.

  async function refresh() {
    show(await (await fetched("api/opening")).json());
  }

  function show(found) {
    if (opening && found.count < opening.count) return; // a reply that was overtaken
    const before = opening;
    opening = found;
    const stage = { empty: "files", reading: "files", columns: "columns" }[found.phase] ?? "bench";
    for (const item of document.querySelectorAll("#stages li")) {
      if (item.dataset.stage === stage) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
    }
    at("doing").textContent = found.doing;
    list(at("notes"), found.notes.map((note) => text("li", note)));
    at("session").textContent = found.session;
    at("files").hidden = stage === "bench";
    at("columns").hidden = stage !== "columns";
    at("bench").hidden = at("tools").hidden = found.phase !== "bench";
    at("chooser-help").hidden = stage !== "files";
    at("opened").textContent = found.files.length
      ? `Open: ${found.files.map((file) => file.name).join(", ")}`
      : "No file is open yet.";
    if (stage === "columns") showColumns(found, before);
    if (found.message) {
      const error = Object.assign(new Error(found.message), { field: found.field });
      says(error);
      if (found.message !== before?.message) fieldOf(error)?.focus();
    }
    if (found.phase === "bench") mount();
    else unmount();
    rest();
  }

  function list(element, items) {
    element.replaceChildren(...items);
    element.hidden = items.length === 0;
  }

  function text(tag, words, className) {
    const element = document.createElement(tag);
    element.textContent = words;
    if (className) element.className = className;
    return element;
  }

  function showColumns(found, before) {
    at("guess").textContent = found.guess;
    at("recorded").textContent = found.recorded;
    showSteps(found);
    at("problems").hidden = found.problems.length === 0;
    at("problems").querySelector("ul").replaceChildren(...found.problems.map(problem));
    at("findings").hidden = !found.checked;
    const findings = found.findings.map(finding);
    if (findings.length === 0) findings.push(text("li", "Nothing is wrong."));
    at("findings").querySelector("ul").replaceChildren(...findings);
    const same = before && before.phase === "columns";
    const drawn = JSON.stringify([found.columns, found.model]);
    if (same && drawn === JSON.stringify([before.columns, before.model])) return;
    const body = at("choices").querySelector("tbody");
    body.replaceChildren(...found.columns.map((column, n) => row(column, n, found.kinds)));
    for (const one of settings()) {
      if (one.type === "checkbox") one.checked = found.model[one.name];
      else one.value = found.model[one.name] ?? "";
    }
    showOfCore();
  }

  function showSteps({ steps, note }) {
    at("steps").textContent = steps || "nothing yet, see above";
    at("cost").textContent = note;
  }

  function showOfCore() {
    for (const one of at("choices").querySelectorAll("[data-core]"))
      one.hidden = one.dataset.core !== at("core").value;
  }

  function finding(one) {
    const item = text("li", "");
    item.append(text("strong", one.title), `${one.evidence} ${one.meaning} ${one.next_step}`);
    return item;
  }

  function problem(one) {
    const item = text("li", `${one.text} `);
    for (const offer of one.offers) {
      const kind = opening.kinds.find((known) => known.kind === offer.kind);
      const words = offer.unit ? `unit ${offer.unit}` : (kind?.words ?? offer.kind);
      const button = text("button", `"${offer.column}" is: ${words}`);
      button.type = "button";
      button.addEventListener("click", () => choose(offer));
      item.append(button, " ");
    }
    if (one.dt) item.append("Or give the sampling time, below.");
    return item;
  }

  // Takes what is offered; another column that was the same is so no longer.
  function choose({ column, kind, unit }) {
    const rows = [...at("choices").querySelectorAll("tbody tr")];
    for (const one of rows) {
      const select = one.querySelector("select");
      if (one.dataset.column === column) {
        select.value = kind;
        if (unit) one.querySelector("input").value = unit;
      } else if (select.value === kind && !["", "dist", "motion", "other"].includes(kind)) {
        select.value = "";
      }
    }
    check();
  }

  function row(column, n, kinds) {
    const tr = document.createElement("tr");
    tr.dataset.column = column.name;
    const name = text("th", column.name);
    name.scope = "row";
    name.id = `column-${n}`;
    if (column.note) name.append(text("p", column.note, "note"));
    const select = document.createElement("select");
    for (const { kind, words } of kinds) select.append(new Option(words, kind));
    select.value = column.kind;
    select.setAttribute("aria-label", `What ${column.name} is`);
    const unit = document.createElement("input");
    unit.type = "text";
    unit.maxLength = 40;
    unit.value = column.unit;
    unit.setAttribute("aria-label", `Unit of ${column.name}`);
    const first = cell(picture(column), text("div", column.first, "values"));
    tr.append(name, cell(select), cell(unit), first);
    return tr;
  }

  function cell(...inside) {
    const td = document.createElement("td");
    td.append(...inside.filter(Boolean));
    return td;
  }

  function picture({ points, name }) {
    if (points.length < 2) return null;
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", `0 0 ${points.length - 1} 20`);
    svg.setAttribute("preserveAspectRatio", "none");
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", `First rows of ${name}`);
    let line = [];
    const end = () => {
      if (line.length > 1) {
        const drawn = document.createElementNS(SVG, "polyline");
        drawn.setAttribute("points", line.join(" "));
        drawn.setAttribute("vector-effect", "non-scaling-stroke");
        svg.append(drawn);
      }
      line = [];
    };
    points.forEach((level, i) => {
      if (level === null) end();
      else line.push(`${i},${(19 - 18 * level).toFixed(2)}`);
    });
    end();
    return svg;
  }

  // What the user chose.

  function chosen() {
    const kinds = {};
    const units = {};
    for (const one of at("choices").querySelectorAll("tbody tr")) {
      kinds[one.dataset.column] = one.querySelector("select").value;
      units[one.dataset.column] = one.querySelector("input").value.trim();
    }
    return { kinds, units, ...chosenSettings() };
  }

  function chosenSettings() {
    const read = (one) => (one.type === "checkbox" ? one.checked : one.value.trim());
    return Object.fromEntries(settings().map((one) => [one.name, read(one)]));
  }

  // What a setting leads to is said at once; nothing waits for it, and the newest counts.
  let trial = 0;
  async function tryOut() {
    showOfCore();
    trial += 1;
    const mine = trial;
    let error = null;
    try {
      const told = await (await post("prepare", chosenSettings())).json();
      if (mine === trial) showSteps(told);
      error = told.message ? told : null;
    } catch (found) {
      error = found;
    }
    if (mine === trial) says(error);
  }

  const check = () => tried(async () => show(await (await post("columns", chosen())).json()));

  function fit(event) {
    event.preventDefault();
    const search = Boolean(event.submitter?.value);
    tried(async () => show(await (await post("fit", { ...chosen(), search })).json()));
  }

  function chosenFiles(event) {
    const picked = [...event.target.files];
    event.target.value = "";
    upload(picked);
  }

  // Files may be dropped anywhere on the page.
  function dragged(event) {
    if (![...event.dataTransfer.types].includes("Files")) return;
    event.preventDefault();
    const out = event.type === "dragleave" && event.relatedTarget !== null;
    if (out) return;
    document.body.classList.toggle("dropping", event.type === "dragover");
    if (event.type === "drop") upload([...event.dataTransfer.files]);
  }

  async function upload(picked) {
    if (picked.length === 0) return;
    const words = "Other files begin anew: what this session holds of its old files is given up.";
    if (opening?.kept && !(await sure(words))) return;
    await tried(async () => {
      const ids = [];
      for (const [n, file] of picked.entries()) {
        at("doing").textContent = `Copying ${file.name} (${n + 1} of ${picked.length}) ...`;
        const path = `api/upload?name=${encodeURIComponent(file.name)}`;
        const reply = await fetched(path, { method: "POST", body: file });
        ids.push((await reply.json()).id);
      }
      show(await (await post("open", { files: ids })).json());
    });
    if (opening) at("doing").textContent = opening.doing;
  }

  // Asks before something is given up.
  function sure(words) {
    const dialog = at("sure");
    at("sure-text").textContent = words;
    dialog.returnValue = "";
    dialog.showModal();
    return new Promise((resolve) => {
      dialog.addEventListener("close", () => resolve(dialog.returnValue === "yes"), { once: true });
    });
  }

  async function back() {
    const words =
      "Back at the columns, the effects that were added and their history are given up. Reports " +
      "that were saved stay.";
    if (await sure(words)) await tried(async () => show(await (await post("back")).json()));
  }

  // The component.

  const listeners = [];
  let state = null;
  const backend = {
    call: async (name, args) => {
      const reply = await call(name, args);
      if (reply.state) state = reply.state;
      return reply;
    },
    onState: (listener) => listeners.push(listener),
  };

  function mount() {
    if (mounted) return;
    mounted = "soon";
    call("view", {}).then(
      ({ view }) => {
        if (mounted !== "soon") return;
        state = view.state;
        mounted = skhoidBench.mount(at("component"), view, backend);
        // The button that was pressed is gone: go on here, not at the top of the page.
        if (document.activeElement === document.body) at("component").focus();
      },
      (error) => {
        mounted = null;
        says(error);
      },
    );
  }

  function unmount() {
    if (mounted && mounted !== "soon") mounted.destroy();
    mounted = null;
    listeners.length = 0;
    at("component").replaceChildren();
  }

  function tell(found) {
    state = found;
    for (const listener of listeners) listener(found);
  }

  // News from the server: of other tabs, of a search, of a ceiling that was found.

  let fetching = false;
  let again = false;
  async function follow() {
    if (fetching) {
      again = true;
      return;
    }
    fetching = true;
    try {
      do {
        again = false;
        const reply = await call("state", { run: 0 });
        if (mounted && mounted !== "soon") tell(reply.state);
      } while (again);
    } catch (error) {
      if (opening?.phase === "bench") says(error);
    } finally {
      fetching = false;
    }
  }

  function listen() {
    const events = new EventSource("api/events");
    events.addEventListener("open", () => {
      if (at("wrong").textContent === SILENT) says(null);
    });
    events.addEventListener("error", () => says(new Error(SILENT)));
    events.addEventListener("message", (event) => hear(JSON.parse(event.data)).catch(says));
  }

  async function hear(news) {
    const before = seen;
    seen = { state: news.state, opening: news.opening };
    if (news.opening !== before.opening) await refresh(); // first: it may end the component
    if (!mounted || mounted === "soon" || before.state < 0) return;
    if (news.state !== before.state) {
      if (news.by !== me) follow();
    } else if (news.search && state) {
      tell({ ...state, search: news.search });
    }
  }

  at("chooser").addEventListener("change", chosenFiles);
  for (const kind of ["dragover", "dragleave", "drop"]) document.addEventListener(kind, dragged);
  at("choices").addEventListener("submit", fit);
  at("choices").addEventListener("change", (event) => {
    if (event.target.closest(".settings")) tryOut();
  });
  at("check").addEventListener("click", check);
  at("back").addEventListener("click", back);
  at("sure-yes").addEventListener("click", () => at("sure").close("yes"));
  at("sure-no").addEventListener("click", () => at("sure").close(""));
  listen();
})();
