// Panels over time, their legends and cursors, and the values at the current instant.
const shown = (series) => !series.follows || series.body === state.looked;
const plots = [];

function drawPanels() {
  for (const panel of panels) {
    const box = document.createElement("div"),
      heading = document.createElement("h2");
    const units = document.createElement("span"),
      plot = document.createElement("div"),
      cursor = document.createElement("div");
    const head = document.createElement("div"),
      key = document.createElement("ul");
    box.className = "panel";
    head.className = "head";
    key.className = "legend";
    plot.className = "plot";
    cursor.className = "cursor";
    heading.textContent = panel.title + " ";
    units.textContent = "[" + panel.unit + "]";
    heading.append(units);
    head.append(heading, key);
    box.append(head, plot, cursor);
    byId("panels").append(box);
    const traces = panel.series.map((series) => ({
      type: "scatter",
      mode: "lines",
      name: text(series.name),
      x: bodies[series.body].time,
      y: series.values,
      visible: shown(series),
      connectgaps: false,
      line: { color: series.colour, width: series.width, dash: series.dash, simplify: false },
      hovertemplate: "%{y:.6g} at %{x:.4g} s<extra>%{fullData.name}</extra>",
    }));
    panel.limits
      .filter((limit) => limit.drawn)
      .forEach((limit) =>
        traces.push({
          type: "scatter",
          mode: "lines",
          name: text(limit.text),
          x: [start, duration],
          y: [limit.value, limit.value],
          hoverinfo: "skip",
          line: LIMIT,
        }),
      );
    const drawn = panel.series.some((series) => series.values.some((value) => value !== null));
    Plotly.newPlot(plot, traces, panelLayout(panel, drawn), { displayModeBar: false });
    plot.on("plotly_relayout", (change) => follow(plot, change));
    plot.on("plotly_click", (event) => setTime(event.points[0].x));
    plots.push({ panel, plot, cursor, key });
    drawKey(panel, key);
  }
}

const LIMIT = { color: "#1c2733", width: 1.3, dash: "dot" };
const STROKES = { solid: "", dash: "6 4", dashdot: "7 3 2 3", dot: "2 3" };

/** The legend of a panel: each visible line once. */
function drawKey(panel, key) {
  const lines = panel.series
    .filter((series) => series.listed && shown(series))
    .map((series) => [series.name, series.colour, series.dash, series.width]);
  panel.limits
    .slice(0, 1)
    .forEach((limit) =>
      lines.push([limit.text + (limit.drawn ? "" : ", outside the axis range"), LIMIT.color, LIMIT.dash, LIMIT.width]),
    );
  const more = panel.note ? [document.createElement("li")] : [];
  if (panel.note) more[0].textContent = panel.note;
  key.replaceChildren(
    ...(lines.length < 2 ? [] : lines).map(([name, colour, dash, width]) => {
      const item = document.createElement("li"),
        svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      const stroke = document.createElementNS(svg.namespaceURI, "line");
      svg.setAttribute("width", 24);
      svg.setAttribute("height", 8);
      svg.setAttribute("aria-hidden", "true");
      const marks = {
        x1: 0,
        x2: 24,
        y1: 4,
        y2: 4,
        stroke: colour,
        "stroke-width": width,
        "stroke-dasharray": STROKES[dash],
      };
      for (const [mark, value] of Object.entries(marks)) stroke.setAttribute(mark, value);
      svg.append(stroke);
      item.append(svg, " " + name);
      return item;
    }),
    ...more,
  );
}

function panelLayout(panel, drawn) {
  const axis = {
    gridcolor: "#e6ebf0",
    zerolinecolor: "#c9d2da",
    linecolor: "#b9c4ce",
    ticks: "outside",
    tickcolor: "#b9c4ce",
  };
  const note = drawn
    ? []
    : [{ text: "no data", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5 }];
  return {
    font: FONT,
    margin: MARGIN,
    hovermode: "x",
    showlegend: false,
    paper_bgcolor: "#fff",
    plot_bgcolor: "#fff",
    annotations: note,
    xaxis: Object.assign({ range: state.range.slice(), title: { text: "time [s]", standoff: 2 } }, axis),
    yaxis: Object.assign(
      {
        type: panel.logarithmic ? "log" : "linear",
        exponentformat: panel.logarithmic ? "e" : "power",
        nticks: 5,
        range: panel.range ?? undefined,
        rangemode: panel.logarithmic ? "normal" : levelled(panel) ? "tozero" : "normal",
      },
      axis,
    ),
  };
}

/** Whether the axis includes zero: if the smallest value is less than half the largest, or all values are equal. */
function levelled(panel) {
  const values = panel.series.flatMap((series) => series.values).filter((value) => value !== null);
  const low = values.reduce((a, b) => Math.min(a, b), Infinity),
    high = values.reduce((a, b) => Math.max(a, b), -Infinity);
  return low >= 0 && (low < 0.5 * high || high - low < 1e-6 * high);
}

/** Zoom all panels when one is zoomed. */
function follow(source, change) {
  let range = null;
  if ("xaxis.range[0]" in change) range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
  else if ("xaxis.range" in change) range = change["xaxis.range"].slice();
  else if (change["xaxis.autorange"]) range = [start, duration];
  if (range === null || (range[0] === state.range[0] && range[1] === state.range[1])) return;
  state.range = range;
  for (const { plot } of plots) {
    if (plot !== source || change["xaxis.autorange"]) Plotly.relayout(plot, { "xaxis.range": range.slice() });
  }
  moveCursors();
}

/** Fit the width of the panels, even if a scroll bar appears. */
function refit() {
  Promise.all(plots.map(({ plot }) => Plotly.Plots.resize(plot))).then(moveCursors);
}

function moveCursors() {
  const [low, high] = state.range;
  for (const { plot, cursor } of plots) {
    const width = plot.clientWidth - MARGIN.l - MARGIN.r;
    const at = high > low ? (state.time - low) / (high - low) : 0;
    cursor.hidden = at < -1e-9 || at > 1 + 1e-9;
    cursor.style.left = plot.offsetLeft + MARGIN.l + at * width - 1 + "px";
    cursor.style.top = plot.offsetTop + MARGIN.t + "px";
    cursor.style.height = plot.clientHeight - MARGIN.t - MARGIN.b + "px";
  }
}

// values at the current instant
function number(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value),
    written =
      size !== 0 && (size < 1e-4 || size >= 1e7) ? value.toExponential(3) : String(Number(value.toPrecision(5)));
  return written.replace(/-/g, "−");
}

const cells = [];
function drawNow() {
  for (const panel of panels) {
    const row = byId("now").tBodies[0].insertRow();
    row.insertCell().textContent = panel.title;
    cells.push(row.insertCell());
  }
}

function showNow() {
  panels.forEach((panel, k) => {
    const parts = panel.series.filter((series) => shown(series) && (series.follows || series.body === state.looked));
    const values = parts
      .filter((series) => !series.reference)
      .map((series) => [between(series.values, place(bodies[series.body].time, state.time)), series.offset])
      .map(([value, offset]) => number(value === null || value === undefined ? value : value + offset));
    const units = panel.unit === "–" ? "" : " " + panel.unit;
    cells[k].textContent = values.length > 1 ? "(" + values.join(", ") + ")" + units : values.join("") + units;
  });
  const body = bodies[state.looked],
    notes = [];
  if (pose(body, state.time).axes === null) notes.push("the axes are not defined at this instant");
  if (state.time > body.time[body.time.length - 1]) notes.push("this path has ended");
  byId("state").textContent = notes.join("; ");
  const digits = duration > 1000 ? 0 : duration > 100 ? 1 : duration > 1 ? 2 : 4;
  byId("clock").value = "t = " + state.time.toFixed(digits) + " s of " + duration.toFixed(digits) + " s";
}
