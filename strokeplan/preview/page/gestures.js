// Mouse, pen and fingers on the stage: drag pans, wheel and pinch zoom, a double click or tap zooms in and out, a
// tap picks a stroke. Positions are in the canvas's own pixels.

const TAP_MOVE_PX = 8;
const TAP_MS = 350;
const DOUBLE_ZOOM = 3;

function listenToGestures(element, { zoomBy, panBy, toggleZoom, hover, pick }) {
  const pointers = new Map();
  let moved = 0, lastTap = null, downAt = 0, most = 0;
  const ratio = () => window.devicePixelRatio || 1;
  const place = (event) => {
    const box = element.getBoundingClientRect();
    return [(event.clientX - box.left) * ratio(), (event.clientY - box.top) * ratio()];
  };
  const spread = () => {
    const [[ax, ay], [bx, by]] = [...pointers.values()];
    return { x: (ax + bx) / 2, y: (ay + by) / 2, apart: Math.hypot(ax - bx, ay - by) };
  };

  element.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    element.setPointerCapture(event.pointerId);
    if (!pointers.size) [moved, downAt, most] = [0, event.timeStamp, 0];
    pointers.set(event.pointerId, place(event));
    most = Math.max(most, pointers.size);
  });

  element.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    const before = pointers.get(event.pointerId);
    if (!before) return hover(x, y);
    const apart = pointers.size === 2 ? spread() : null;
    pointers.set(event.pointerId, [x, y]);
    moved += Math.hypot(x - before[0], y - before[1]);
    if (moved < TAP_MOVE_PX * ratio() && pointers.size === 1) return;
    if (pointers.size === 1) return panBy(x - before[0], y - before[1]);
    if (apart) {
      const now = spread();
      panBy(now.x - apart.x, now.y - apart.y);
      zoomBy(now.apart / Math.max(apart.apart, 1), now.x, now.y);
    }
  });

  element.addEventListener("pointerup", (event) => {
    const [x, y] = place(event);
    pointers.delete(event.pointerId);
    if (pointers.size || most > 1 || moved > TAP_MOVE_PX * ratio() || event.timeStamp - downAt > 2 * TAP_MS) return;
    if (lastTap && event.timeStamp - lastTap.at < TAP_MS && Math.hypot(x - lastTap.x, y - lastTap.y) < 24 * ratio()) {
      lastTap = null;
      return toggleZoom(DOUBLE_ZOOM, x, y);
    }
    lastTap = { at: event.timeStamp, x, y };
    pick(x, y);
  });

  element.addEventListener("pointercancel", (event) => pointers.delete(event.pointerId));
  element.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && !pointers.size && hover(null));
  element.addEventListener("wheel", (event) => {
    event.preventDefault();
    const unit = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    zoomBy(Math.exp(-event.deltaY * unit * (event.ctrlKey ? 0.01 : 0.0016)), ...place(event));
  }, { passive: false });
}
