// The plots of the run that is shown, with what is brushed as numbers and in words.

const QUIET = 700;
const REST = 150;

function plotsPart(bench) {
  const times = timePlots(bench);
  const spectrum = spectrumPlot(bench);
  const amplitude = amplitudePlot(bench);
  const lags = lagPlot(bench);
  const texts = textsOf(bench);
  const ranges = rangesOf(bench);
  const over = overBoxes(bench, amplitude, lags, texts, ranges);
  const channel = channelSelect(bench, over.swap);
  const zooms = zoomButtons(bench);
  const head = runHead(bench);
  bench.readOut = el("span", { class: "sk-readout sk-reserved", "aria-hidden": "true" });
  const filteredKey = keyOf("ink", "within the band");
  const previewKey = keyOf("preview", "");
  previewKey.classList.add("sk-reserved");
  const keptKeys = el("div", { class: "sk-legend sk-kept-keys" });
  previewKey.setAttribute("aria-live", "polite");
  const pair = pairOf(
    [
      el("h4", {}, "Spectrum"),
      el(
        "div",
        { class: "sk-legend" },
        keyOf("measured", "measured"),
        keyOf("residual", "residual"),
        saveMenu(bench, "spectrum", spectrum, () => columnsDrawn(spectrum.plot)),
      ),
      spectrum.frame,
      spectrum.keys,
      ranges.band.node,
      texts.band,
    ],
    [el("h4", {}, channel.node), ...over.nodes],
  );
  const preparation = el("p", { class: "sk-soft sk-preparation" });
  const linear = bench.view.can.linear ? linearParts(bench) : null;
  const tabs = linear ? [{ title: "Spectrum and residual", nodes: [pair] }, ...linear.tabs] : [];
  const node = el(
    "div",
    { class: "sk-plots sk-part", role: "group", "aria-labelledby": `${bench.id}-run` },
    preparation,
    head.node,
    texts.away,
    el(
      "div",
      { class: "sk-legend" },
      keyOf("measured", "measured"),
      keyOf("simulated", "simulated"),
      previewKey,
      saveMenu(bench, "output over time", times.upper, () => columnsOverTime(bench)),
    ),
    keptKeys,
    times.upper.frame,
    el(
      "div",
      { class: "sk-legend" },
      keyOf("residual", "residual"),
      filteredKey,
      bench.readOut,
      saveMenu(bench, "residual over time", times.lower, () => columnsOverTime(bench)),
    ),
    times.lower.frame,
    ...(bench.view.channels.length ? [inputsKey(bench, times.inputs), times.inputs.frame] : []),
    el("div", { class: "sk-row sk-window-row" }, ranges.time.node, zooms.node),
    texts.time,
    times.keys,
    linear ? tabsOf(bench, "What the plots show", tabs, (i) => linear.show(i > 0)) : pair,
  );
  const small = { spectrum, amplitude, lags };
  const figures = [
    times.upper,
    times.lower,
    times.inputs,
    ...Object.values(small),
    ...(linear?.figures ?? []),
  ];
  const parts = { times, ...small, figures, texts, zooms, ranges, filteredKey, previewKey, keptKeys };
  bench.redraw = drawer(bench, parts);
  bench.brush = brusher(bench, texts);
  bench.see = (range) => {
    bench.zoom = range;
    bench.redraw("time");
  };
  return {
    node,
    figures,
    linear: { update: () => linear?.update() },
    update: () => {
      head.update();
      setText(preparation, bench.state.preparation ?? "");
      preparation.hidden = !preparation.textContent;
      linear?.update();
    },
    resize: () => {
      linear?.resize();
      times.resize();
      for (const part of Object.values(small)) part.resize();
    },
  };
}

// A key whose lines can be put out one by one.
function inputsKey(bench, inputs) {
  const buttons = bench.view.channels.slice(0, LINES).map(({ name }, i) => {
    const node = el(
      "button",
      {
        type: "button",
        class: "sk-key sk-toggle",
        "aria-pressed": "true",
        "data-sk-key": `input ${i}`,
        onclick: () => {
          const on = node.getAttribute("aria-pressed") !== "true";
          node.setAttribute("aria-pressed", String(on));
          inputs.plot.setSeries(i + 1, { show: on });
        },
      },
      el("span", { class: `sk-swatch sk-is-line-${i + 1}` }),
      named(shortened(name, 24)),
    );
    return node;
  });
  const save = saveMenu(bench, "inputs over time", inputs, () => columnsOverTime(bench));
  return el("div", { class: "sk-legend" }, ...buttons, save);
}

function runHead(bench) {
  const { runs } = bench.view;
  const title = el("h3", { id: `${bench.id}-run`, class: "sk-run-title" });
  const step = (by) => {
    const kept = (run) => !bench.backend.kept || bench.backend.kept(run);
    let run = bench.run + by;
    while (run >= 0 && run < runs.length && !kept(run)) run += by;
    return run >= 0 && run < runs.length ? run : null;
  };
  const go = (by, word) => {
    const node = button(word, () => isUsable(node) && bench.show(step(by)), {
      class: "sk-button sk-small",
      "data-sk-key": `step ${by}`,
      "aria-label": `${word} run`,
    });
    return node;
  };
  const back = go(-1, "Previous");
  const on = go(1, "Next");
  const node = el(
    "div",
    { class: "sk-head" },
    title,
    runs.length > 1 ? el("div", { class: "sk-row" }, back, on) : null,
  );
  const update = () => {
    const { label, person } = runs[bench.run];
    const text = `${label}\n${person}`;
    if (title.dataset.of !== text) {
      title.dataset.of = text;
      title.replaceChildren(
        named(upperFirst(runName(label))),
        ...(person === null ? [] : [", ", named(person)]),
      );
    }
    setUsable(back, step(-1) !== null);
    setUsable(on, step(1) !== null);
  };
  return { node, update };
}

function zoomButtons(bench) {
  const small = { class: "sk-button sk-small" };
  const into = button("Zoom to window", () => isUsable(into) && bench.see([...bench.time]), small);
  const out = button("Whole run", () => isUsable(out) && bench.see(null), small);
  const update = () => {
    setUsable(into, bench.time !== null);
    setUsable(out, bench.zoom !== null);
  };
  return { node: el("div", { class: "sk-row" }, into, out), update };
}

// The residual over the values of a channel, or over the lag to one: the same place for both.
function overBoxes(bench, amplitude, lags, texts, ranges) {
  const key = (...content) => el("div", { class: "sk-legend" }, ...content);
  const save = (what, part) => saveMenu(bench, what, part, () => columnsDrawn(part.plot));
  const values = [
    key(
      keyOf("residual", "mean of the residual"),
      keyOf("rms", "rms"),
      save("residual over amplitude", amplitude),
    ),
    amplitude.frame,
    amplitude.keys,
    ranges.amplitude.node,
    texts.amplitude,
  ];
  const lag = [
    key(
      keyOf("residual", "with itself"),
      keyOf("ink", "with it"),
      save("residual over lag", lags),
    ),
    lags.frame,
    lags.keys,
    texts.lags,
  ];
  const swap = () => {
    for (const node of values) node.hidden = bench.lagTo !== null;
    for (const node of lag) node.hidden = bench.lagTo === null;
    (bench.lagTo === null ? amplitude : lags).resize();
  };
  for (const node of lag) node.hidden = true;
  return { nodes: [...values, ...lag], swap };
}

function channelSelect(bench, swap) {
  const { channels, output } = bench.view;
  const options = [
    ...[...channels, { name: output.name }].map(({ name }, i) =>
      el("option", { value: i < channels.length ? i : OUTPUT }, name),
    ),
    ...channels.map(({ name }, i) => el("option", { value: `lag ${i}` }, `lag to ${name}`)),
  ];
  const select = el(
    "select",
    {
      class: "sk-select",
      id: `${bench.id}-over`,
      onchange: () => {
        const lag = /^lag (\d+)$/.exec(select.value);
        bench.lagTo = lag ? Number(lag[1]) : null;
        if (!lag) bench.over = Number(select.value);
        bench.brush("amplitude", null);
        swap();
        bench.redraw("small");
      },
    },
    ...options,
  );
  select.value = bench.over;
  const node = el("label", { for: select.id }, "Residual over ", select);
  return { node };
}

function rangesOf(bench) {
  const range = (kind, legend, low, high, unit) =>
    rangeInputs(bench, {
      legend,
      low,
      high,
      unit,
      get: () => bench[kind],
      set: (given) => bench.brush(kind, given),
    });
  return {
    time: range("time", "Window", "Window from, seconds", "Window to, seconds", () => "s"),
    band: range("band", "Band", "Band from, rad/s", "Band to, rad/s", () => "rad/s"),
    amplitude: range(
      "amplitude",
      "Amplitudes",
      "Amplitudes from",
      "Amplitudes to",
      () => overName(bench).unit ?? "",
    ),
  };
}

function textsOf() {
  const text = (name) => el("p", { class: name });
  return {
    away: text("sk-warning"),
    time: text("sk-sentence"),
    band: text("sk-sentence"),
    amplitude: text("sk-sentence"),
    lags: text("sk-sentence"),
  };
}

// Draws in the next frame what was asked for since the last one.
function drawer(bench, parts) {
  const asked = new Set();
  let frame = null;
  let timer = null;
  const small = () => {
    timer = null;
    if (bench.gone || !bench.model) return;
    parts.spectrum.draw();
    if (bench.lagTo === null) {
      parts.amplitude.draw();
    } else {
      parts.lags.draw();
      setText(parts.texts.lags, parts.lags.inWords());
    }
  };
  const later = () => {
    if (bench.gone || !bench.model) return;
    drawRun(bench, parts);
    small();
    writeTexts(bench, parts);
  };
  const flush = () => {
    frame = null;
    if (bench.gone) return;
    if (asked.has("colours")) repaint(parts);
    if (bench.model) {
      const many = bench.record.t.length > MANY_ROWS;
      // A spectrum of a million rows takes longer than a frame: the hand goes first.
      const waits = many && ["small", "window", "brushed"].some((name) => asked.has(name));
      if (asked.has("time") || (asked.has("brushed") && !many)) {
        drawRun(bench, parts, many && asked.has("small"));
      }
      if (asked.has("window")) parts.times.place();
      writeTexts(bench, parts);
      if (waits) {
        placeSmall(parts);
        clearTimeout(timer);
        timer = setTimeout(later, REST);
      } else if (asked.has("small") || asked.has("window")) small();
      else placeSmall(parts);
    }
    asked.clear();
  };
  return (...what) => {
    what.forEach((name) => asked.add(name));
    frame ??= requestAnimationFrame(flush);
  };
}

function placeSmall({ spectrum, amplitude }) {
  for (const part of [spectrum, amplitude]) {
    part.place();
    part.tell();
  }
}

function repaint({ figures }) {
  for (const { plot } of figures) plot.redraw(false);
}

function drawRun(bench, { times, filteredKey, previewKey, keptKeys }, linesOnly = false) {
  bench.filtered = linesOnly ? null : filteredOf(bench);
  bench.rows = linesOnly ? null : amplitudeRows(bench);
  filteredKey.classList.toggle("sk-unseen", !bench.filtered);
  previewKey.classList.toggle("sk-off", !bench.preview);
  setText(previewKey.lastChild, previewInWords(bench));
  const kept = keptShown(bench).map((one, i) => one && keyOf(`kept-${i + 1}`, named(modelName(one))));
  keptKeys.replaceChildren(...kept.filter(Boolean));
  keptKeys.hidden = !keptKeys.firstChild;
  times.draw();
}

// The band of the residual that is brushed, and its share in the run and in the window.
function filteredOf(bench) {
  const { band, model, view } = bench;
  if (!band) return null;
  const transform = transformOfModel(model);
  const filtered = bandOfTransform(transform, view.dt, ...band);
  bench.filtered = {
    band: filtered,
    share: shareOf(filtered, transform.whole),
    level: meanOf(model.counted),
    inside: NaN,
  };
  shareInside(bench);
  return bench.filtered;
}

function shareInside(bench) {
  const { filtered, model } = bench;
  const x = model.counted;
  const [from, to] = rowsOf(bench);
  let part = 0;
  let whole = 0;
  for (let i = from; i < to; i++) {
    if (!Number.isFinite(x[i])) continue;
    part += filtered.band[i] * filtered.band[i];
    whole += (x[i] - filtered.level) ** 2;
  }
  filtered.inside = whole > 0 ? part / whole : NaN;
}

function writeTexts(bench, { texts, ranges, zooms, times }) {
  zooms.update();
  Object.values(ranges).forEach((range) => range.update());
  setText(texts.time, windowInWords(bench));
  setText(texts.band, bandInWords(bench) || "Brush a band to see where in time it is.");
  setText(texts.amplitude, rowsInWords(bench) || "Brush amplitudes to see where in time they are.");
  setText(texts.away, awayInWords(bench));
  texts.away.hidden = !texts.away.textContent;
  const { label } = bench.view.runs[bench.run];
  const run = upperFirst(isolated(runName(label)));
  const about = `${run}. ${texts.time.textContent} ${texts.away.textContent}`.trim();
  times.upper.describe(
    `Measured and simulated ${isolated(bench.view.output.name)} over time. ${about}`,
  );
  times.inputs.describe(`Inputs over time. ${about}`);
  times.lower.describe(`Residual over time. ${about}`);
}

function windowInWords(bench) {
  const { vaf, rmse, rows } = windowFigures(bench);
  const { time, view } = bench;
  const where = time ? `Window, ${figure(time[0])} to ${figure(time[1])} s` : "Whole run";
  if (!rows) return `${where}: no rows that count (the first ${figure(view.settling)} s settle).`;
  const off = withUnit(figure(rmse, 3), view.output.unit);
  return `${where}: VAF ${percent(vaf)}, RMSE ${off}, ${count(rows, "row")}.`;
}

function awayInWords({ model }) {
  if (model.away === null) return "";
  return (
    `The model runs away: from ${figure(model.away)} s on it is more than ${AWAY} times as far ` +
    "out as anything measured. The scale stays that of the measured output."
  );
}

function brusher(bench, texts) {
  let timer = null;
  return (kind, range) => {
    bench[kind] = range;
    // Only what depends on the brush: the lines over time stay when the window moves.
    if (kind === "time") bench.redraw("window");
    else bench.redraw("brushed");
    if (kind === "time" && bench.filtered) shareInside(bench);
    clearTimeout(timer);
    timer = setTimeout(() => !bench.gone && bench.say(texts[kind].textContent), QUIET);
  };
}
