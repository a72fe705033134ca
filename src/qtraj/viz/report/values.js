// The values at the current instant.
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
    const own = (series) => series.follows || panel.along || series.body === state.looked;
    const parts = panel.series.filter((series) => shown(series) && own(series));
    const values = parts
      .filter((series) => !series.reference)
      .map((series) => number(between(series.values, place(bodies[series.body].time, state.time))));
    const units = panel.unit === "–" ? "" : " " + panel.unit;
    cells[k].textContent = values.length > 1 ? "(" + values.join(", ") + ")" + units : values.join("") + units;
  });
  const body = bodies[state.looked],
    notes = [];
  if (pose(body, state.time).axes === null) notes.push("The axes are not defined at this instant.");
  if (state.time > body.time[body.time.length - 1]) notes.push("This path has ended.");
  byId("state").textContent = notes.join(" ");
  const digits = duration > 1000 ? 0 : duration > 100 ? 1 : duration > 1 ? 2 : 4;
  const reading = state.time.toFixed(digits) + " s of " + duration.toFixed(digits) + " s";
  byId("clock").value = "t = " + reading;
  byId("slider").setAttribute("aria-valuetext", reading);
}
