// The scene without WebGL: the same view, drawn flat. Lines and texts are projected, arrows become lines.
const WEBGL = (() => {
  const canvas = document.createElement("canvas");
  return Boolean(canvas.getContext("webgl") ?? canvas.getContext("experimental-webgl"));
})();

/** Points of a trace in the plane of the view, to the right and up. */
function flattened({ x, y, z }) {
  const at = (side) => x.map((_, k) => (x[k] === null ? null : dot([x[k], y[k], z[k]], side)));
  return { x: at(RIGHT), y: at(UP) };
}

/** The middle of the end faces of an arrow: the first and the last ring of its surface. */
function axisOf({ x, y, z }) {
  const ends = [0, x.length - 1].filter((k) => k >= 0 && x.length > 0);
  return { x: ends.map((k) => x[k]), y: ends.map((k) => y[k]), z: ends.map((k) => z[k]) };
}

function flatTrace(trace) {
  const arrow = trace.type === "mesh3d";
  const { x, y, z, i, j, k, lighting, flatshading, color, ...style } = trace;
  const shaft = { mode: "lines", line: { color, width: 4 }, name: trace.name, showlegend: false };
  const kept = arrow ? shaft : { ...style, cliponaxis: false };
  const line = kept.line && { ...kept.line, width: Math.min(kept.line.width, 2.5) };
  return { ...kept, ...(line ? { line } : {}), ...flattened(arrow ? axisOf(trace) : trace), type: "scatter", hoverinfo: "skip" };
}

function drawFlat(fixed, traces) {
  document.body.classList.add("flat");
  const axis = { visible: false };
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => space.range.map((ends, n) => ends[(k >> n) & 1]));
  const round = [-1.3, 1.3]; // a sphere of radius 1, and letters
  const range = (side) => data.kind === "attitude" ? round : [Math.min, Math.max].map((end) => end(...corners.map((corner) => dot(corner, side))));
  const layout = {
    font: font(),
    margin: { l: 24, r: 24, t: 8, b: 8 },
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    legend: { x: 0.01, y: 0.99, yanchor: "top", itemsizing: "constant", bgcolor: "rgba(0,0,0,0)" },
    showlegend: listed,
    xaxis: { ...axis, range: range(RIGHT) },
    yaxis: { ...axis, range: range(UP), scaleanchor: "x", scaleratio: 1 },
  };
  const ground = data.kind === "path" ? [flatTrace(line3d(floor(), { line: { color: scheme.zero, width: 1 }, showlegend: false }))] : [];
  movers = traces.map((_, k) => ground.length + fixed.length + k);
  return Plotly.react(byId("space"), [...ground, ...fixed.concat(traces).map(flatTrace)], layout, {
    responsive: true,
    displayModeBar: false,
  });
}

/** The edges of the lower side of the axes. */
function floor() {
  const [[west, east], [south, north], [low]] = space.range;
  return [[west, south, low], [east, south, low], [east, north, low], [west, north, low], [west, south, low]];
}

function moveFlat(updates) {
  const flat = updates.map((update, k) => flattened(k < arrows.length ? axisOf(update) : update));
  return Plotly.restyle(
    byId("space"),
    { x: flat.map((u) => u.x), y: flat.map((u) => u.y), textposition: updates.map((u) => u.textposition) },
    movers,
  );
}
