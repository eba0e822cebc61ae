// The workbench in one element: its parts, where they stand, and what draws them again.

const WIDE = 1100;
const NARROW = 700;
const MANY_ROWS = 200000;
const MOST_STUCK = 1 / 3; // of the window

function mount(element, view, backend) {
  const bench = newBench(view, backend);
  const parts = partsOf(bench);
  element.append(bench.root);
  followTheme(bench, element);
  bench.render = () => keepFocus(bench.root, () => parts.all.forEach((part) => part.update()));
  bench.renderLive = () => parts.live.forEach((part) => part.update());
  bench.layout = () => layOut(bench, parts);
  bench.render();
  bench.layout();
  const sizes = new ResizeObserver(() => bench.layout());
  sizes.observe(element);
  const heights = new ResizeObserver(() => stick(parts));
  heights.observe(parts.stair.node);
  window.addEventListener("resize", () => stick(parts), { signal: bench.ended.signal });
  bench.root.addEventListener("keydown", (event) => historyByKey(bench, event));
  backend.onState((state) => hear(bench, state));
  showRun(bench, bench.run);
  return {
    refresh: (state) => hear(bench, state),
    destroy: () => {
      bench.gone = true;
      bench.ended.abort();
      sizes.disconnect();
      heights.disconnect();
      for (const { plot } of parts.plots.figures) plot.destroy();
      if (backend.close) backend.close();
      bench.root.remove();
    },
  };
}

function newBench(view, backend) {
  mounted += 1;
  const bench = {
    view,
    backend,
    id: `sk-${mounted}`,
    state: view.state,
    run: view.shown,
    root: el("div", { class: "sk-bench" }),
    ended: new AbortController(),
    gone: false,
    record: null,
    model: null,
    simulated: null,
    live: null,
    preview: null,
    time: null,
    band: null,
    amplitude: null,
    zoom: null,
    filtered: null,
    rows: null,
    lines: new Array(LINES).fill(null), // ids of the models that are drawn beside
    traces: new Map(),
    over: overFirst(view),
    lagTo: null, // a channel, where the residual is shown over lag
    order: 0,
    simulatedBy: 0,
    tracedBy: 0,
    computing: 0,
    narrow: false,
    stairWidth: 400,
    colours: {},
  };
  bench.drag = dragger(bench);
  bench.act = actor(bench);
  bench.ask = (name, args, words) => ask(bench, name, args, words);
  bench.show = (run) => showRun(bench, run);
  bench.fetchSoon = fetcher(bench);
  const previews = previewer(bench);
  bench.startPreview = previews.start;
  bench.endPreview = previews.end;
  return bench;
}

// What the operator sees first: the input, or the first channel there is.
function overFirst({ channels }) {
  if (!channels.length) return OUTPUT;
  return Math.max(
    channels.findIndex(({ role }) => /input|error/.test(role ?? "")),
    0,
  );
}

function partsOf(bench) {
  const top = topPart(bench);
  const runs = runsPart(bench);
  const plots = plotsPart(bench);
  const stair = stairPart(bench);
  const model = modelPart(bench);
  const effects = effectsPart(bench);
  const inner = [effects, candidatesPart(bench)];
  const side = { node: el("div", { class: "sk-side sk-part" }, ...inner.map((part) => part.node)) };
  const models = modelsPart(bench);
  const structure = structurePart(bench);
  const people = peoplePart(bench);
  const columns = [runs, structure, models, model];
  const folded = columns.map((part) => part.node);
  const data = { node: el("div", { class: "sk-data sk-part" }, ...folded) };
  const all = [top, people, ...columns, plots, stair, ...inner];
  const live = [runs, stair, effects, plots.linear];
  return { top, people, data, folded, plots, stair, side, all, live };
}

function layOut(bench, { top, people, data, folded, plots, stair, side }) {
  const width = bench.root.clientWidth;
  if (width === 0 || bench.gone) return;
  const layout = width >= WIDE ? "wide" : width > NARROW ? "middle" : "narrow";
  if (bench.root.dataset.layout !== layout) {
    bench.root.dataset.layout = layout;
    bench.narrow = layout === "narrow";
    for (const node of folded) node.open = layout === "wide";
    const order = bench.narrow
      ? [top, stair, plots, side, data, people]
      : [top, people, data, plots, stair, side];
    keepFocus(bench.root, () =>
      arrange(
        bench.root,
        order.map((part) => part.node),
      ),
    );
  }
  bench.stairWidth = stair.node.clientWidth;
  stair.update();
  plots.resize();
  stick({ plots, stair });
  bench.redraw("time");
}

// Plots stay in sight beside a long column of cards; of higher ones the lower end. The stair stays
// above the cards, unless it would leave them too little room.
function stick({ plots, stair }) {
  const over = Math.max(plots.node.offsetHeight - window.innerHeight, 0);
  plots.node.style.top = `${-over}px`;
  stair.node.classList.toggle("sk-loose", stair.node.offsetHeight > MOST_STUCK * window.innerHeight);
}

function followTheme(bench, element) {
  const query = window.matchMedia("(prefers-color-scheme: dark)");
  const apply = () => {
    const asked = element.dataset.theme;
    const dark = asked === "dark" || (asked !== "light" && query.matches);
    bench.root.dataset.theme = dark ? "dark" : "light";
    bench.colours = coloursOf(bench.root);
    bench.redraw("colours");
  };
  query.addEventListener("change", apply, { signal: bench.ended.signal });
  const observer = new MutationObserver(apply);
  observer.observe(element, { attributes: true, attributeFilter: ["data-theme"] });
  bench.ended.signal.addEventListener("abort", () => observer.disconnect());
  apply();
}

function historyByKey(bench, event) {
  if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
  const key = event.key.toLowerCase();
  if (key !== "z" && key !== "y") return;
  if (!bench.view.can.change) return;
  event.preventDefault();
  stepHistory(bench, key === "y" || event.shiftKey ? "redo" : "undo");
}
