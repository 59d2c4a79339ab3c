// Buttons, scrub bar, keys and gestures.

function listen(app) {
  $("play").addEventListener("click", () => play(app, !app.playing));
  $("slower").addEventListener("click", () => setSpeed(app, app.speed - 1));
  $("faster").addEventListener("click", () => setSpeed(app, app.speed + 1));
  $("scrub").addEventListener("input", (event) => seekTo(app, Number(event.target.value)));
  $("show-ways").addEventListener("click", () => showWays(app, !app.ways));
  $("zoom-in").addEventListener("click", () => zoomBy(app, ZOOM_STEP));
  $("zoom-out").addEventListener("click", () => zoomBy(app, 1 / ZOOM_STEP));
  $("zoom-fit").addEventListener("click", () => zoomToFit(app));
  $("layers").addEventListener("click", () => toggleLayers());
  $("theme").addEventListener("click", toggleTheme);
  $("help").addEventListener("click", () => $("keys").showModal());
  $("keys").addEventListener("click", (event) => event.target === $("keys") && $("keys").close());
  $("forget").addEventListener("click", () => choose(app, -1));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (event) => setTheme(event.matches ? "dark" : "light"));
  document.addEventListener("keydown", (event) => onKey(app, event));
  listenToGestures($("stage"), {
    zoomBy: (factor, x, y) => zoomBy(app, factor, x, y),
    panBy: (dx, dy) => isFitted(app) || app.stage.setView(panned(app.stage.state.view, dx, dy, app.plan, $("picture").width, $("picture").height)),
    toggleZoom: (factor, x, y) => (isFitted(app) ? zoomBy(app, factor, x, y) : zoomToFit(app)),
    hover: (x, y) => hover(app, x, y),
    pick: (x, y) => pick(app, x, y),
  });
  setSpeed(app, app.speed);
  if (!matchMedia("(max-width: 720px)").matches) toggleLayers(true);
}

function toggleLayers(open) {
  const shown = document.body.classList.toggle("layers", open);
  $("layers").setAttribute("aria-expanded", shown);
}

function toggleTheme() {
  setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
}

function onKey(app, event) {
  if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
  const act = actionOf(app, event);
  if (!act) return;
  event.preventDefault();
  act();
}

function actionOf(app, { key, shiftKey, target }) {
  const { plan, stage } = app;
  const step = Math.max(Math.round(plan.n / STEP), 1) * (shiftKey ? LARGE : 1);
  const by = (change) => () => seek(app, stage.state.target + change);
  if (key === " " && target.closest?.("button, input[type=checkbox]")) return null; // they have a use for it
  if (/^[1-9]$/.test(key) && plan.layers[key - 1]) return () => showLayer(app, key - 1, !stage.visible[key - 1]);
  return {
    " ": () => play(app, !app.playing),
    k: () => play(app, !app.playing),
    ArrowLeft: by(-step),
    ArrowRight: by(step),
    ",": by(-1),
    ".": by(1),
    Home: () => seek(app, 0),
    End: () => seek(app, plan.n),
    ArrowDown: () => setSpeed(app, app.speed - 1),
    ArrowUp: () => setSpeed(app, app.speed + 1),
    "+": () => zoomBy(app, ZOOM_STEP),
    "=": () => zoomBy(app, ZOOM_STEP),
    "-": () => zoomBy(app, 1 / ZOOM_STEP),
    0: () => zoomToFit(app),
    "[": () => stepStroke(app, -1),
    "]": () => stepStroke(app, 1),
    l: () => toggleLayers(),
    w: () => app.plan.plot && showWays(app, !app.ways),
    t: toggleTheme,
    "?": () => $("keys").showModal(),
    Escape: () => choose(app, -1),
  }[key.length === 1 ? key.toLowerCase() : key] ?? null;
}
