// What the user does, sent to the backend; and replies, of which an old one never undoes a new one.

const PAUSE = 400;

// Steps of history may be asked for faster than they are taken; all else is asked for once.
const STEPS = ["undo", "redo"];

// One action after the other: each answers to the state that the one before it left.
function actor(bench) {
  let line = Promise.resolve();
  const pending = new Map();
  return (name, args, said) => {
    if (name !== "release") bench.drag.flush();
    const key = JSON.stringify([name, args]);
    if (pending.has(key) && !STEPS.includes(name)) return pending.get(key);
    const done = line.then(() => carryOut(bench, name, args, said));
    pending.set(key, done);
    line = done.finally(() => pending.delete(key));
    return line;
  };
}

async function carryOut(bench, name, args, said) {
  await bench.drag.settled();
  const before = bench.state;
  if (STEPS.includes(name) && before[name] === null) return;
  const reply = await bench.ask(name, args, "Computing …");
  if (!reply) return;
  if (said) bench.say(said(before, bench.state));
}

// Asks, takes what comes, and shows an error instead where there is one.
async function ask(bench, name, args, words) {
  const run = bench.run;
  bench.order += 1;
  const order = bench.order;
  const ready = bench.busy(words);
  try {
    const reply = await bench.backend.call(name, { ...args, run });
    ready();
    if (bench.gone) return null;
    take(bench, reply, run, order);
    return reply;
  } catch (error) {
    ready();
    if (!bench.gone) fail(bench, error);
    return null;
  }
}

function take(bench, reply, run, order) {
  if (reply.state) {
    if (reply.state.revision < bench.state.revision) return;
    if (reply.state.revision > bench.state.revision) bench.alert(null);
    bench.state = reply.state;
    bench.live = null;
    bench.drag.forget();
    bench.render();
  }
  if (!reply.simulated) return;
  if (run !== bench.run) {
    if (reply.state) showRun(bench, bench.run);
    return;
  }
  if (order < bench.simulatedBy) return;
  bench.simulatedBy = order;
  bench.simulated = reply.simulated;
  simulate(bench, reply.simulated);
}

function simulate(bench, simulated) {
  if (!bench.record || bench.record.run !== bench.run) return;
  bench.model = modelOf(bench.record, simulated);
  bench.redraw("time", "small");
}

// Back to what was last good.
function fail(bench, error) {
  bench.live = null;
  bench.drag.forget();
  bench.alert(error && error.message ? error.message : String(error));
  bench.render();
  if (bench.simulated) simulate(bench, bench.simulated);
}

async function showRun(bench, run) {
  const other = run !== bench.run;
  if (other && bench.live) bench.drag.cancel();
  bench.run = run;
  if (other) {
    bench.simulated = null;
    bench.endPreview();
    for (const id of bench.lines) if (id !== null) traceModel(bench, id);
  }
  bench.render();
  bench.order += 1;
  const order = bench.order;
  try {
    const trace = await bench.backend.call("trace", { run });
    if (bench.gone || run !== bench.run || order < bench.tracedBy) return;
    bench.tracedBy = order;
    if (order >= bench.simulatedBy || !bench.simulated) {
      bench.simulatedBy = order;
      bench.simulated = trace.simulated;
    }
    if (!bench.record || bench.record.run !== run) {
      const first = !bench.record;
      bench.record = recordOf(trace, run);
      if (first && bench.view.opens_on) bench.zoom = beginningOf(bench);
      bench.time = withinRun(bench, bench.time);
      bench.zoom = withinRun(bench, bench.zoom);
    }
    simulate(bench, bench.simulated);
    if (other) bench.say(`${upperFirst(isolated(runName(bench.view.runs[run].label)))} is shown.`);
  } catch (error) {
    if (!bench.gone) fail(bench, error);
  }
}

// The first seconds that count.
function beginningOf({ record, view }) {
  const start = record.t[record.first];
  return start + view.opens_on < record.until ? [start, start + view.opens_on] : null;
}

// Window and zoom stay from run to run, as far as the run has these seconds.
function withinRun({ record }, range) {
  if (!range) return null;
  const [low, high] = range.map((t) => clamp(t, [record.since, record.until]));
  return high > low ? [low, high] : null;
}

// Only the newest value waits while one is on its way.
function dragger(bench) {
  let waiting = null;
  let flying = null;
  let timer = null;
  let held = false;
  let released = false;
  let last = null;
  const self = { of: null, value: null };
  bench.root.addEventListener("pointerdown", () => (held = true));
  for (const name of ["pointerup", "pointercancel"]) {
    window.addEventListener(name, () => self.end((held = false)), { signal: bench.ended.signal });
  }
  const fly = async () => {
    while (waiting && !bench.gone) {
      const now = waiting;
      waiting = null;
      await dragOnce(bench, now);
    }
    flying = null;
  };
  const release = (given) => {
    clearTimeout(timer);
    timer = null;
    waiting = null;
    released = true;
    const { name, label, unit, value } = given;
    bench.act(
      "release",
      { name, value },
      (before, after) =>
        `${isolated(label)} = ${withUnit(figure(value), unit)}: ` +
        fromTo(before.vaf.train, after.vaf.train),
    );
  };
  self.move = (given) => {
    clearTimeout(timer);
    timer = null;
    released = false;
    self.of = given.name;
    self.value = given.value;
    waiting = given;
    flying ??= fly();
  };
  // Keys change and release at once with each press: one step of history for all of them.
  self.release = (given) => {
    clearTimeout(timer);
    last = given;
    if (held) release(given);
    else timer = setTimeout(() => release(given), PAUSE);
  };
  self.flush = () => {
    if (timer !== null) release(last);
  };
  // Let go where it was taken up, a slider does not say that it was let go.
  self.end = () => {
    setTimeout(() => {
      if (self.of !== null && !held && !released && timer === null) self.cancel();
    }, 60);
  };
  self.settled = () => flying ?? Promise.resolve();
  self.active = () => self.of !== null || flying !== null || timer !== null;
  self.forget = () => {
    if (waiting || timer) return;
    self.of = self.value = null;
  };
  self.cancel = () => {
    waiting = null;
    self.forget();
    bench.live = null;
    bench.render();
    if (bench.simulated) simulate(bench, bench.simulated);
  };
  return self;
}

async function dragOnce(bench, { name, value, of }) {
  const run = bench.run;
  bench.order += 1;
  const order = bench.order;
  try {
    const reply = await bench.backend.call("drag", { name, value, run });
    if (bench.gone || order < bench.simulatedBy || bench.drag.of === null) return;
    bench.live = { ...reply, of };
    delete bench.live.simulated;
    bench.renderLive();
    if (run !== bench.run) return;
    bench.simulatedBy = order;
    simulate(bench, reply.simulated);
  } catch (error) {
    if (!bench.gone) fail(bench, error);
  }
}

// A state that nobody here asked for: another tab, a search that ended, a ceiling that arrived.
function hear(bench, state) {
  if (bench.gone || !state) return;
  if (state.revision < bench.state.revision) return;
  if (bench.drag.active()) {
    bench.fetchSoon();
    return;
  }
  const changed = state.revision !== bench.state.revision;
  bench.state = state;
  bench.live = null;
  bench.render();
  if (changed) showRun(bench, bench.run);
}

function fetcher(bench) {
  let timer = null;
  const go = async () => {
    timer = null;
    if (bench.gone) return;
    if (bench.drag.active() || bench.computing > 0) soon();
    else await bench.ask("state", {}, null);
  };
  const soon = () => {
    timer ??= setTimeout(go, 120);
  };
  return soon;
}

// One preview at a time; what was left is not drawn.
function previewer(bench) {
  const known = new Map();
  let wanted = null;
  return {
    async start(id, title) {
      wanted = id;
      const { revision } = bench.state;
      const run = bench.run;
      const key = `${revision} ${run} ${id}`;
      try {
        const reply = known.get(key) ?? (await bench.backend.call("preview", { effect: id, run }));
        if (known.size > 20) known.clear();
        known.set(key, reply);
        if (bench.gone || wanted !== id || run !== bench.run) return;
        if (revision !== bench.state.revision) return;
        bench.preview = { ...reply, title };
        bench.redraw("time");
      } catch (error) {
        if (!bench.gone && wanted === id) fail(bench, error);
      }
    },
    end(id) {
      if (id !== undefined && wanted !== id) return;
      wanted = null;
      if (!bench.preview) return;
      bench.preview = null;
      bench.redraw("time");
    },
  };
}

function previewInWords({ preview, state }) {
  if (!preview) return "";
  return `${fromTo(state.vaf.train, preview.vaf)} with ${isolated(preview.title)}`;
}
