// A million rows on a thousand pixels: of each pixel's column its least and its greatest value.

// The first row with t >= at.
function rowAt(t, at) {
  let low = 0;
  let high = t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] < at) low = middle + 1;
    else high = middle;
  }
  return low;
}

// Bounds of the columns of rows between two times; null: so few rows that each is drawn.
function columnsOf(t, low, high, pixels) {
  const from = Math.max(rowAt(t, low) - 1, 0);
  const to = Math.min(rowAt(t, high) + 2, t.length);
  if (to - from <= 2 * pixels) return { from, to, edges: null };
  const edges = new Uint32Array(pixels + 1);
  for (let c = 0; c <= pixels; c++) edges[c] = from + Math.round((c * (to - from)) / pixels);
  return { from, to, edges };
}

function timesOf(t, { from, to, edges }) {
  if (!edges) return Array.from(t.subarray(from, to));
  const out = [];
  for (let c = 0; c + 1 < edges.length; c++) {
    out.push(t[edges[c]], t[(edges[c] + edges[c + 1]) >> 1]);
  }
  // A column of one row has no middle of its own: the times must not stand still.
  for (let i = 1; i < out.length; i++) if (out[i] < out[i - 1]) out[i] = out[i - 1];
  return out;
}

// Values to draw, clamped: a line that runs away must not overflow what canvas can hold.
function valuesOf(y, { from, to, edges }, least, most) {
  const out = [];
  if (!edges) {
    for (let i = from; i < to; i++) {
      out.push(y[i] !== y[i] ? null : Math.min(Math.max(y[i], least), most));
    }
    return out;
  }
  for (let c = 0; c + 1 < edges.length; c++) {
    let low = Infinity;
    let high = -Infinity;
    let lowest = 0;
    let highest = 0;
    for (let i = edges[c]; i < edges[c + 1]; i++) {
      const value = y[i];
      if (value < low) {
        low = value;
        lowest = i;
      }
      if (value > high) {
        high = value;
        highest = i;
      }
    }
    if (low > high) {
      out.push(null, null);
      continue;
    }
    low = Math.min(Math.max(low, least), most);
    high = Math.min(Math.max(high, least), most);
    if (lowest < highest) out.push(low, high);
    else out.push(high, low);
  }
  return out;
}

// Stretches of time, as pairs of rows, in which the mask has rows; columns next to each other join.
function stretchesOf(mask, { from, to, edges }) {
  const out = [];
  const add = (start, end) => {
    const last = out[out.length - 1];
    if (last && last[1] === start) last[1] = end;
    else out.push([start, end]);
  };
  if (!edges) {
    for (let i = from; i < to; i++) if (mask[i]) add(i, i + 1);
    return out;
  }
  for (let c = 0; c + 1 < edges.length; c++) {
    for (let i = edges[c]; i < edges[c + 1]; i++) {
      if (!mask[i]) continue;
      add(edges[c], edges[c + 1]);
      break;
    }
  }
  return out;
}
