// The colours of the light and the dark scheme; the browser says which one the reader prefers. Paper is always light.
const SCHEMES = {
  light: {
    paper: "#ffffff",
    veil: "rgba(255,255,255,0.8)",
    ink: "#1c2733",
    soft: "#5b6b7a",
    grid: "#e6ebf0",
    zero: "#c9d2da",
    accent: "#0072b2",
  },
  dark: {
    paper: "#14191f",
    veil: "rgba(20,25,31,0.8)",
    ink: "#e3e9ee",
    soft: "#9fadba",
    grid: "#2a333c",
    zero: "#46525e",
    accent: "#56b4e9",
  },
};
const DARKER = { "#0072B2": "#56b4e9", "#D55E00": "#f0834a" }; // colours that are hard to see on a dark ground
const preference = window.matchMedia("(prefers-color-scheme: dark)");
let scheme = SCHEMES[preference.matches ? "dark" : "light"];

/** A colour that is visible on the ground of the scheme; black becomes the colour of the text. */
function readable(colour) {
  if (scheme === SCHEMES.light) return colour;
  const grey = parseInt(colour.slice(1, 3), 16);
  const black = /^#(..)\1\1$/.test(colour) && grey < 0x70;
  return black || colour === SCHEMES.light.ink ? scheme.ink : DARKER[colour] ?? colour;
}

const font = () => ({ family: "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif", size: 12, color: scheme.ink });

/** Draw the page in a scheme. */
async function paint(name) {
  if (scheme === SCHEMES[name]) return;
  scheme = SCHEMES[name];
  repaintPanels();
  legend();
  drawPlan();
  await drawSpace();
  await show();
}
preference.addEventListener("change", () => paint(preference.matches ? "dark" : "light"));
