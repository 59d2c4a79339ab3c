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

// A stroke of varying width is the union of discs, of what lies between neighbours and of the wedges that gape between
// those: closed loops that all turn the same way, filled by the nonzero rule.
function tracePressed(context, plan, i, scale, more) {
  const tolerance = PRESSURE_TOLERANCE_PX / scale;
  const discs = discsOf(plan, i, tolerance);
  const last = discs.length - 1;
  const round = plan.layers[plan.layerOf[i]].cap !== "butt";
  for (const disc of discs) disc[2] += more;
  let before = null; // the normal of the segment that ends here
  for (let k = 0; k <= last; k++) {
    const normal = k < last ? segment(context, discs[k], discs[k + 1]) : null;
    if (k === 0 || k === last) {
      if (round) dot(context, discs[k]);
    } else if (before && normal) joint(context, discs[k], before, normal, tolerance);
    before = normal ?? before;
  }
}

function dot(context, [x, y, radius]) {
  context.moveTo(x + radius, y);
  context.arc(x, y, radius, 0, 2 * Math.PI);
}

// The cross-sections of two neighbouring discs, joined; returns the unit normal, or null where there is none.
function segment(context, [ax, ay, ar], [bx, by, br]) {
  const dx = bx - ax, dy = by - ay, length = Math.hypot(dx, dy);
  if (!length) return null;
  const nx = -dy / length, ny = dx / length;
  context.moveTo(ax - nx * ar, ay - ny * ar);
  context.lineTo(bx - nx * br, by - ny * br);
  context.lineTo(bx + nx * br, by + ny * br);
  context.lineTo(ax + nx * ar, ay + ny * ar);
  context.closePath();
  return [nx, ny];
}

// What gapes on the outer side of a bend: a triangle, or the whole disc where that would look cut.
function joint(context, [x, y, radius], [ax, ay], [bx, by], tolerance) {
  const turn = Math.atan2(ax * by - ay * bx, ax * bx + ay * by);
  if ((radius * turn * turn) / 8 > tolerance) return dot(context, [x, y, radius]);
  const out = turn > 0 ? -radius : radius;
  const [first, second] = turn > 0 ? [[ax, ay], [bx, by]] : [[bx, by], [ax, ay]];
  context.moveTo(x, y);
  context.lineTo(x + out * first[0], y + out * first[1]);
  context.lineTo(x + out * second[0], y + out * second[1]);
  context.closePath();
}
