// Shared by all parts of the page: the data, the state, and the pose of a body at an instant.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const { bodies, panels, arrows, space } = data;
const duration = Math.max(...bodies.map((body) => body.time[body.time.length - 1]), 0);
const start = Math.min(...bodies.map((body) => body.time[0]));
const narrow = window.innerWidth < 600;
const MARGIN = { l: narrow ? 62 : 80, r: narrow ? 8 : 14, t: 8, b: 38 };
const SIDES = 12;
const state = { time: start, looked: lastReal(), playing: false, before: 0, range: [start, duration] };

function lastReal() {
  let selected = 0;
  bodies.forEach((body, k) => {
    if (!body.ghost) selected = k;
  });
  return selected;
}

// Plotly interprets markup in strings, so names from the input are escaped.
const text = (name) => String(name).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

// vectors
const plus = (a, b, s) => a.map((x, k) => x + s * b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => {
  const n = Math.sqrt(dot(a, a));
  return n > 0 ? a.map((x) => x / n) : null;
};
const finite = (a) => a !== null && a.every((x) => x !== null && Number.isFinite(x));

// a body at an instant
/** Index k and fraction f of an instant between samples k and k + 1, clamped to the ends. */
function place(times, t) {
  const last = times.length - 1;
  if (last < 1 || t <= times[0]) return [0, 0];
  if (t >= times[last]) return [last, 0];
  let low = 0,
    high = last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return [low, (t - times[low]) / (times[high] - times[low])];
}

function between(rows, [k, f]) {
  if (f === 0) return rows[k];
  const a = rows[k],
    b = rows[k + 1];
  if (a === null || b === null) return null;
  if (typeof a === "number") return a + f * (b - a);
  return finite(a) && finite(b) ? a.map((x, i) => x + f * (b[i] - x)) : null;
}

/** Origin and axes of a body; the axes are null if they are not defined. */
function pose(body, t) {
  const at = place(body.time, t);
  const origin = body.position === null ? [0, 0, 0] : between(body.position, at);
  const rows = between(body.axes, at);
  if (!finite(origin) || rows === null || !finite(rows)) return { origin, axes: null };
  const axes = [0, 3, 6].map((k) => unit(rows.slice(k, k + 3)));
  return { origin, axes: axes.every((axis) => axis !== null) ? axes : null };
}
