"""The special cases of Sakhno, Kravets, Bas, Krivda (2017), from their closed forms in boundary data."""

import jax
import numpy as np
import pytest

import qtraj as qt

ROUND_OFF = 1e-12  # relative to the size of the path

FRACTIONS = np.linspace(0.0, 1.0, 9)


def right_angle(radii, heights, rates_a, rates_b):
    """The boundary states of the paper's figure: from the x axis to the y axis, V1B and V2A at one rate ω."""
    (r1a, r2b), (r3a, r3b) = radii, heights
    (v1a, v2a, v3a), (v2b, v3b) = rates_a, rates_b
    v1b = v2a / r1a * r2b
    return (
        qt.BoundaryState([r1a, 0.0, r3a], [v1a, v2a, v3a]),
        qt.BoundaryState([0.0, r2b, r3b], [-v1b, v2b, v3b]),
    )


def closed_form(rate, radius, height, t):
    """r(t) of the paper, (n, 3), with ascending coefficients of ρ and h."""
    ascending = [np.polynomial.Polynomial(c)(t) for c in (radius, height)]
    return np.stack([ascending[0] * np.cos(rate * t), ascending[0] * np.sin(rate * t), ascending[1]], axis=-1)


@jax.jit
def positions(path, t):
    return jax.vmap(path.position)(t)


def assert_is_path(path, rate, radius, height):
    duration = np.pi / (2 * rate)
    t = duration * FRACTIONS
    size = np.max(np.abs(np.asarray(radius)))
    assert abs(float(path.duration) - duration) <= ROUND_OFF * duration
    np.testing.assert_allclose(
        positions(path, t), closed_form(rate, radius, height, t), rtol=0, atol=10 * ROUND_OFF * size
    )


def substituted(first, last, rate_first, rate_last, w):
    """ρ0 … ρ3 (or h) with t_k = π/2ω put in; in ρ3 and h3 the paper's 2V1A and 2V3A are V1A and V3A."""
    gap = last - first
    return [
        first,
        rate_first,
        12 / np.pi**2 * w**2 * gap - 2 * w / np.pi * (rate_last + 2 * rate_first),
        -16 / np.pi**3 * w**3 * gap + 4 / np.pi**2 * w**2 * (rate_last + rate_first),
    ]


@pytest.mark.parametrize(
    ("radii", "heights", "rates_a", "rates_b"),
    [
        ((20.0, 26.0), (1.0, 3.0), (1.2, 8.0, 0.5), (-0.7, -0.3)),
        ((30.0, 12.0), (4.0, -2.0), (-3.0, 5.0, 0.0), (2.0, 1.5)),
    ],
    ids=["growing and climbing", "shrinking and descending"],
)
def test_right_angle(radii, heights, rates_a, rates_b):
    """The corrected substituted coefficients, and the paper's full r(t), which is printed right."""
    path = qt.SpiralHelix.from_boundary(*right_angle(radii, heights, rates_a, rates_b))
    (r1a, r2b), (r3a, r3b) = radii, heights
    (v1a, v2a, v3a), (v2b, v3b) = rates_a, rates_b
    w = v2a / r1a
    assert_is_path(path, w, substituted(r1a, r2b, v1a, v2b, w), substituted(r3a, r3b, v3a, v3b, w))

    def nested(first, last, rate_first, rate_last):
        bracket = 2 * v2a / (np.pi * r1a) * (6 * v2a / (np.pi * r1a) * (last - first) - rate_last - 2 * rate_first)
        cubic = 4 / np.pi**2 * w**2 * (rate_last + rate_first - 4 * v2a / (np.pi * r1a) * (last - first))
        return [first, rate_first, bracket, cubic]

    assert_is_path(path, w, nested(r1a, r2b, v1a, v2b), nested(r3a, r3b, v3a, v3b))


def test_circumferential_end_velocities():
    """V1A = V3A = V2B = V3B = 0: only the terms in r2B − r1A and r3B − r3A are left, printed right."""
    r1a, r2b, r3a, r3b, v2a = 20.0, 26.0, 1.0, 3.0, 8.0
    w = v2a / r1a
    path = qt.SpiralHelix.from_boundary(*right_angle((r1a, r2b), (r3a, r3b), (0.0, v2a, 0.0), (0.0, 0.0)))
    square, cube = 12 / np.pi**2 * w**2, -16 / np.pi**3 * w**3
    radius = [r1a, 0.0, square * (r2b - r1a), cube * (r2b - r1a)]
    height = [r3a, 0.0, square * (r3b - r3a), cube * (r3b - r3a)]
    assert_is_path(path, w, radius, height)
    # Not at rest: the vehicle passes both ends at ωρ, across the radius and level.
    np.testing.assert_allclose(path.velocity(0.0), [0.0, w * r1a, 0.0], atol=ROUND_OFF * v2a)
    np.testing.assert_allclose(path.velocity(path.duration), [-w * r2b, 0.0, 0.0], atol=10 * ROUND_OFF * v2a)


def test_horizontal_turn():
    """r3A = r3B = 0 as well: a plane curve, whose trihedral turns about the vertical by its heading."""
    r1a, r2b, v2a = 20.0, 26.0, 8.0
    w = v2a / r1a
    path = qt.SpiralHelix.from_boundary(*right_angle((r1a, r2b), (0.0, 0.0), (0.0, v2a, 0.0), (0.0, 0.0)))
    gap = r2b - r1a
    radius = [r1a, 0.0, 12 / np.pi**2 * w**2 * gap, -16 / np.pi**3 * w**3 * gap]
    assert_is_path(path, w, radius, [0.0])

    t = 0.4 * np.pi / (2 * w)
    tri = qt.trihedral(path, t)
    rho = np.polynomial.Polynomial(radius)
    heading = w * t + np.arctan2(w * rho(t), rho.deriv()(t))
    expected = [np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)]
    np.testing.assert_allclose(tri.quaternion(), expected, atol=10 * ROUND_OFF)
    np.testing.assert_allclose(tri.torsion, 0.0, atol=ROUND_OFF)
    # κ of a plane curve in polar coordinates.
    value, rate, second = rho(t), rho.deriv()(t), rho.deriv(2)(t)
    bend = w * (w**2 * value**2 + 2 * rate**2 - value * second)
    np.testing.assert_allclose(tri.curvature, bend / np.hypot(rate, w * value) ** 3, rtol=10 * ROUND_OFF)
