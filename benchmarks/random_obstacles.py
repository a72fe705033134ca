"""Random obstacles next to random paths, and distances by dense sampling with formulas of their own."""

import numpy as np

import qtraj as qt


def random_route(rng, count=4, septic=False):
    """A route with quintic segments, or septic ones, about along x."""
    times = np.append(0.0, np.cumsum(rng.uniform(1.0, 3.0, count)))
    position = np.cumsum(rng.normal([8, 0, 0], [1, 3, 1], (count + 1, 3)), axis=0)
    states = [rng.normal([4, 0, 0], [0.5, 1, 0.3], (count + 1, 3)), rng.normal(0, 0.5, (count + 1, 3))]
    return qt.Route(times, position, *states, *([rng.normal(0, 0.3, (count + 1, 3))] if septic else []))


def random_helix(rng, uniform=True):
    """A spiral-helix about an axis of any direction."""
    orientation = rng.normal(size=4)
    placement = qt.Placement(rng.normal(0, 5, 3), orientation)
    angle = [rng.uniform(-3, 3), rng.uniform(0.2, 0.5), *([] if uniform else [0.02, -0.002])]
    return qt.SpiralHelix([20, rng.normal(), 0.05], angle, [0, rng.normal(), 0.02], rng.uniform(3, 9), placement)


def random_obstacle(rng, near, moves=False):
    """An obstacle whose centre is near a point; its distance may be positive or negative."""
    at = near + rng.normal(0, 3, 3)
    centre = np.stack([at - 2.0 * (v := rng.normal(0, 0.3, 3)), v]) if moves else at
    kind = rng.integers(3 if moves else 5)
    if kind == 0:
        return qt.Ball(centre, rng.uniform(0.5, 3))
    if kind == 1:
        return qt.Cylinder(centre, rng.normal(size=3), rng.uniform(0.5, 2))
    if kind == 2:
        a = rng.normal(size=(3, 3))
        shape = a @ a.T + 0.3 * np.eye(3)
        return qt.Ellipsoid(centre, 0.5 * (shape + shape.T))
    if kind == 3:
        normal = rng.normal(size=3)
        return qt.HalfSpace(normal, normal @ at)
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 7)))
    if np.max(np.diff(np.append(angles, angles[0] + 2 * np.pi))) > 3.0 or np.min(np.diff(angles)) < 0.05:
        angles = np.array([0.1, 2.0, 4.1])
    corners = at[:2] + 2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return qt.ConvexPolygon(corners[:: rng.choice([-1, 1])])


def distance(obstacle, points, t):
    """The distances (n,) of points (n, 3), by other formulas than those of the library."""
    if isinstance(obstacle, qt.HalfSpace):
        return (points @ obstacle.normal - obstacle.offset) / np.linalg.norm(obstacle.normal)
    if isinstance(obstacle, qt.ConvexPolygon):
        return _from_polygon(np.asarray(obstacle.vertices), points[:, :2])
    point = obstacle.point if isinstance(obstacle, qt.Cylinder) else obstacle.centre
    away = points - np.stack([np.polyval(c[::-1], t) for c in np.asarray(point).T], axis=-1)
    if isinstance(obstacle, qt.Ball):
        return np.sqrt(np.sum(away**2, axis=1)) - float(obstacle.radius)
    if isinstance(obstacle, qt.Cylinder):
        axis = obstacle.axis / np.linalg.norm(obstacle.axis)
        return np.linalg.norm(away - (away @ axis)[:, None] * axis, axis=1) - float(obstacle.radius)
    return _from_ellipsoid(np.asarray(obstacle.shape), away)


def _from_polygon(vertices, points):
    best, sides = np.full(len(points), np.inf), []
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        e = b - a
        along = np.clip((points - a) @ e / (e @ e), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - along[:, None] * e, axis=1))
        sides.append(e[0] * (points[:, 1] - a[1]) - e[1] * (points[:, 0] - a[0]) >= 0)
    inside = np.all(sides, axis=0) | ~np.any(sides, axis=0)  # the corners are in either sense
    return np.where(inside, -best, best)


def _from_ellipsoid(shape, away):
    """Bisection for the multiplier; inside, the smallest semi-axis times √(xᵀP⁻¹x) − 1."""
    values, axes = np.linalg.eigh(shape)
    own = away @ axes
    level = np.sqrt(np.sum(own**2 / values, axis=1))
    low, high = np.zeros(len(own)), np.sqrt(np.sum(values * own**2, axis=1))
    for _ in range(100):
        s = 0.5 * (low + high)
        more = np.sum(values * own**2 / (values + s[:, None]) ** 2, axis=1) > 1
        low, high = np.where(more, s, low), np.where(more, high, s)
    far = np.linalg.norm(own - values * own / (values + low[:, None]), axis=1)
    return np.where(level > 1, far, (level - 1) * np.sqrt(values[0]))


def sampled_clearance(path, obstacle, balls, count=4001):
    """The smallest clearance at many instants; the frame's axes are computed here."""
    t = np.linspace(0, float(path.duration), count)
    r, v = (np.asarray(x) for x in path.sampled(t, 1))
    tau = v / np.linalg.norm(v, axis=1)[:, None]
    left = np.cross([0.0, 0.0, 1.0], v)
    left /= np.linalg.norm(left, axis=1)[:, None]
    axes = tau, left, np.cross(tau, left)
    found = []
    for offset, radius in balls:
        own = np.array([offset, 0.0, 0.0]) if np.ndim(offset) == 0 else np.asarray(offset)
        centre = r + sum(x * a for x, a in zip(own, axes, strict=True))
        found.append(distance(obstacle, centre, t) - radius)
    return np.min(found)
