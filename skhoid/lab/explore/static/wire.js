// The envelope in which numbers travel: see skhoid/lab/explore/payloads.py.

function unpack(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, size));
  const { value, arrays } = JSON.parse(text);
  const start = Math.ceil((4 + size) / 8) * 8;
  const decoded = arrays.map((head) => decodedArray(buffer, start, head));
  return withArrays(value, decoded);
}

function withArrays(value, arrays) {
  if (Array.isArray(value)) return value.map((part) => withArrays(part, arrays));
  if (value === null || typeof value !== "object") return value;
  if (Object.hasOwn(value, "$array")) return arrays[value.$array];
  return Object.fromEntries(
    Object.entries(value).map(([key, part]) => [key, withArrays(part, arrays)]),
  );
}

function decodedArray(buffer, start, { dtype, offset, n, zero, scale }) {
  const at = start + offset;
  if (dtype === "u1") return new Uint8Array(buffer, at, n);
  if (dtype === "f8") {
    return at % 8
      ? new Float64Array(buffer.slice(at, at + 8 * n))
      : new Float64Array(buffer, at, n);
  }
  if (dtype !== "i2") throw new Error(`An array of the kind "${dtype}" is not known here.`);
  const stored = new Int16Array(at % 2 ? buffer.slice(at, at + 2 * n) : buffer, at % 2 ? 0 : at, n);
  const out = new Float64Array(n);
  for (let i = 0; i < n; i++) out[i] = stored[i] === -32768 ? NaN : zero + scale * stored[i];
  return out;
}

async function unpackText(base64) {
  const letters = atob(base64.trim());
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  const opened = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return unpack(await new Response(opened).arrayBuffer());
}

const wire = { unpack, unpackText };
