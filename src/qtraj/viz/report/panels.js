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
      x: panel.along ? bodies[series.body].way : bodies[series.body].time,
      y: series.values,
      visible: shown(series),
      connectgaps: false,
      line: { color: readable(series.colour), width: series.width, dash: series.dash, simplify: false },
      hovertemplate: `%{y:.6g} at %{x:.4g} ${panel.along ? "m" : "s"}<extra>%{fullData.name}</extra>`,
    }));
    panel.limits
      .filter((limit) => limit.drawn)
      .forEach((limit) =>
        traces.push({
          type: "scatter",
          mode: "lines",
          name: text(limit.text),
          x: [start, duration].map((t) => across(panel, t)),
          y: [limit.value, limit.value],
          hoverinfo: "skip",
          line: limitLine(),
        }),
      );
    const drawn = panel.series.some((series) => series.values.some((value) => value !== null));
    Plotly.newPlot(plot, traces, panelLayout(panel, drawn), { displayModeBar: false });
    plot.on("plotly_relayout", (change) => follow(panel, plot, change));
    plot.on("plotly_click", (event) => setTime(instant(panel, event.points[0].x)));
    plots.push({ panel, plot, cursor, key });
    drawKey(panel, key);
  }
}

const limitLine = () => ({ color: scheme.ink, width: 1.3, dash: "dot" });
const STROKES = { solid: "", dash: "6 4", dashdot: "7 3 2 3", dot: "2 3" };

/** The legend of a panel: each visible line once. */
function drawKey(panel, key) {
  const lines = panel.series
    .filter((series) => series.listed && shown(series))
    .map((series) => [series.name, readable(series.colour), series.dash, series.width]);
  panel.limits
    .slice(0, 1)
    .map((limit) => ({ ...limit, line: limitLine() }))
    .forEach((limit) =>
      lines.push([limit.text + (limit.drawn ? "" : ", outside the axis range"), limit.line.color, limit.line.dash, limit.line.width]),
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

/** The position of an instant on the horizontal axis of a panel: the time, or the distance travelled until then. */
function across(panel, t) {
  if (!panel.along) return t;
  const body = bodies[panel.series[0].body];
  return between(body.way, place(body.time, t));
}

/** The instant at a position on the horizontal axis of a panel. */
function instant(panel, x) {
  if (!panel.along) return x;
  const body = bodies[panel.series[0].body];
  return between(body.time, place(body.way, x));
}

const rangeOf = (panel) => state.range.map((t) => across(panel, t));

function panelLayout(panel, drawn) {
  // The style sheet colours texts and grids, so that they follow the scheme.
  const axis = { linecolor: "#b9c4ce", ticks: "outside", tickcolor: "#b9c4ce" };
  const note = drawn
    ? []
    : [{ text: "no data", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5 }];
  const title = panel.along ? "distance travelled [m]" : "time [s]";
  return {
    font: font(),
    margin: MARGIN,
    hovermode: "x",
    showlegend: false,
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    annotations: note,
    xaxis: Object.assign({ range: rangeOf(panel), title: { text: title, standoff: 2 } }, axis),
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

/** Colour the lines and the legends of all panels for the scheme. */
function repaintPanels() {
  for (const { panel, plot, key } of plots) {
    const lines = panel.series.map((series) => readable(series.colour));
    const all = plot.data.map((_, k) => lines[k] ?? scheme.ink);
    Plotly.restyle(plot, { "line.color": all });
    drawKey(panel, key);
  }
}

/** Whether the axis includes zero: if the smallest value is less than half the largest, or all values are equal. */
function levelled(panel) {
  const values = panel.series.flatMap((series) => series.values).filter((value) => value !== null);
  const low = values.reduce((a, b) => Math.min(a, b), Infinity),
    high = values.reduce((a, b) => Math.max(a, b), -Infinity);
  return low >= 0 && (low < 0.5 * high || high - low < 1e-6 * high);
}

/** Zoom all panels when one is zoomed. */
function follow(zoomed, source, change) {
  let range = null;
  const back = (ends) => ends.map((x) => instant(zoomed, x));
  if ("xaxis.range[0]" in change) range = back([change["xaxis.range[0]"], change["xaxis.range[1]"]]);
  else if ("xaxis.range" in change) return; // set by this function
  else if (change["xaxis.autorange"]) range = [start, duration];
  if (range === null || (range[0] === state.range[0] && range[1] === state.range[1])) return;
  state.range = range;
  for (const { panel, plot } of plots) {
    if (plot !== source || change["xaxis.autorange"]) Plotly.relayout(plot, { "xaxis.range": rangeOf(panel) });
  }
  moveCursors();
}

/** Fit the width of the panels, even if a scroll bar appears. */
function refit() {
  Promise.all(plots.map(({ plot }) => Plotly.Plots.resize(plot))).then(moveCursors);
}

function moveCursors() {
  for (const { panel, plot, cursor } of plots) {
    const [low, high] = rangeOf(panel);
    const width = plot.clientWidth - MARGIN.l - MARGIN.r;
    const at = high > low ? (across(panel, state.time) - low) / (high - low) : 0;
    cursor.hidden = at < -1e-9 || at > 1 + 1e-9;
    cursor.style.left = plot.offsetLeft + MARGIN.l + at * width - 1 + "px";
    cursor.style.top = plot.offsetTop + MARGIN.t + "px";
    cursor.style.height = plot.clientHeight - MARGIN.t - MARGIN.b + "px";
  }
}
