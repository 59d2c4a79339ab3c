// Where a plotter's pen travels above the paper: thin lines from the end of each line to the beginning of the next, by
// way of where it stops between them; and the margin.

const WAY_COLOR = "rgb(0 110 220 / .55)";
const MARGIN_COLOR = "rgb(128 128 128 / .7)";

function drawWays(app) {
  const { plan, stage } = app;
  const canvas = $("ways"), context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (!plan.plot || !app.ways) return;
  const { view, target } = stage.state, ratio = window.devicePixelRatio || 1;
  context.setTransform(view.scale, 0, 0, view.scale, view.left, view.top);
  context.lineWidth = ratio / view.scale;
  context.strokeStyle = WAY_COLOR;
  context.beginPath();
  traceWays(context, plan, target, stage.visible);
  context.stroke();
  const { margin } = plan.plot;
  if (!margin) return;
  context.strokeStyle = MARGIN_COLOR;
  context.setLineDash([4 * context.lineWidth, 4 * context.lineWidth]);
  context.strokeRect(margin, margin, plan.width - 2 * margin, plan.height - 2 * margin);
  context.setLineDash([]);
}

// Of the lines 0 … target − 1, and home where all are drawn. Ways to lines of hidden layers are left out.
function traceWays(context, { plot, points, starts, layerOf, n }, target, visible) {
  const { stops } = plot;
  let [x, y] = plot.home, next = 0;
  for (let i = 0; i <= target; i++) {
    const shown = i === n || (i < target && visible[layerOf[i]]);
    if (i < n && i === target) break;
    context.moveTo(x, y);
    for (; next < stops.length && stops[next][0] <= i; next++) {
      [, x, y] = stops[next];
      if (shown) context.lineTo(x, y);
    }
    if (i === n) break;
    if (shown) context.lineTo(points[2 * starts[i]], points[2 * starts[i] + 1]);
    x = points[2 * starts[i + 1] - 2];
    y = points[2 * starts[i + 1] - 1];
  }
}

function showWays(app, shown) {
  app.ways = shown;
  $("show-ways").setAttribute("aria-pressed", shown);
  drawWays(app);
}

// 7384 → "2:03:04".
function clock(seconds) {
  const whole = Math.round(seconds), two = (value) => String(value).padStart(2, "0");
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}
