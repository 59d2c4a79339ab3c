// Layers, the chosen stroke and what is known of it.

function buildLayers(app) {
  const { plan } = app;
  const list = $("layer-list"), bar = $("bar");
  plan.layers.forEach((layer, k) => {
    const row = $("layer-row").content.cloneNode(true);
    const box = row.querySelector("input");
    box.addEventListener("change", () => showLayer(app, k, box.checked));
    row.querySelector(".name").textContent = layerName(layer);
    row.querySelector(".about").textContent = layerWidths(plan, layer);
    row.querySelector(".count").textContent = count(layer.last - layer.first);
    list.append(row);
    const part = document.createElement("span");
    part.style.flexGrow = plan.plot ? app.pace[layer.last] - app.pace[layer.first] : layer.last - layer.first;
    part.title = layerName(layer);
    bar.append(part);
  });
  const things = plan.plot ? "line" : "stroke", summary = `${count(plan.n)} ${things}${plan.n === 1 ? "" : "s"}`;
  $("summary").textContent = plan.plot ? `${summary}, ${clock(plan.plot.total)}` : summary;
  $("total").textContent = plan.plot ? clock(plan.plot.total) : count(plan.n);
  $("scrub").max = plan.plot ? plan.plot.total : plan.n;
  $("scrub").step = plan.plot ? "any" : 1;
  for (const element of document.querySelectorAll(".of-plots")) element.hidden = !plan.plot;
  if (plan.plot) $("scrub").setAttribute("aria-label", "Time plotted");
}

function layerName(layer) {
  return /^\d+$/.test(layer.name) ? `Layer ${layer.name}` : layer.name;
}

function layerWidths(plan, { first, last, medium }) {
  if (first === last) return medium;
  let least = Infinity, most = 0;
  for (let i = first; i < last; i++) {
    least = Math.min(least, plan.widths[i]);
    most = Math.max(most, plan.widths[i]);
  }
  return `${number(least) === number(most) ? number(least) : `${number(least)}–${number(most)}`} ${plan.unit}, ${medium}`;
}

function showLayer(app, layer, shown) {
  app.stage.showLayer(layer, shown);
  drawWays(app);
  $("layer-list").querySelectorAll("input")[layer].checked = shown;
  if (app.chosen >= 0 && !app.stage.visible[app.plan.layerOf[app.chosen]]) choose(app, -1);
}

function strokeAtPixel(app, x, y) {
  const { plan, boxes, stage } = app;
  app.grid ??= gridOf(plan, boxes);
  const [px, py] = toPlan(stage.state.view, x, y);
  if (px < 0 || py < 0 || px > plan.width || py > plan.height) return -1;
  return strokeUnder(plan, boxes, app.grid, px, py, stage.state.target, stage.visible);
}

// The pointer's stroke, unless one is pinned by a click, a tap or a key.
function hover(app, x, y) {
  if (app.pinned) return;
  choose(app, x === null || app.playing ? -1 : strokeAtPixel(app, x, y));
}

function pick(app, x, y) {
  const found = strokeAtPixel(app, x, y);
  const same = app.pinned && found === app.chosen;
  choose(app, same ? -1 : found, !same);
}

// The next visible stroke that is painted, from the chosen one up or down the order.
function stepStroke(app, way) {
  const { plan, stage } = app;
  const end = stage.state.target;
  let i = app.chosen < 0 ? (way > 0 ? 0 : end - 1) : app.chosen + way;
  while (i >= 0 && i < end && !stage.visible[plan.layerOf[i]]) i += way;
  if (i >= 0 && i < end) choose(app, i, true);
}

function choose(app, i, pinned = false) {
  app.pinned = pinned && i >= 0;
  document.body.classList.toggle("pinned", app.pinned);
  if (app.chosen === i) return;
  app.chosen = i;
  document.body.classList.toggle("chosen", i >= 0);
  if (i >= 0) describe(app, i);
  drawMark(app);
}

function describe({ plan }, i) {
  const layer = plan.layers[plan.layerOf[i]], color = colorOf(plan, i);
  $("swatch").style.backgroundColor = color;
  $("color").textContent = color;
  $("ordinal").textContent = `${plan.plot ? "Line" : "Stroke"} ${count(i + 1)}`;
  $("in-layer").textContent = layerName(layer);
  $("width").textContent = `${widthText(plan, i)} ${plan.unit}`;
  $("length").textContent = `${number(lengthOf(plan, i))} ${plan.unit}`;
  const pen = plan.pen?.[i] ? plan.pens[plan.pen[i] - 1] : null;
  $("pen-row").hidden = pen === null;
  $("pen").textContent = pen ?? "";
}

function widthText({ widths, pressed, pressures, firstKnot, counts }, i) {
  if (!pressed[i]) return number(widths[i]);
  const own = pressures.subarray(firstKnot[i], firstKnot[i] + counts[i] + 1);
  const least = number(widths[i] * Math.min(...own)), most = number(widths[i] * Math.max(...own));
  return least === most ? most : `${least}–${most}`;
}

// The whole of the chosen stroke, whatever lies over it, within a rim that shows on any colour.
function drawMark(app) {
  const { plan, stage, chosen } = app;
  const { view } = stage.state;
  const canvas = $("mark"), context = canvas.getContext("2d");
  app.marked = view;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (chosen < 0) return;
  const { scale, left, top } = view, ratio = window.devicePixelRatio || 1;
  context.setTransform(scale, 0, 0, scale, left, top);
  context.lineJoin = "round";
  context.lineCap = plan.layers[plan.layerOf[chosen]].cap;
  for (const [color, rim] of [["#000", 3], ["#fff", 2], [colorOf(plan, chosen), 0]])
    paintStroke(context, plan, chosen, color, scale, (rim * ratio) / scale);
}
