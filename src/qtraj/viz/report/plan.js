// The plan view: the paths from above, with equal axis scales, and the position and direction of each body.

const planned = data.kind === "path";

function planStill() {
  const traces = [];
  if (data.recorded) {
    traces.push({
      type: "scatter",
      mode: "markers",
      name: "recorded",
      x: column(data.recorded, 0),
      y: column(data.recorded, 1),
      marker: { size: 3, color: RECORDED },
      hoverinfo: "skip",
    });
  }
  for (const body of bodies) {
    traces.push({
      type: "scatter",
      mode: "lines",
      name: text(body.name),
      x: column(body.position, 0),
      y: column(body.position, 1),
      customdata: body.time,
      line: { color: readable(body.colour), width: 2.2, dash: body.dash, simplify: false },
      hoverinfo: "name",
    });
  }
  return traces.concat(curvatureTraces());
}

const COLOURS = ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"];

/** A single path coloured by curvature: one line with gaps for each colour, because many markers are slow. */
function curvatureTraces() {
  if (!data.colours) return [];
  const [body] = bodies,
    { values, top } = data.colours;
  const colourAt = (k) => Math.min(COLOURS.length - 1, Math.floor((COLOURS.length * values[k]) / top));
  const lines = COLOURS.map(() => ({ x: [], y: [], time: [] }));
  for (let k = 0; k + 1 < values.length; k++) {
    const line = lines[colourAt(k)];
    if (line.time[line.time.length - 1] !== body.time[k]) add(line, null, null, null);
    if (line.x[line.x.length - 1] === null) add(line, body.position[k][0], body.position[k][1], body.time[k]);
    add(line, body.position[k + 1][0], body.position[k + 1][1], body.time[k + 1]);
  }
  byId("colours").textContent = `; colour: curvature, dark for 0, bright from ${top.toPrecision(2)} 1/m`;
  return lines.map(({ x, y, time }, k) => ({
    type: "scatter",
    mode: "lines",
    name: "curvature " + k,
    x,
    y,
    customdata: time,
    line: { color: COLOURS[k], width: 3, simplify: false },
    hoverinfo: "skip",
  }));
}

function add(line, x, y, time) {
  line.x.push(x);
  line.y.push(y);
  line.time.push(time);
}

/** The axes of the selected body, seen from above, and a dot for each body. */
function planMoving() {
  const { origin, axes } = pose(bodies[state.looked], state.time);
  const updates = arrows.map((_, k) => {
    if (axes === null) return { x: [], y: [] };
    const tip = plus(origin, axes[k], planLength());
    return { x: [origin[0], tip[0]], y: [origin[1], tip[1]] };
  });
  const dots = bodies.map((body) => pose(body, state.time).origin).map((at) => (finite(at) ? at : [null, null, null]));
  updates.push({ x: column(dots, 0), y: column(dots, 1) });
  return updates;
}

let planMovers = [];
function drawPlan() {
  byId("planview").hidden = !planned;
  document.querySelector(".views").classList.toggle("single", !planned);
  if (!planned) return;
  const fixed = planStill(),
    updates = planMoving();
  const lines = arrows.map((arrow, k) =>
    Object.assign(
      { type: "scatter", mode: "lines", name: "axis " + text(arrow.symbol), hoverinfo: "skip", line: { color: readable(arrow.colour), width: 3 } },
      updates[k],
    ),
  );
  const dots = Object.assign(
    {
      type: "scatter",
      mode: "markers",
      name: "now",
      hoverinfo: "skip",
      marker: { size: 8, color: bodies.map((body) => body.colour), line: { color: scheme.ink, width: 1.2 } },
    },
    updates[arrows.length],
  );
  const first = planMovers.length === 0;
  planMovers = updates.map((_, k) => fixed.length + k);
  const axis = (k) => ({
    title: { text: titleOf("xy"[k], k), standoff: 4 },
    range: byId("plan").layout?.["xy"[k] + "axis"].range ?? space.plan[k], // a redrawn plan keeps its magnification
    nticks: 5,
    tickfont: { size: 10.5 },
    automargin: true,
  });
  Plotly.react(
    byId("plan"),
    [...fixed, ...lines, dots],
    {
      font: font(),
      uirevision: "plan",
      margin: { l: 46, r: 8, t: 6, b: 36 },
      showlegend: false,
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      xaxis: axis(0),
      yaxis: Object.assign({ scaleanchor: "x", scaleratio: 1 }, axis(1)),
    },
    { responsive: true, displayModeBar: false },
  );
  if (!first) return;
  byId("plan").on("plotly_click", ({ points }) => points[0].customdata !== undefined && setTime(points[0].customdata));
  byId("plan").on("plotly_relayout", movePlan); // the arrows keep their size
}

const PLAN_ARROW = 46; // [px]

/** The length [m] of the arrows in the plan, which have the same size on the screen at any magnification. */
function planLength() {
  const axis = byId("plan")._fullLayout?.xaxis;
  return axis?._length > 0 ? (PLAN_ARROW * Math.abs(axis.range[1] - axis.range[0])) / axis._length : space.length;
}

/** Show the surroundings of a point in the plan, `reach` [m] on all sides. */
function zoomPlan([x, y], reach) {
  if (!planned) return undefined;
  const ranges = { "xaxis.range": [x - reach, x + reach], "yaxis.range": [y - reach, y + reach] };
  return Plotly.relayout(byId("plan"), ranges);
}

function movePlan() {
  if (!planned) return undefined;
  const updates = planMoving();
  return Plotly.restyle(byId("plan"), { x: updates.map((u) => u.x), y: updates.map((u) => u.y) }, planMovers);
}
