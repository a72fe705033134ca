"""Create random turns for proofs and tuning, and compute squared path quantities with 50 digits."""

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath

import qtraj as qt


def random_turn(key, motion):
    """Return a random turn of 0.6 to 3 rad between radii of 10 to 40 m, which starts at about 8 m/s."""
    keys = jax.random.split(key, 4)
    r0, r1 = 10 + 30 * jax.random.uniform(keys[0], (2,))
    turn = 0.6 + 2.4 * jax.random.uniform(keys[1])
    v = 1.5 * jax.random.normal(keys[2], (4,))
    rate = 8.0 / r0
    cos, sin = jnp.cos(turn), jnp.sin(turn)
    out, across = jnp.stack([cos, sin, 0.0]), jnp.stack([-sin, cos, 0.0])
    up = jnp.array([0.0, 0.0, 1.0])
    start = qt.BoundaryState(jnp.stack([r0, 0.0, 0.0]), jnp.stack([v[0], rate * r0, v[1]]))
    end = qt.BoundaryState(r1 * out + 2.0 * up, v[2] * out + rate * r1 * across + v[3] * up)
    if motion == "uniform":
        return qt.SpiralHelix.from_boundary(start, end)
    return qt.SpiralHelix.hermite(start, end, turn / rate * (0.9 + 0.4 * jax.random.uniform(keys[3])))


def random_turns(count, motion, seed=0):
    return eqx.filter_vmap(lambda key: random_turn(key, motion))(jax.random.split(jax.random.key(seed), count))


def element(paths, k):
    return jax.tree.map(lambda x: x[k], paths)


def exact_square(path, name, t):
    """Return the square of a path quantity with 50 digits, from the path coefficients."""
    t = mpmath.mpf(t)
    rho, phi, h = ([mpmath.mpf(float(c)) for c in x] for x in (path.radius, path.angle, path.height))

    def derivative(c, k):
        return mpmath.fsum(a * mpmath.ff(j, k) * t ** (j - k) for j, a in enumerate(c) if j >= k)

    d = [[derivative(c, k) for k in range(4)] for c in (rho, phi, h)]
    (p, p1, p2, p3), (_, w, w1, w2) = d[0], d[1]
    rows = [
        [p1, p * w, d[2][1]],
        [p2 - p * w**2, 2 * p1 * w + p * w1, d[2][2]],
        [p3 - 3 * p1 * w**2 - 3 * p * w * w1, 3 * p2 * w + 3 * p1 * w1 + p * w2 - p * w**3, d[2][3]],
    ]
    a, b, c = rows
    cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    def dot(x, y):
        return mpmath.fsum(i * j for i, j in zip(x, y, strict=True))

    S, N, T = dot(a, a), dot(cross, cross), dot(cross, c)
    return {
        "curvature": lambda: N / S**3,
        "torsion": lambda: (T / N) ** 2,
        "speed": lambda: S,
        "acceleration": lambda: dot(b, b),
        "lateral_acceleration": lambda: N / S,
        "longitudinal_acceleration": lambda: dot(a, b) ** 2 / S,
        "angular_rate": lambda: S * (T / N) ** 2 + N / S**2,
    }[name]()
