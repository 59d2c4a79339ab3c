// From the plan to the canvas's own pixels: x · scale + left, y · scale + top.

const SHARPEST = 48; // largest scale: so many pixels of the screen for a unit of the plan
const CLOSEST = 16; // or so many times the picture that fits, if that is more
const MARGIN = 0.04; // of the smaller side, around a picture that fits

// The whole picture, a whole number of pixels wide, its corner on a pixel.
function fitted(plan, width, height) {
  const room = 1 - 2 * MARGIN * Math.min(width, height) / Math.max(width, height);
  const largest = Math.min((width * room) / plan.width, (height * room) / plan.height);
  const scale = Math.max(Math.floor(largest * plan.width), 1) / plan.width;
  return { scale, left: Math.round((width - plan.width * scale) / 2), top: Math.round((height - plan.height * scale) / 2) };
}

// `view` enlarged `factor` times about the pixel (x, y).
function zoomed(view, factor, x, y, plan, width, height) {
  const fit = fitted(plan, width, height);
  const most = Math.max(fit.scale * CLOSEST, SHARPEST);
  const scale = Math.min(Math.max(view.scale * factor, fit.scale), most);
  if (scale === fit.scale) return fit;
  const ratio = scale / view.scale;
  return within({ scale, left: x - (x - view.left) * ratio, top: y - (y - view.top) * ratio }, plan, width, height);
}

function panned(view, dx, dy, plan, width, height) {
  return within({ ...view, left: view.left + dx, top: view.top + dy }, plan, width, height);
}

// A side that is longer than the stage covers it, a shorter one stands in its middle.
function within(view, plan, width, height) {
  const side = (start, length, stage) => {
    const margin = MARGIN * Math.min(width, height);
    if (length + 2 * margin <= stage) return Math.round((stage - length) / 2);
    return Math.min(Math.max(start, stage - length - margin), margin);
  };
  return {
    scale: view.scale,
    left: side(view.left, plan.width * view.scale, width),
    top: side(view.top, plan.height * view.scale, height),
  };
}

function toPlan(view, x, y) {
  return [(x - view.left) / view.scale, (y - view.top) / view.scale];
}
