// Where strokes lie: boxes, lengths, the pace of playing, and which stroke lies under a point.

const FLAT_STEPS_MAX = 32;
const CELLS = 96; // along the longer side of the canvas

// Steps that flatten the cubic whose first number stands at `at` to within `tolerance` (bound of second differences).
function stepsOf(points, at, tolerance) {
  const bend = Math.max(
    Math.hypot(points[at] - 2 * points[at + 2] + points[at + 4], points[at + 1] - 2 * points[at + 3] + points[at + 5]),
    Math.hypot(points[at + 2] - 2 * points[at + 4] + points[at + 6], points[at + 3] - 2 * points[at + 5] + points[at + 7]),
  );
  return Math.min(Math.max(Math.ceil(Math.sqrt((0.75 * bend) / tolerance)), 1), FLAT_STEPS_MAX);
}

function along(points, at, t) {
  const s = 1 - t;
  const a = s * s * s, b = 3 * s * s * t, c = 3 * s * t * t, d = t * t * t;
  return [
    a * points[at] + b * points[at + 2] + c * points[at + 4] + d * points[at + 6],
    a * points[at + 1] + b * points[at + 3] + c * points[at + 5] + d * points[at + 7],
  ];
}

// Stroke i as [x, y, radius] along its flattened curve.
function discsOf(plan, i, tolerance) {
  const { points, starts, counts, pressed, pressures, firstKnot, widths } = plan;
  const radius = widths[i] / 2;
  const knot = (k) => (pressed[i] ? radius * pressures[firstKnot[i] + k] : radius);
  const first = 2 * starts[i];
  const discs = [[points[first], points[first + 1], knot(0)]];
  for (let k = 0; k < counts[i]; k++) {
    const at = first + 6 * k;
    const steps = stepsOf(points, at, tolerance);
    for (let step = 1; step <= steps; step++) {
      const t = step / steps;
      const [x, y] = along(points, at, t);
      discs.push([x, y, (1 - t) * knot(k) + t * knot(k + 1)]);
    }
  }
  return discs;
}

function lengthOf(plan, i) {
  const discs = discsOf(plan, i, plan.step / 4);
  let length = 0;
  for (let k = 1; k < discs.length; k++) length += Math.hypot(discs[k][0] - discs[k - 1][0], discs[k][1] - discs[k - 1][1]);
  return length;
}

// Left, top, right, bottom of each stroke, its paint included.
function boxesOf({ n, points, starts, widths }) {
  const boxes = new Float32Array(4 * n);
  for (let i = 0; i < n; i++) {
    let left = Infinity, top = Infinity, right = -Infinity, bottom = -Infinity;
    for (let at = 2 * starts[i]; at < 2 * starts[i + 1]; at += 2) {
      const x = points[at], y = points[at + 1];
      if (x < left) left = x;
      if (x > right) right = x;
      if (y < top) top = y;
      if (y > bottom) bottom = y;
    }
    const reach = widths[i] / 2;
    boxes[4 * i] = left - reach;
    boxes[4 * i + 1] = top - reach;
    boxes[4 * i + 2] = right + reach;
    boxes[4 * i + 3] = bottom + reach;
  }
  return boxes;
}

// pace[i]: the part of the playing time after which i strokes lie, so that wide and long strokes linger.
function paceOf({ n, points, starts, widths }) {
  const pace = new Float64Array(n + 1);
  for (let i = 0; i < n; i++) {
    let length = widths[i];
    for (let at = 2 * starts[i]; at + 2 < 2 * starts[i + 1]; at += 2) {
      const dx = points[at + 2] - points[at], dy = points[at + 3] - points[at + 1];
      length += Math.sqrt(dx * dx + dy * dy); // hypot takes ten times as long
    }
    pace[i + 1] = pace[i] + Math.sqrt(length * widths[i]);
  }
  for (let i = 1; i <= n; i++) pace[i] /= pace[n];
  return pace;
}

// Of a plot: when each line is drawn, by the machine's own motion; the last one when the machine is home.
function paceOfPlot({ n, done, plot }) {
  const pace = new Float64Array(n + 1);
  for (let i = 0, sum = 0; i < n; i++) pace[i + 1] = Math.min((sum += done[i] / 100) / plot.total, 1);
  pace[n] = 1;
  return pace;
}

// The last i with pace[i] ≤ time.
function strokeAt(pace, time) {
  let low = 0, high = pace.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (pace[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}

// A uniform grid over the canvas: list[begin[c]] … list[begin[c + 1] − 1] are the strokes whose boxes meet cell c.
function gridOf(plan, boxes) {
  const size = Math.max(plan.width, plan.height) / CELLS;
  const columns = Math.ceil(plan.width / size), rows = Math.ceil(plan.height / size);
  const clamp = (value, cells) => Math.min(Math.max(Math.floor(value / size), 0), cells - 1);
  const cells = (i, visit) => {
    const [left, top, right, bottom] = boxes.subarray(4 * i, 4 * i + 4);
    for (let row = clamp(top, rows); row <= clamp(bottom, rows); row++)
      for (let column = clamp(left, columns); column <= clamp(right, columns); column++) visit(row * columns + column);
  };
  const begin = new Int32Array(columns * rows + 1);
  for (let i = 0; i < plan.n; i++) cells(i, (cell) => begin[cell + 1]++);
  for (let c = 0; c < columns * rows; c++) begin[c + 1] += begin[c];
  const list = new Int32Array(begin[columns * rows]);
  const next = begin.slice();
  for (let i = 0; i < plan.n; i++) cells(i, (cell) => (list[next[cell]++] = i));
  return { begin, list, cell: (x, y) => clamp(y, rows) * columns + clamp(x, columns) };
}

// The topmost of the first `painted` strokes that covers a point and whose layer is visible, or −1.
function strokeUnder(plan, boxes, grid, x, y, painted, visible) {
  const cell = grid.cell(x, y);
  for (let at = grid.begin[cell + 1] - 1; at >= grid.begin[cell]; at--) {
    const i = grid.list[at], box = 4 * i;
    if (i >= painted || !visible[plan.layerOf[i]]) continue;
    if (x < boxes[box] || y < boxes[box + 1] || x > boxes[box + 2] || y > boxes[box + 3]) continue;
    if (covers(plan, i, x, y)) return i;
  }
  return -1;
}

function covers(plan, i, x, y) {
  const discs = discsOf(plan, i, plan.step);
  const butt = plan.layers[plan.layerOf[i]].cap === "butt";
  for (let k = 0; k + 1 < discs.length; k++) {
    const [ax, ay, ar] = discs[k], [bx, by, br] = discs[k + 1];
    const dx = bx - ax, dy = by - ay, square = dx * dx + dy * dy;
    const t = square ? ((x - ax) * dx + (y - ay) * dy) / square : 0;
    if (butt && ((k === 0 && t < 0) || (k + 2 === discs.length && t > 1))) continue;
    const u = Math.min(Math.max(t, 0), 1);
    if (Math.hypot(x - ax - u * dx, y - ay - u * dy) <= (1 - u) * ar + u * br) return true;
  }
  return false;
}
