// Strokes on a 2D canvas, in the plan's coordinates.

const PRESSURE_TOLERANCE_PX = 0.1; // of the screen: how finely strokes of varying width are flattened

// Paint strokes first … last − 1, but for hidden layers and what lies outside of `window` (left, top, right, bottom).
function paintStrokes(context, plan, boxes, first, last, visible, window, scale) {
  context.lineJoin = "round";
  let layer = -1;
  for (let i = first; i < last; i++) {
    const own = plan.layerOf[i], box = 4 * i;
    if (!visible[own]) continue;
    if (boxes[box] > window[2] || boxes[box + 1] > window[3] || boxes[box + 2] < window[0] || boxes[box + 3] < window[1])
      continue;
    if (own !== layer) context.lineCap = plan.layers[(layer = own)].cap;
    paintStroke(context, plan, i, colorOf(plan, i), scale);
  }
}

function paintStroke(context, plan, i, color, scale, more = 0) {
  context.beginPath();
  if (plan.pressed[i]) {
    tracePressed(context, plan, i, scale, more);
    context.fillStyle = color;
    context.fill("nonzero");
    return;
  }
  traceChain(context, plan, i);
  context.strokeStyle = color;
  context.lineWidth = plan.widths[i] + 2 * more;
  context.stroke();
}

function traceChain(context, { points, starts }, i) {
  let at = 2 * starts[i];
  const end = 2 * starts[i + 1];
  context.moveTo(points[at], points[at + 1]);
  for (at += 2; at < end; at += 6)
    context.bezierCurveTo(points[at], points[at + 1], points[at + 2], points[at + 3], points[at + 4], points[at + 5]);
}

// A stroke of varying width is the union of discs and of what lies between neighbours: closed loops that all turn the
// same way, filled by the nonzero rule. A disc is left out where the curve is so straight that nothing gapes.
function tracePressed(context, plan, i, scale, more) {
  const tolerance = PRESSURE_TOLERANCE_PX / scale;
  const discs = discsOf(plan, i, tolerance);
  const last = discs.length - 1;
  const round = plan.layers[plan.layerOf[i]].cap !== "butt";
  let before = null;
  for (let k = 0; k <= last; k++) {
    const [x, y, radius] = [discs[k][0], discs[k][1], discs[k][2] + more];
    const next = k < last ? segment(context, discs[k], discs[k + 1], more) : null;
    const end = k === 0 || k === last;
    const turn = before !== null && next !== null ? Math.abs(Math.atan2(Math.sin(next - before), Math.cos(next - before))) : 0;
    if (end ? round : next === null || before === null || (radius * turn * turn) / 8 > tolerance / 2) {
      context.moveTo(x + radius, y);
      context.arc(x, y, radius, 0, 2 * Math.PI);
    }
    if (next !== null) before = next;
  }
}

// The cross-sections of two neighbouring discs, joined; returns the direction, or null where there is none.
function segment(context, [ax, ay, ar], [bx, by, br], more) {
  const dx = bx - ax, dy = by - ay, length = Math.hypot(dx, dy);
  if (!length) return null;
  const nx = -dy / length, ny = dx / length, a = ar + more, b = br + more;
  context.moveTo(ax - nx * a, ay - ny * a);
  context.lineTo(bx - nx * b, by - ny * b);
  context.lineTo(bx + nx * b, by + ny * b);
  context.lineTo(ax + nx * a, ay + ny * a);
  context.closePath();
  return Math.atan2(dy, dx);
}
