// Numbers in words.

function rounded(value, digits) {
  return Number(value.toPrecision(digits));
}

function figure(value, digits = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  const text =
    size !== 0 && (size < 1e-4 || size >= 1e6)
      ? rounded(value, Math.max(digits - 1, 1))
          .toExponential()
          .replace("e+", "e")
      : String(rounded(value, digits));
  return text.replaceAll("-", "−");
}

function percent(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value < -1000) return "below −1000 %";
  return `${value.toFixed(1).replace("-", "−")} %`;
}

function points(value) {
  if (!Number.isFinite(value)) return "–";
  if (value < -1000) return "below −1000";
  const digits = Math.abs(value) < 0.095 ? 2 : 1;
  const sign = value > 0 ? "+" : "";
  return `${sign}${value.toFixed(digits).replace("-", "−")}`;
}

function count(n, one, many = `${one}s`) {
  return `${n.toLocaleString("en-GB")} ${n === 1 ? one : many}`;
}

// What is gained from one VAF to the next, either of which may not be known.
function gained(before, after) {
  return before === null || after === null ? NaN : after - before;
}

// Names may be of any length: there is room for so many letters.
function shortened(text, most) {
  const letters = [...text];
  return letters.length > most ? `${letters.slice(0, most - 1).join("")}…` : text;
}

function withUnit(text, unit) {
  return unit && unit !== "-" ? `${text} ${isolated(unit)}` : text;
}

// Names in other scripts keep their direction to themselves.
function isolated(text) {
  if (seenName(text) !== text) return seenName(text);
  return /[^\u0000-\u02ff]/.test(text) ? `\u2068${text}\u2069` : text;
}

function fromTo(before, after) {
  if (percent(before) === percent(after)) return `VAF ${percent(after)}`;
  return `VAF ${percent(before).replace(" %", "")} → ${percent(after)}`;
}

// Labels of runs that are only numbers do not say what they are.
function runName(label) {
  return /^\d+$/.test(label) ? `run ${label}` : label;
}

function upperFirst(text) {
  return text ? text[0].toUpperCase() + text.slice(1) : text;
}
