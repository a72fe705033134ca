// What is printed.
// Browsers do not print WebGL, so an image replaces the scene on paper.
let pictured = false;
function picture(source, width, height, copied) {
  const paper = byId("picture");
  Object.assign(paper, { width, height, className: "drawn" });
  paper.getContext("2d").drawImage(source, 0, 0, width, height);
  paper.style.width = byId("space").clientWidth + "px";
  document.body.classList.toggle("copied", copied);
}

/** Print button: draw the scene at twice the resolution of the screen, then print. */
async function print() {
  play(false);
  await paint("light");
  const { clientWidth: width, clientHeight: height } = byId("space");
  const image = new Image();
  image.src = await Plotly.toImage(byId("space"), { format: "png", width, height, scale: 2 });
  await image.decode();
  picture(image, image.naturalWidth, image.naturalHeight, false);
  pictured = true;
  window.print();
}

function afterPrint() {
  pictured = false;
  paint(preference.matches ? "dark" : "light");
}

/** The browser's print command does not wait for asynchronous code, so copy the scene as it is, without its legend. */
function copySpace() {
  if (pictured) return;
  play(false);
  paint("light");
  if (!WEBGL) return; // the scene is not a canvas, and browsers print it
  const scene = byId("space")._fullLayout?.scene?._scene; // plotly does not have a public function to draw immediately
  if (!scene?.glplot) return;
  scene.glplot.redraw();
  const { canvas } = scene.glplot.gl;
  picture(canvas, canvas.width, canvas.height, true);
}
