// A range of a plot's abscissa, by pointer and by keys.

const NEAR = 7;

// brush: { get, set, limits: () => [low, high], log }. Returns what puts the shade in its place.
function brushOn(bench, { frame, plot }, brush) {
  const shade = el("div", { class: "sk-window" });
  shade.hidden = true;
  plot.over.append(shade);
  const wide = () => plot.bbox.width / uPlot.pxRatio;
  const place = () => {
    const range = brush.get();
    shade.hidden = !range;
    if (!range) return;
    const [left, right] = range.map((x) => clamp(plot.valToPos(x, "x"), [-2, wide() + 2]));
    shade.style.transform = `translateX(${left}px)`;
    shade.style.width = `${Math.max(right - left, 1)}px`;
  };
  const set = (range) => {
    brush.set(range);
    place();
  };
  // Scales are committed later than data are given: the shade follows when all is drawn.
  plot.hooks.draw = [...(plot.hooks.draw ?? []), place];
  brushByPointer(plot, brush, set, wide);
  frame.addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === "Escape" && brush.get()) set(null);
    else {
      const range = rangeByKey(brush, event.key, event.shiftKey, [
        plot.scales.x.min,
        plot.scales.x.max,
      ]);
      if (!range) return;
      set(range);
    }
    event.preventDefault();
    event.stopPropagation();
  });
  return place;
}

function clamp(value, [low, high]) {
  return Math.min(Math.max(value, low), high);
}

function brushByPointer(plot, brush, set, wide) {
  const { over } = plot;
  let held = null;
  const pixelOf = (event) => clamp(event.clientX - held.left, [0, wide()]);
  const valueAt = (pixel) => clamp(plot.posToVal(pixel, "x"), brush.limits());
  over.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    // Keys go on with what the pointer has begun.
    over.closest(".sk-plot").focus({ preventScroll: true });
    held = { left: over.getBoundingClientRect().left, before: brush.get(), moved: false };
    held.start = pixelOf(event);
    held.grip = gripOf(plot, held.before, held.start);
    over.setPointerCapture(event.pointerId);
  });
  over.addEventListener("pointermove", (event) => {
    if (!held) return;
    const at = pixelOf(event);
    if (!held.moved && Math.abs(at - held.start) < 3) return;
    held.moved = true;
    set(draggedRange(plot, held, at, valueAt));
  });
  const end = () => {
    held = null;
  };
  over.addEventListener("pointerup", end);
  over.addEventListener("pointercancel", end);
  over.addEventListener("dblclick", () => set(null));
}

// What a press takes hold of: an edge, the whole range, or nothing yet.
function gripOf(plot, range, at) {
  if (!range) return "new";
  const [left, right] = range.map((x) => plot.valToPos(x, "x"));
  if (Math.abs(at - left) < NEAR) return "low";
  if (Math.abs(at - right) < NEAR) return "high";
  return at > left && at < right ? "all" : "new";
}

function draggedRange(plot, { grip, start, before }, at, valueAt) {
  if (grip === "all") {
    const [left, right] = before.map((x) => plot.valToPos(x, "x"));
    const most = plot.bbox.width / uPlot.pxRatio;
    const shift = clamp(at - start, [Math.min(-left, 0), Math.max(most - right, 0)]);
    return [valueAt(left + shift), valueAt(right + shift)];
  }
  const fixed = { low: () => before[1], high: () => before[0], new: () => valueAt(start) }[grip]();
  const other = valueAt(at);
  return fixed <= other ? [fixed, other] : [other, fixed];
}

// Arrows move the range, with shift they change its width; Home and End go to the ends.
function rangeByKey(brush, key, shift, seen) {
  const into = brush.log ? Math.log10 : Number;
  const back = brush.log ? (x) => 10 ** x : Number;
  const [first, last] = brush.limits().map(into);
  const [left, right] = seen.map(into);
  const step = { ArrowLeft: -1, ArrowRight: 1 }[key];
  const end = { Home: first, End: last }[key];
  if (step === undefined && end === undefined) return null;
  const span = right - left;
  const range = brush.get();
  if (!range) return [left + 0.4 * span, left + 0.6 * span].map(back);
  let [low, high] = range.map(into);
  if (shift) {
    high = clamp(end ?? high + (step * span) / 50, [low + span / 500, last]);
  } else {
    const width = high - low;
    low = clamp(end ?? low + (step * span) / 50, [first, Math.max(last - width, first)]);
    high = low + width;
  }
  return [low, high].map(back);
}

// A figure with its brush, drawn and told in words together.
function brushedFigure(bench, figureMade, keys, brush, draw, inWords) {
  const place = brushOn(bench, figureMade, brush);
  const tell = () => figureMade.describe(inWords());
  return {
    ...figureMade,
    keys,
    place,
    tell,
    draw: () => {
      draw(figureMade.plot);
      tell();
    },
  };
}
