// The view and the axes of the scene.

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
      gridcolor: scheme.grid,
      zerolinecolor: scheme.zero,
      showspikes: false,
      showbackground: false, // a background would hide parts of the labels
    };
  };
  return {
    font: font(),
    margin: { l: 0, r: 0, t: 0, b: 0 },
    uirevision: "space",
    paper_bgcolor: scheme.paper,
    legend: { x: 0.01, y: 0.99, yanchor: "top", itemsizing: "constant", bgcolor: scheme.veil },
    showlegend: listed,
    modebar: { orientation: "v", bgcolor: "rgba(0,0,0,0)", color: scheme.soft, activecolor: scheme.accent },
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

/** The direction of the viewer in the current view. */
function eyeNow() {
  const { eye } = byId("space").layout?.scene?.camera ?? {};
  return eye ? [eye.x, eye.y, eye.z] : EYE;
}

/** How much larger than at first the reader has made the scene. */
function magnification() {
  const ratio = byId("space")._fullLayout?.scene?.aspectratio;
  const first = zoom(extentOf()) * extentOf()[0];
  return ratio && ratio.x > 0 && data.kind === "path" ? ratio.x / first : 1;
}

/** The length [m] of the arrows, which have the same size on the screen at any magnification. */
const arrowLength = () => space.length / magnification();
