// Arrows as surfaces: a shaft and a head, made of rings of points about an axis.

const PROFILE = [
  [0, 0],
  [0, 0.022],
  [0.74, 0.022],
  [0.74, 0.07],
  [1, 0],
];
const FACES = (() => {
  const i = [],
    j = [],
    k = [];
  for (let ring = 0; ring + 1 < PROFILE.length; ring++) {
    for (let s = 0; s < SIDES; s++) {
      const a = ring * SIDES + s,
        b = ring * SIDES + ((s + 1) % SIDES);
      i.push(a, b);
      j.push(b, b + SIDES);
      k.push(a + SIDES, a + SIDES);
    }
  }
  return { i, j, k };
})();

function arrowPoints(origin, axis, length) {
  const points = { x: [], y: [], z: [] };
  if (axis === null || !finite(origin)) return points;
  const least = axis.map(Math.abs).indexOf(Math.min(...axis.map(Math.abs)));
  const side = unit(
    cross(
      axis,
      [0, 1, 2].map((k) => (k === least ? 1 : 0)),
    ),
  );
  const other = cross(axis, side);
  const stout = data.kind === "attitude" ? 0.6 : 1;
  for (const [along, radius] of PROFILE) {
    for (let s = 0; s < SIDES; s++) {
      const angle = (2 * Math.PI * s) / SIDES;
      let point = plus(origin, axis, along * length);
      const size = stout * radius * length;
      point = plus(plus(point, side, size * Math.cos(angle)), other, size * Math.sin(angle));
      points.x.push(point[0]);
      points.y.push(point[1]);
      points.z.push(point[2]);
    }
  }
  return points;
}
