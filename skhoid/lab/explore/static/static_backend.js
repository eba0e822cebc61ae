// A page on its own: every subset of the effects found was computed when it was written.

function staticBackend(payload) {
  const { states, traces } = payload;
  let added = payload.start ? payload.start.split(",") : [];
  let revision = payload.view.state.revision;
  const past = [];
  const future = [];
  const titles = titlesIn(states);

  const keyOf = (names) => [...names].sort().join(",");
  const title = (name) => titles.get(name) ?? name;
  const stateNow = () => ({
    ...states[keyOf(added)],
    cards: states[keyOf(added)].cards.map((card) => ({
      ...card,
      ready: Object.hasOwn(states, keyOf([...added, card.id])),
    })),
    revision,
    undo: past.length ? past[past.length - 1].words : null,
    redo: future.length ? future[future.length - 1].words : null,
  });
  const simulated = (run, names = added) => traces[run].simulated[keyOf(names)];
  const reply = (run) => {
    revision += 1;
    return { state: stateNow(), simulated: simulated(run) };
  };
  const change = (names, words, run) => {
    if (!Object.hasOwn(states, keyOf(names))) {
      throw new Error("This page does not hold that model. Open the workbench to compute it.");
    }
    past.push({ names: added, words });
    future.length = 0;
    added = names;
    return reply(run);
  };
  const step = (from, to, run) => {
    const last = from.pop();
    if (!last) throw new Error("There is nothing more to undo or redo.");
    to.push({ names: added, words: last.words });
    added = last.names;
    return reply(run);
  };
  const actions = {
    state: ({ run }) => ({ state: stateNow(), simulated: simulated(run) }),
    trace: ({ run }) => traceOf(traces[run], simulated(run)),
    add: ({ effect, run }) => change([...added, effect], `Add ${title(effect)}`, run),
    remove: ({ effect, run }) =>
      change(
        added.filter((name) => name !== effect),
        `Remove ${title(effect)}`,
        run,
      ),
    preview: ({ effect, run }) => {
      const names = [...added, effect];
      return { simulated: simulated(run, names), vaf: states[keyOf(names)].vaf.train };
    },
    linear: () => states[keyOf(added)].linear,
    undo: ({ run }) => step(past, future, run),
    redo: ({ run }) => step(future, past, run),
  };
  return {
    kept: (run) => Boolean(traces[run] && traces[run].measured),
    onState() {},
    async call(name, args) {
      if (!Object.hasOwn(actions, name)) {
        throw new Error(`This page cannot do that: "${name}" needs the workbench.`);
      }
      return actions[name](args);
    },
  };
}

function titlesIn(states) {
  const titles = new Map();
  for (const state of Object.values(states)) {
    for (const effect of state.effects) titles.set(effect.name, effect.title);
  }
  return titles;
}

function traceOf(kept, simulated) {
  const n = kept.measured.length;
  const t = new Float64Array(n);
  for (let i = 0; i < n; i++) t[i] = kept.t0 + i * kept.dt;
  return {
    t,
    measured: kept.measured,
    scored: kept.scored,
    channels: kept.channels ?? {},
    simulated,
  };
}
