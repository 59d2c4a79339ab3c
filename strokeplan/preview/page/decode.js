// The plan out of the page: header (JSON) and columns (base64 of deflate); strokeplan/preview/encoding.py has the
// format.

const FORMAT_VERSION = 1;

async function readPlan() {
  const header = JSON.parse(document.getElementById("header").textContent);
  if (header.version !== FORMAT_VERSION) throw new Error(`this page cannot show version ${header.version} of its data`);
  const data = document.getElementById("strokes");
  const bytes = await inflate(fromBase64(data.textContent.trim()));
  data.remove(); // megabytes of text that nobody needs any more
  return decode(header, bytes);
}

function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return bytes;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Typed arrays of n strokes: stroke i has the points starts[i] … starts[i + 1] − 1 (x and y in turn).
function decode(header, bytes) {
  const { strokes: n, cubics } = header;
  const read = columnReader(bytes);
  const plan = { ...header, n, counts: read.varints(n) };
  plan.starts = new Int32Array(n + 1);
  for (let i = 0; i < n; i++) plan.starts[i + 1] = plan.starts[i] + 3 * plan.counts[i] + 1;
  plan.points = decodePoints(plan, read, cubics);
  plan.widths = new Float32Array(n);
  read.varints(n).forEach((index, i) => (plan.widths[i] = header.widths[index]));
  plan.colors = decodeColors(read, n);
  plan.pressed = header.pressure ? read.bytes(n) : new Uint8Array(n);
  if (header.pressure) decodePressures(plan, read);
  plan.pen = header.pens.length ? read.varints(n) : null;
  if (header.plot) plan.done = read.varints(n); // hundredths of a second, from one line to the next
  plan.layerOf = new Uint16Array(n);
  header.layers.forEach((layer, k) => plan.layerOf.fill(k, layer.first, layer.last));
  return plan;
}

function columnReader(bytes) {
  let at = 0;
  const varint = () => {
    let value = 0, shift = 0, byte;
    do {
      byte = bytes[at++];
      value |= (byte & 127) << shift;
      shift += 7;
    } while (byte & 128);
    return value >>> 0;
  };
  const zigzag = () => {
    const value = varint();
    return value & 1 ? -(value >>> 1) - 1 : value >>> 1;
  };
  const column = (count, next) => {
    const values = new Int32Array(count);
    for (let i = 0; i < count; i++) values[i] = next();
    return values;
  };
  return {
    varints: (count) => column(count, varint),
    zigzags: (count) => column(count, zigzag),
    bytes: (count) => bytes.subarray(at, (at += count)),
  };
}

function decodePoints(plan, read, cubics) {
  const { n, counts, starts, step } = plan;
  const begins = [read.zigzags(n), read.zigzags(n)];
  const tables = [0, 1, 2].map(() => [read.zigzags(cubics), read.zigzags(cubics)]);
  const points = new Float32Array(2 * starts[n]);
  for (let axis = 0; axis < 2; axis++) {
    const [ways, firsts, seconds] = tables.map((table) => table[axis]);
    let begin = 0;
    for (let i = 0, c = 0; i < n; i++) {
      let at = 2 * starts[i] + axis;
      let here = (begin += begins[axis][i]);
      points[at] = here * step;
      for (let k = 0; k < counts[i]; k++, c++, at += 6) {
        const third = Math.floor(ways[c] / 3);
        const end = here + ways[c];
        points[at + 2] = (here + third + 2 * firsts[c]) * step;
        points[at + 4] = (end - third + 2 * seconds[c]) * step;
        points[at + 6] = end * step;
        here = end;
      }
    }
  }
  return points;
}

// Three bytes a stroke: red, green, blue.
function decodeColors(read, n) {
  const green = read.bytes(n), red = read.bytes(n), blue = read.bytes(n);
  const colors = new Uint8Array(3 * n);
  for (let i = 0; i < n; i++) {
    colors[3 * i] = red[i] + green[i];
    colors[3 * i + 1] = green[i];
    colors[3 * i + 2] = blue[i] + green[i];
  }
  return colors;
}

// plan.pressures: 0 … 1 at every on-curve point of the strokes that have any, plan.firstKnot says from where.
function decodePressures(plan, read) {
  plan.pressed = plan.pressed.slice();
  plan.firstKnot = new Int32Array(plan.n);
  let knots = 0;
  for (let i = 0; i < plan.n; i++) {
    plan.firstKnot[i] = knots;
    if (plan.pressed[i]) knots += plan.counts[i] + 1;
  }
  let value = 0;
  plan.pressures = Float32Array.from(read.zigzags(knots), (change) => (value += change) / 255);
}

function colorOf(plan, i) {
  const { colors } = plan;
  return "#" + ((1 << 24) | (colors[3 * i] << 16) | (colors[3 * i + 1] << 8) | colors[3 * i + 2]).toString(16).slice(1);
}
