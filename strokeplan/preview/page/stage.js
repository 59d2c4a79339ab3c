// The picture on the screen. Strokes are painted onto a hidden canvas, a slice each frame, so that the page always
// answers; copies of it on the way (checkpoints) make going back quick. While a picture is being made anew, after a
// zoom or a step back, the one before stays on the screen.

const SLICE_MS = 10; // time for painting in each frame, less where the browser turns out to lag behind
const LAGGING_MS = 60;
const CHUNK = 200; // strokes between two looks at the clock
const CHECKPOINT_BYTES = 96e6;
const CHECKPOINTS_MAX = 24;
const SETTLED_MS = 90; // a view that has not changed for so long is painted

function createStage(screen, plan, boxes, poster) {
  const visible = plan.layers.map(() => true);
  const state = { view: null, target: plan.n, painted: 0, steady: false, busy: true };
  const work = newCanvas(), kept = newCanvas();
  let workView = null, changedAt = -Infinity, slice = SLICE_MS, before = 0, stale = true;
  let keptView = poster && { scale: poster.naturalWidth / plan.width, left: 0, top: 0 };
  let keptPicture = poster;
  let checkpoints = [];

  function resize(width, height) {
    retain();
    screen.width = width;
    screen.height = height;
    checkpoints = [];
    workView = null;
    stale = true;
  }

  function setView(view) {
    if (state.view && view.scale === state.view.scale && view.left === state.view.left && view.top === state.view.top) return;
    retain();
    state.view = view;
    changedAt = performance.now();
    stale = true;
  }

  // Keep what the screen shows until there is better.
  function retain() {
    if (!state.steady) return;
    state.steady = false;
    copy(work, kept);
    keptPicture = kept;
    keptView = workView;
    stale = true;
  }

  function seek(target) {
    if (target < state.painted) retain();
    state.target = target;
  }

  function showLayer(layer, shown) {
    if (visible[layer] === shown) return;
    retain();
    visible[layer] = shown;
    const { first } = plan.layers[layer];
    checkpoints = checkpoints.filter((checkpoint) => checkpoint.count <= first);
    if (state.painted > first) restore(first);
  }

  // Begin anew at the last checkpoint that has at most `count` strokes.
  function restore(count) {
    const from = checkpoints.findLast((checkpoint) => checkpoint.count <= count);
    if (from) copy(from.canvas, work);
    else clear();
    state.painted = from ? from.count : 0;
  }

  function clear() {
    work.width = screen.width;
    work.height = screen.height;
    const context = inPlan(work, workView);
    context.fillStyle = plan.background;
    context.fillRect(0, 0, plan.width, plan.height);
    context.restore();
  }

  function frame(now) {
    slice = now - before > LAGGING_MS ? Math.max(slice / 2, 2) : Math.min(slice * 1.2, SLICE_MS);
    before = now;
    if (workView !== state.view && (now - changedAt > SETTLED_MS || workView === null)) {
      workView = state.view;
      checkpoints = [];
      clear();
      state.painted = 0;
    }
    if (workView === state.view) advance();
    if (stale) present();
    state.busy = workView !== state.view || state.painted !== state.target;
  }

  function advance() {
    if (state.target < state.painted) restore(state.target);
    const end = performance.now() + slice;
    while (state.painted < state.target && performance.now() < end) paint();
    if (state.painted !== state.target) return;
    stale ||= !state.steady;
    state.steady = true;
  }

  function paint() {
    const stride = Math.ceil(plan.n / checkpointCount()) || 1;
    const mark = (Math.floor(state.painted / stride) + 1) * stride;
    const last = Math.min(state.painted + CHUNK, state.target, mark);
    const context = inPlan(work, workView);
    const [left, top] = toPlan(workView, 0, 0), [right, bottom] = toPlan(workView, work.width, work.height);
    paintStrokes(context, plan, boxes, state.painted, last, visible, [left, top, right, bottom], workView.scale);
    context.restore();
    state.painted = last;
    if (state.steady) stale = true; // painted forward from what was shown
    if ((last === mark || last === plan.n) && (checkpoints.at(-1)?.count ?? 0) < last) {
      const canvas = newCanvas();
      copy(work, canvas);
      checkpoints.push({ count: last, canvas });
    }
  }

  function checkpointCount() {
    return Math.min(Math.max(Math.floor(CHECKPOINT_BYTES / (4 * work.width * work.height)), 2), CHECKPOINTS_MAX);
  }

  function present() {
    const context = inPlan(screen, state.view, true);
    context.fillStyle = plan.background;
    context.fillRect(0, 0, plan.width, plan.height);
    const picture = state.steady ? work : keptPicture, own = state.steady ? workView : keptView;
    if (picture) {
      const scale = state.view.scale / own.scale;
      context.setTransform(scale, 0, 0, scale, state.view.left - own.left * scale, state.view.top - own.top * scale);
      context.imageSmoothingQuality = "high";
      context.drawImage(picture, 0, 0);
    }
    context.restore();
    stale = false;
  }

  // A context in the plan's coordinates that paints inside of the canvas of the plan only; to be restored.
  function inPlan(canvas, view, cleared = false) {
    const context = canvas.getContext("2d", { willReadFrequently: canvas !== screen });
    context.save();
    if (cleared) context.clearRect(0, 0, canvas.width, canvas.height);
    context.setTransform(view.scale, 0, 0, view.scale, view.left, view.top);
    context.beginPath();
    context.rect(0, 0, plan.width, plan.height);
    context.clip();
    return context;
  }

  return { state, visible, resize, setView, seek, showLayer, frame };
}

function newCanvas() {
  return document.createElement("canvas");
}

function copy(from, to) {
  to.width = from.width;
  to.height = from.height;
  to.getContext("2d", { willReadFrequently: true }).drawImage(from, 0, 0);
}
