// The clock and the controls; starts the page.
let busy = false;
async function show() {
  byId("slider").value = state.time;
  moveCursors();
  showNow();
  if (busy) return;
  busy = true;
  try {
    let drawn;
    do {
      drawn = [state.time, state.looked];
      await Promise.all([moveSpace(), movePlan()]);
    } while (drawn[0] !== state.time || drawn[1] !== state.looked);
  } finally {
    busy = false;
  }
}

function setTime(t) {
  state.time = Math.min(Math.max(Number(t), start), duration);
  return show();
}

function play(on) {
  state.playing = on && duration > start;
  byId("play").textContent = state.playing ? "Pause" : "Play";
  byId("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
  if (!state.playing) return;
  if (state.time >= duration) setTime(start);
  state.before = performance.now();
  requestAnimationFrame(tick);
}

function tick(now) {
  if (!state.playing) return;
  const step = (Math.max(now - state.before, 0) / 1000) * Number(byId("speed").value);
  state.before = Math.max(now, state.before);
  setTime(state.time + step);
  if (state.time >= duration) play(false);
  else requestAnimationFrame(tick);
}

function speeds() {
  const choices = [];
  for (let power = -3; power <= 5; power++) for (const digit of [1, 2, 5]) choices.push(digit * 10 ** power);
  const target = Math.max(duration - start, 1e-6) / 12;
  const best = choices.filter((choice) => choice <= Math.max(target, choices[0])).pop();
  const middle = choices.indexOf(duration - start > 2 && duration - start < 20 ? 1 : best);
  for (const choice of choices.slice(Math.max(middle - 3, 0), middle + 4)) {
    const rounded = Number(choice.toPrecision(1));
    byId("speed").add(new Option(rounded + " ×", String(rounded), false, choice === choices[middle]));
  }
}

function look(k) {
  state.looked = Number(k);
  for (const { panel, plot, key } of plots) {
    if (panel.series.some((series) => series.follows)) {
      Plotly.restyle(
        plot,
        { visible: panel.series.map(shown) },
        panel.series.map((_, n) => n),
      );
      drawKey(panel, key);
    }
  }
  drawSpace();
  drawPlan();
  show();
}

/** A round step of the slider, about a thousandth of the duration. */
function sliderStep() {
  const size = Math.max(duration - start, 1e-6) / 1000,
    power = 10 ** Math.floor(Math.log10(size));
  return Number((power * ([5, 2, 1].find((digit) => digit * power <= size * (1 + 1e-9)) ?? 1)).toPrecision(1));
}

/** The rows of a table that move the time, for example to a turn, whose surroundings the plan then shows. */
function jumps() {
  for (const button of document.querySelectorAll(".jump")) {
    button.addEventListener("click", () => {
      play(false);
      const times = JSON.parse(button.dataset.times);
      setTime(times[state.looked]);
      const { origin } = pose(bodies[state.looked], state.time);
      if (finite(origin)) zoomPlan(origin, Math.min(NEARBY, Math.max(...extentOf()) / 4));
    });
  }
}
const NEARBY = 60; // [m]

function controls() {
  const step = sliderStep();
  byId("slider").min = start;
  byId("slider").step = step;
  byId("slider").max = start + step * Math.ceil((duration - start) / step - 1e-9); // the end can be reached
  byId("slider").addEventListener("input", (event) => {
    play(false);
    setTime(event.target.value);
  });
  byId("play").addEventListener("click", () => play(!state.playing));
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || ["BUTTON", "SELECT"].includes(event.target.tagName)) return;
    event.preventDefault();
    play(!state.playing);
  });
  const real = bodies.map((body, k) => [body, k]).filter(([body]) => !body.ghost);
  real.forEach(([body, k]) => byId("body").add(new Option(body.name, String(k), false, k === state.looked)));
  byId("chooser").hidden = real.length < 2;
  byId("body").addEventListener("change", (event) => look(event.target.value));
  new ResizeObserver(() => requestAnimationFrame(refit)).observe(byId("panels"));
  byId("print").addEventListener("click", print);
  window.addEventListener("beforeprint", copySpace);
  window.addEventListener("afterprint", afterPrint);
}

function entry(colour, name, use) {
  const item = document.createElement("li"),
    swatch = document.createElement("i");
  swatch.style.background = readable(colour);
  item.className = use;
  item.append(swatch, name);
  byId("arrows").append(item);
}

function legend() {
  byId("arrows").replaceChildren();
  for (const { colour, symbol, meaning } of arrows) {
    entry(colour, symbol === meaning ? symbol : symbol + " (" + meaning + ")", "");
  }
  if (listed) {
    if (data.recorded) entry(RECORDED, "recorded", "paper");
    for (const body of bodies) entry(body.colour, body.name, "paper");
  }
  if (bodies.some((body) => body.ghost)) {
    const item = document.createElement("li");
    item.textContent =
      "Pale lines: " +
      bodies
        .filter((body) => body.ghost)
        .map((body) => body.name)
        .join(", ");
    byId("arrows").append(item);
  }
}

speeds();
controls();
jumps();
legend();
drawPanels();
drawNow();
drawPlan(); // first, because it reduces the width of the scene
drawSpace()
  .then(() => setTime(start))
  .then(() => {
    document.documentElement.dataset.ready = "yes";
  });
