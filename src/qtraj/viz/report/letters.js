// The positions of the labels of arrows relative to their tips.

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
  const seen = eyeNow();
  const scale = (zoom(extentOf()) * magnification() * byId("space").clientHeight) / VISIBLE; // [px/m]
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
