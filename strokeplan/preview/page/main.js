// The page: the plan is read, the stage is set, controls and keys act on it.

const DURATION_S = 20; // of the whole at speed 1
const STROKE_S = 0.1; // or this for each stroke, if they are few
const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];
const ZOOM_STEP = 1.5;
const STEP = 200; // steps of the arrow keys from end to end …
const LARGE = 10; // … and how many of them with shift

const $ = (id) => document.getElementById(id);
const count = (value) => value.toLocaleString("en");
const number = (value) => Number(value.toPrecision(3)).toLocaleString("en", { maximumFractionDigits: 3 });

main().catch((error) => {
  document.body.dataset.state = "failed";
  $("notice").textContent = `The picture could not be shown: ${error.message}`;
  throw error;
});

async function main() {
  if (typeof DecompressionStream === "undefined") throw new Error("this browser is too old; one of 2023 or later will do");
  const plan = await readPlan();
  const poster = $("poster");
  const boxes = boxesOf(plan), pace = plan.plot ? paceOfPlot(plan) : paceOf(plan);
  const stage = createStage($("picture"), plan, boxes, poster && (await loaded(poster)));
  const app = { plan, boxes, pace, stage, grid: null, playing: false, clock: 1, speed: 2, chosen: -1, pinned: false, at: 0, ways: plan.plot !== null };
  setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  buildLayers(app);
  listen(app);
  new ResizeObserver(() => fit(app)).observe($("stage"));
  fit(app);
  requestAnimationFrame(function frame(now) {
    tick(app, now);
    requestAnimationFrame(frame);
  });
}

// A poster that cannot be decoded is done without.
async function loaded(poster) {
  await poster.decode().catch(() => {});
  return poster.naturalWidth ? poster : null;
}

function tick(app, now) {
  const { plan, pace, stage } = app;
  const seconds = Math.min((now - app.at) / 1000, 0.1);
  app.at = now;
  if (app.playing && !stage.state.busy) {
    const duration = Math.min(DURATION_S, Math.max(plan.n * STROKE_S, 1));
    app.clock = Math.min(app.clock + (seconds * SPEEDS[app.speed]) / duration, 1);
    stage.seek(app.clock >= 1 ? plan.n : strokeAt(pace, app.clock));
    if (app.clock >= 1) play(app, false);
  }
  stage.frame(now);
  report(app);
}

// What the controls say, where it has changed.
function report(app) {
  const { plan, stage } = app;
  const { target, busy, painted, view } = stage.state;
  if (app.told !== target) {
    app.told = target;
    const done = plan.plot ? app.pace[target] * plan.plot.total : target, whole = plan.plot ? plan.plot.total : plan.n;
    $("scrub").value = done;
    const lines = `${count(target)} of ${count(plan.n)} ${plan.plot ? "lines" : "strokes"}`;
    $("scrub").setAttribute("aria-valuetext", plan.plot ? `${clock(done)}, ${lines}` : lines);
    $("scrub").style.setProperty("--done", `${(100 * done) / Math.max(whole, 1e-9)}%`);
    $("counter").textContent = plan.plot ? clock(done) : count(target);
    $("counter").title = lines;
    drawWays(app);
    if (app.chosen >= target) choose(app, -1);
  }
  const state = busy ? "painting" : "ready";
  if (document.body.dataset.state !== state) {
    document.body.dataset.state = state;
    if (!busy && !app.first) app.first = performance.mark("strokeplan-painted");
  }
  const shown = `${view.scale} ${view.left} ${view.top} ${painted}`;
  if (app.shown !== shown) $("picture").dataset.shown = app.shown = shown;
  if (app.marked === view) return;
  drawMark(app);
  drawWays(app);
  placePaper(app.plan, view);
}

// The shadow of the paper is an element's: a filter on the canvas would cost more than painting does.
function placePaper(plan, { scale, left, top }) {
  const ratio = window.devicePixelRatio || 1;
  const sides = { left, top, width: plan.width * scale, height: plan.height * scale };
  for (const [side, length] of Object.entries(sides)) $("paper").style[side] = `${length / ratio}px`;
}

function fit(app) {
  const { stage, plan } = app;
  const canvas = $("picture"), ratio = window.devicePixelRatio || 1;
  const width = Math.max(Math.round($("stage").clientWidth * ratio), 1), height = Math.max(Math.round($("stage").clientHeight * ratio), 1);
  if (canvas.width === width && canvas.height === height && stage.state.view) return;
  const { view } = stage.state;
  const enlarged = view && !isFitted(app);
  const aside = [(width - canvas.width) / 2, (height - canvas.height) / 2];
  stage.resize(width, height);
  $("mark").width = width;
  $("mark").height = height;
  $("ways").width = width;
  $("ways").height = height;
  stage.setView(enlarged ? panned(view, ...aside, plan, width, height) : fitted(plan, width, height));
  stage.frame(performance.now());
  if (!app.opened) app.opened = performance.mark("strokeplan-first-frame");
}

function play(app, playing) {
  if (playing && app.stage.state.target >= app.plan.n) seek(app, 0);
  app.playing = playing;
  document.body.classList.toggle("playing", playing);
  $("play").setAttribute("aria-label", playing ? "Pause" : "Play");
}

function seek(app, target) {
  const bounded = Math.min(Math.max(Math.round(target), 0), app.plan.n);
  app.clock = app.pace[bounded];
  app.stage.seek(bounded);
}

// Where the scrub bar is put: at a stroke, or at a moment of a plot.
function seekTo(app, value) {
  const { plot, n } = app.plan;
  seek(app, !plot ? value : value >= plot.total ? n : strokeAt(app.pace, value / plot.total));
}

function setSpeed(app, speed) {
  app.speed = Math.min(Math.max(speed, 0), SPEEDS.length - 1);
  const names = { 0.25: "¼", 0.5: "½" };
  $("speed").textContent = `${names[SPEEDS[app.speed]] ?? SPEEDS[app.speed]}×`;
  $("slower").disabled = app.speed === 0;
  $("faster").disabled = app.speed === SPEEDS.length - 1;
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  $("theme").setAttribute("aria-label", theme === "dark" ? "Light theme" : "Dark theme");
}

function zoomBy(app, factor, x = $("picture").width / 2, y = $("picture").height / 2) {
  const { width, height } = $("picture");
  app.stage.setView(zoomed(app.stage.state.view, factor, x, y, app.plan, width, height));
}

function zoomToFit(app) {
  app.stage.setView(fitted(app.plan, $("picture").width, $("picture").height));
}

function isFitted(app) {
  return app.stage.state.view.scale <= fitted(app.plan, $("picture").width, $("picture").height).scale;
}
