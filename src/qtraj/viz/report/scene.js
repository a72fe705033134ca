// The scene: static and moving traces of the bodies and their arrows.

const RECORDED = "#9a9a9a";
const column = (rows, k) => rows.map((row) => (row === null ? null : row[k]));
const line3d = (rows, style) =>
  Object.assign(
    { type: "scatter3d", mode: "lines", x: column(rows, 0), y: column(rows, 1), z: column(rows, 2), hoverinfo: "skip" },
    style,
  );

function sphere() {
  const circle = [], // one trace with gaps between the circles, because each trace takes time to draw
    rows = [];
  for (let k = 0; k <= 72; k++) circle.push([Math.cos((k * Math.PI) / 36), Math.sin((k * Math.PI) / 36)]);
  for (const z of [-0.5, 0, 0.5]) {
    const r = Math.sqrt(1 - z * z);
    rows.push(...circle.map(([c, s]) => [r * c, r * s, z]), null);
  }
  for (let k = 0; k < 4; k++) {
    const [a, b] = [Math.cos((k * Math.PI) / 4), Math.sin((k * Math.PI) / 4)];
    rows.push(...circle.map(([c, s]) => [a * c, b * c, s]), null);
  }
  const traces = [line3d(rows, { line: { color: scheme.zero, width: 1.5 }, showlegend: false })];
  "XYZ".split("").forEach((letter, k) => {
    const end = [0, 0, 0];
    end[k] = 1.12;
    traces.push(
      line3d([[0, 0, 0], end], {
        mode: "lines+text",
        text: ["", letter],
        textposition: "top center",
        textfont: { size: 13, color: scheme.soft },
        line: { color: "#8995a1", width: 2.5 },
        showlegend: false,
      }),
    );
  });
  return traces;
}

function tipTraces(body) {
  return arrows.map((arrow, k) =>
    line3d(
      body.axes.map((row) => row.slice(3 * k, 3 * k + 3)),
      {
        name: "path of " + text(arrow.symbol),
        line: { color: readable(arrow.colour), width: 3 },
        opacity: 0.55,
        showlegend: false,
      },
    ),
  );
}

const BEHIND = 0.02; // of the largest extent of the axes

/** Points moved away from the viewer: without perspective they stay where they are, but are covered by the paths. */
function behind(points) {
  const away = plus([0, 0, 0], unit(eyeNow()), -BEHIND * Math.max(...extentOf()));
  return points.map((point) => plus(point, away, 1));
}

function still() {
  if (data.kind === "attitude") return sphere().concat(tipTraces(bodies[state.looked]));
  const traces = bodies.map((body) =>
    line3d(body.position, {
      name: text(body.name),
      line: { color: readable(body.colour), width: 5, dash: body.dash },
      hoverinfo: "name",
    }),
  );
  if (data.recorded) {
    traces.unshift(
      line3d(behind(data.recorded), { name: "recorded", mode: "markers", marker: { size: 1.5, color: RECORDED } }),
    );
  }
  const body = bodies[state.looked];
  const ends = [
    ["A", 0],
    ["B", body.position.length - 1],
  ].filter(([, k]) => finite(body.position[k]));
  const heights = ends.map(([, k]) => dot(body.position[k], UP));
  ends.forEach(([name, k], n) => {
    // The upper letter is above its end and the lower one below, so that they do not overlap if the ends coincide.
    const upper = heights.length > 1 && n === heights.indexOf(Math.max(...heights));
    const place = {
      text: ["<b>" + name + "</b>"],
      textposition: upper ? "top center" : "bottom center",
      textfont: { color: scheme.ink },
    };
    traces.push(line3d([body.position[k]], { mode: "text", showlegend: false, ...place }));
  });
  return traces;
}

/** The traces that change with time, in this order: arrows, their letters, and dots and pale axes of other bodies. */
function moving() {
  const { origin, axes } = pose(bodies[state.looked], state.time);
  const updates = arrows.map((arrow, k) => arrowPoints(origin, axes === null ? null : axes[k], arrowLength()));
  const tips = axes === null ? [] : axes.map((axis) => plus(origin, axis, 1.13 * arrowLength()));
  const positions = axes === null ? [] : letterPositions(origin, tips);
  updates.push({ x: column(tips, 0), y: column(tips, 1), z: column(tips, 2), textposition: positions });
  const dots = [],
    thin = arrows.map(() => []);
  bodies.forEach((body, k) => {
    const at = pose(body, state.time);
    dots.push(body.position !== null && finite(at.origin) ? at.origin : [null, null, null]);
    if (body.ghost && k !== state.looked && at.axes !== null) {
      at.axes.forEach((axis, n) => thin[n].push(at.origin, plus(at.origin, axis, arrowLength())));
    }
  });
  for (const rows of [dots, ...thin]) updates.push({ x: column(rows, 0), y: column(rows, 1), z: column(rows, 2) });
  return updates;
}

function movingTraces() {
  const updates = moving();
  const light = { ambient: 0.88, diffuse: 0.35, specular: 0.05, roughness: 0.9 };
  const traces = arrows.map((arrow, k) =>
    Object.assign(
      {
        type: "mesh3d",
        name: "axis " + text(arrow.symbol),
        color: readable(arrow.colour),
        flatshading: false,
        lighting: light,
        hoverinfo: "skip",
        showlegend: false,
      },
      FACES,
      updates[k],
    ),
  );
  const n = arrows.length;
  traces.push(
    Object.assign(
      {
        type: "scatter3d",
        mode: "text",
        text: arrows.map((arrow) => "<b>" + text(arrow.symbol) + "</b>"),
        textfont: { size: 15, color: arrows.map((arrow) => readable(arrow.colour)) },
        hoverinfo: "skip",
        showlegend: false,
      },
      updates[n],
    ),
  );
  traces.push(
    Object.assign(
      {
        type: "scatter3d",
        mode: "markers",
        hoverinfo: "skip",
        showlegend: false,
        marker: { size: 5, color: bodies.map((body) => body.colour), line: { color: scheme.ink, width: 1.5 } },
      },
      updates[n + 1],
    ),
  );
  arrows.forEach((arrow, k) =>
    traces.push(
      Object.assign(
        {
          type: "scatter3d",
          mode: "lines",
          hoverinfo: "skip",
          opacity: 0.8,
          showlegend: false,
          line: { color: readable(arrow.colour), width: 6 },
        },
        updates[n + 2 + k],
      ),
    ),
  );
  return traces;
}

let movers = [];
function drawSpace() {
  const fixed = still(),
    traces = movingTraces();
  movers = traces.map((_, k) => fixed.length + k);
  if (!WEBGL) return drawFlat(fixed, traces);
  const first = byId("space").data === undefined;
  const drawn = Plotly.react(byId("space"), fixed.concat(traces), spaceLayout(), {
    responsive: true,
    displaylogo: false,
    showSendToCloud: false, // the page is private
    modeBarButtonsToRemove: ["resetCameraLastSave3d", "hoverClosest3d"],
  });
  if (first) ["plotly_relayout", "plotly_relayouting"].forEach((event) => byId("space").on(event, viewed));
  return drawn;
}

/** After a rotation or a zoom: the recorded points stay behind the paths, and the arrows keep their size. */
function viewed() {
  if (data.recorded && data.kind === "path") {
    const [x, y, z] = [0, 1, 2].map((k) => [column(behind(data.recorded), k)]);
    Plotly.restyle(byId("space"), { x, y, z }, [0]);
  }
  show();
}

function moveSpace() {
  const updates = moving();
  if (!WEBGL) return moveFlat(updates);
  return Plotly.restyle(
    byId("space"),
    {
      x: updates.map((u) => u.x),
      y: updates.map((u) => u.y),
      z: updates.map((u) => u.z),
      textposition: updates.map((u) => u.textposition),
    },
    movers,
  );
}
