// The scene: static and moving traces of the bodies and their arrows.

const RECORDED = "#737373";
const VISIBLE = 2; // plotly's units between the lower and the upper edge of the scene
const LABEL_SPACE = narrow ? { across: 130, along: 130 } : { across: 115, along: 90 }; // [px] space for the labels of the axes
/** Whether the scene has a legend of its paths. */
const listed = data.kind === "path" && (bodies.length > 1 || data.recorded !== null);

// The initial view direction: from above, and from the side from which the scene looks largest.
const HEIGHT_OF_EYE = 1.3,
  DISTANCE_OF_EYE = 1.33;
const SIDES_SEEN = [-105, -120, -135, -150, -165, -75, -60, -45, -30, -15]; // [°]; not along an axis, where depth is not visible
const extentOf = () => space.range.map(([low, high]) => high - low);
const eyeAt = (degrees) => {
  const turn = (degrees * Math.PI) / 180;
  return [DISTANCE_OF_EYE * Math.cos(turn), DISTANCE_OF_EYE * Math.sin(turn), HEIGHT_OF_EYE];
};
const rightOf = (eye) => unit(cross([0, 0, 1], eye));
const upOf = (eye) => unit(cross(eye, rightOf(eye)));
const EYE = data.kind === "attitude" ? [-0.75, -1.1, 1.3] : bestEye();
const RIGHT = rightOf(EYE);
const UP = upOf(EYE);

function bestEye() {
  const eyes = SIDES_SEEN.map(eyeAt);
  const zooms = eyes.map((eye) => zoom(extentOf(), rightOf(eye), upOf(eye)));
  return eyes[zooms.findIndex((z) => z >= 0.98 * Math.max(...zooms))]; // the first direction within 2 % of the best
}

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
  const traces = [line3d(rows, { line: { color: "#d3dae1", width: 1.5 }, showlegend: false })];
  "XYZ".split("").forEach((letter, k) => {
    const end = [0, 0, 0];
    end[k] = 1.12;
    traces.push(
      line3d([[0, 0, 0], end], {
        mode: "lines+text",
        text: ["", letter],
        textposition: "top center",
        textfont: { size: 13, color: "#5c6b7a" },
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
        line: { color: arrow.colour, width: 3 },
        opacity: 0.55,
        showlegend: false,
      },
    ),
  );
}

function still() {
  if (data.kind === "attitude") return sphere().concat(tipTraces(bodies[state.looked]));
  const traces = bodies.map((body) =>
    line3d(body.position, {
      name: text(body.name),
      line: { color: body.colour, width: 5, dash: body.dash },
      hoverinfo: "name",
    }),
  );
  if (data.recorded) {
    traces.unshift(
      line3d(data.recorded, { name: "recorded", mode: "markers", marker: { size: 1.8, color: RECORDED } }),
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
    const place = { text: ["<b>" + name + "</b>"], textposition: upper ? "top center" : "bottom center" };
    traces.push(line3d([body.position[k]], { mode: "text", showlegend: false, ...place }));
  });
  return traces;
}

const LETTER = { width: 9, height: 17 }; // [px] of the labels of arrows
const POSITIONS = [
  ["middle right", 1, 0],
  ["top right", 1, 1],
  ["top center", 0, 1],
  ["top left", -1, 1],
  ["middle left", -1, 0],
  ["bottom left", -1, -1],
  ["bottom center", 0, -1],
  ["bottom right", 1, -1],
];
const INWARDS = 40; // [px²] overlap that is accepted to keep a label on the outer side of its tip

/** The positions of the labels relative to the tips in the current view: outwards, and without overlap. */
function letterPositions(origin, tips) {
  const { eye } = byId("space").layout?.scene?.camera ?? {};
  const seen = eye ? [eye.x, eye.y, eye.z] : EYE;
  const scale = (zoom(extentOf()) * byId("space").clientHeight) / VISIBLE; // [px/m]
  const flat = (v) => [dot(v, rightOf(seen)) * scale, dot(v, upOf(seen)) * scale];
  const choices = tips.map((tip, k) => {
    const [x, y] = flat(tip),
      [along, across] = flat(plus(tip, origin, -1));
    const wide = LETTER.width * arrows[k].symbol.length;
    const distance = Math.hypot(along, across) || 1;
    return POSITIONS.map(([name, a, b]) => {
      const cosine = (a * along + b * across) / (distance * Math.hypot(a, b));
      return { name, x: x + (a * wide) / 2, y: y + (b * LETTER.height) / 2, wide, cost: INWARDS * (1 - cosine) };
    });
  });
  let best = { cost: Infinity, labels: [] };
  const extend = (labels, cost) => {
    if (cost >= best.cost) return;
    if (labels.length === choices.length) best = { cost, labels };
    else choices[labels.length].forEach((c) => extend([...labels, c], cost + c.cost + overlap(c, labels)));
  };
  extend([], 0);
  return best.labels.map((label) => label.name);
}

/** The area [px²] in which a label overlaps others. */
function overlap(label, others) {
  const shared = (distance, size) => Math.max(0, size - Math.abs(distance));
  return others.reduce(
    (sum, other) =>
      sum + shared(label.x - other.x, (label.wide + other.wide) / 2) * shared(label.y - other.y, LETTER.height),
    0,
  );
}

/** The traces that change with time, in this order: arrows, their letters, and dots and pale axes of other bodies. */
function moving() {
  const { origin, axes } = pose(bodies[state.looked], state.time);
  const updates = arrows.map((arrow, k) => arrowPoints(origin, axes === null ? null : axes[k], space.length));
  const tips = axes === null ? [] : axes.map((axis) => plus(origin, axis, 1.13 * space.length));
  const positions = axes === null ? [] : letterPositions(origin, tips);
  updates.push({ x: column(tips, 0), y: column(tips, 1), z: column(tips, 2), textposition: positions });
  const dots = [],
    thin = arrows.map(() => []);
  bodies.forEach((body, k) => {
    const at = pose(body, state.time);
    dots.push(body.position !== null && finite(at.origin) ? at.origin : [null, null, null]);
    if (body.ghost && k !== state.looked && at.axes !== null) {
      at.axes.forEach((axis, n) => thin[n].push(at.origin, plus(at.origin, axis, space.length)));
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
        color: arrow.colour,
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
        textfont: { size: 15, color: arrows.map((arrow) => arrow.colour) },
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
        marker: { size: 5, color: bodies.map((body) => body.colour), line: { color: "#1c2733", width: 1.5 } },
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
          line: { color: arrow.colour, width: 6 },
        },
        updates[n + 2 + k],
      ),
    ),
  );
  return traces;
}

/** The scale at which the axes fill the initial view, with space for labels; a sphere stays round. */
function zoom(extent, right = RIGHT, up = UP) {
  const { clientWidth: width, clientHeight: height } = byId("space");
  const seen = (side) =>
    data.kind === "attitude" ? extent[0] : extent.reduce((sum, size, k) => sum + size * Math.abs(side[k]), 0);
  return (VISIBLE / height) * Math.min((width - LABEL_SPACE.across) / seen(right), (height - LABEL_SPACE.along) / seen(up));
}

/** The label of a world axis, with the offset of the common centre. */
function titleOf(letter, k) {
  const offset = space.centre[k];
  return letter + (offset === 0 ? "" : offset > 0 ? " − " + offset : " + " + -offset) + " [m]";
}

function spaceLayout() {
  const attitude = data.kind === "attitude";
  const extent = extentOf();
  const [wide, deep, high] = extent.map((size) => zoom(extent) * size);
  const axis = (letter, k) => {
    if (attitude) return { visible: false, range: space.range[k] };
    return {
      title: { text: titleOf(letter, k) },
      range: space.range[k],
      nticks: Math.max(2, Math.round((6 * extent[k]) / Math.max(...extent))),
      tickangle: 0, // if rotated along the axis, long numbers would overlap its title
      tickfont: { size: 11 },
      gridcolor: "#e6ebf0",
      zerolinecolor: "#c9d2da",
      showspikes: false,
      showbackground: false, // a background would hide parts of the labels
    };
  };
  return {
    font: FONT,
    margin: { l: 0, r: 0, t: 0, b: 0 },
    uirevision: "space",
    paper_bgcolor: "#fff",
    legend: { x: 0.01, y: 0.99, yanchor: "top", itemsizing: "constant", bgcolor: "rgba(255,255,255,0.8)" },
    showlegend: listed,
    modebar: { orientation: "v", bgcolor: "rgba(255,255,255,0)", color: "#5b6b7a", activecolor: "#0072b2" },
    scene: {
      aspectmode: "manual",
      aspectratio: { x: wide, y: deep, z: high },
      xaxis: axis("x", 0),
      yaxis: axis("y", 1),
      zaxis: axis("z", 2),
      camera: { eye: { x: EYE[0], y: EYE[1], z: EYE[2] }, up: { x: 0, y: 0, z: 1 }, projection: { type: "orthographic" } },
    },
  };
}

let movers = [];
function drawSpace() {
  const fixed = still(),
    traces = movingTraces();
  movers = traces.map((_, k) => fixed.length + k);
  return Plotly.react(byId("space"), fixed.concat(traces), spaceLayout(), {
    responsive: true,
    displaylogo: false,
    showSendToCloud: false, // the page is private
    modeBarButtonsToRemove: ["resetCameraLastSave3d", "hoverClosest3d"],
  });
}

function moveSpace() {
  const updates = moving();
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
