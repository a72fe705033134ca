"""The errata of Sakhno, Kravets, Bas, Krivda (2018): each printed formula fails here, and the corrected one holds.

One right-angled, climbing turn with unequal radii and general end velocities serves throughout. The table is
docs/errata.md.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.algebra import matrices

ROUND_OFF = 1e-12  # relative to the largest component
WRONG = 1e-2  # a printed formula is wrong where it misses by more than this, relatively

R1A, R2B, R3A, R3B = 20.0, 26.0, 1.0, 3.0
V1A, V2A, V3A = 1.2, 8.0, 0.5
V1B, V2B, V3B = V2A / R1A * R2B, -0.7, -0.3
TK = np.pi * R1A / (2 * V2A)
INSTANT = 2.6


def miss(actual, expected):
    """The largest deviation, relative to the largest expected component."""
    expected = np.asarray(expected)
    return np.max(np.abs(np.asarray(actual) - expected)) / np.max(np.abs(expected))


def boundary(v1b=V1B):
    return (
        qt.BoundaryState([R1A, 0.0, R3A], [V1A, V2A, V3A]),
        qt.BoundaryState([0.0, R2B, R3B], [-v1b, V2B, V3B]),
    )


@pytest.fixture(scope="module")
def path():
    return qt.SpiralHelix.from_boundary(*boundary())


@pytest.fixture(scope="module")
def derivatives(path):
    """r, ṙ, r̈, r⃛ at one instant, from the package."""
    return np.asarray(path.derivatives(INSTANT, 3))


@pytest.fixture(scope="module")
def frame(path):
    return qt.trihedral(path, INSTANT)


@pytest.fixture(scope="module")
def alpha(frame):
    return np.asarray(frame.dcm())


# The hodograph and its boundary conditions


def test_hodograph_needs_its_coefficients(path, derivatives):
    powers = INSTANT ** np.arange(4)
    angle = V2A / R1A * INSTANT
    around = np.array([np.cos(angle), np.sin(angle), 0.0])
    axis = np.array([0.0, 0.0, 1.0])
    heights = np.asarray(path.height) * powers  # the column that is printed; its sum is the height
    printed = powers.sum() * around + heights.sum() * axis
    corrected = path.radius @ powers * around + heights.sum() * axis
    assert miss(printed, derivatives[0]) > WRONG
    assert miss(heights[0], derivatives[0, 2]) > WRONG  # nor is any one entry of the column the height
    assert miss(corrected, derivatives[0]) < ROUND_OFF


def test_start_condition_of_the_radial_velocity(path):
    start = path.velocity(0.0)
    assert miss(path.radius[0], start[0]) > WRONG  # ṙ1A(0) = ρ, without an index
    assert miss(path.radius[1], start[0]) < ROUND_OFF


def cubic(first, last, rate_first, rate_last, sign=1.0, factor=1.0):
    """ρ0 … ρ3 by the paper's solution; `sign` and `factor` belong to the last term of ρ3."""
    gap = last - first
    return np.array(
        [
            first,
            rate_first,
            3 * gap / TK**2 - (rate_last + 2 * rate_first) / TK,
            -2 * gap / TK**3 + sign * (rate_last + factor * rate_first) / TK**2,
        ]
    )


def end_of(coefficients):
    """Value and rate at t_k."""
    ascending = np.polynomial.Polynomial(coefficients)
    return np.array([ascending(TK), ascending.deriv()(TK)])


def test_sign_in_rho3(path):
    printed = cubic(R1A, R2B, V1A, V2B, sign=-1.0)
    corrected = cubic(R1A, R2B, V1A, V2B)
    assert miss(end_of(printed), [R2B, V2B]) > WRONG
    assert miss(end_of(corrected), [R2B, V2B]) < ROUND_OFF
    assert miss(path.radius, corrected) < ROUND_OFF


@pytest.mark.parametrize("row", ["rho3", "h3"])
def test_factor_in_the_substituted_coefficients(path, row):
    data, ours = {
        "rho3": ((R1A, R2B, V1A, V2B), path.radius),
        "h3": ((R3A, R3B, V3A, V3B), path.height),
    }[row]
    printed, corrected = cubic(*data, factor=2.0), cubic(*data)
    last = [data[1], data[3]]
    assert miss(end_of(printed), last) > WRONG
    assert miss(end_of(corrected), last) < ROUND_OFF
    assert miss(ours, corrected) < ROUND_OFF


def test_ten_boundary_numbers_for_nine_unknowns():
    """V2A/V1B = r1A/r2B is printed as a consequence; it is a condition on the data, and the rest ignores it."""
    start, end = boundary(v1b=1.3 * V1B)
    printed = qt.SpiralHelix(cubic(R1A, R2B, V1A, V2B), [0.0, V2A / R1A], cubic(R3A, R3B, V3A, V3B), TK)
    assert miss(printed.velocity(TK), end.velocity) > WRONG
    with pytest.raises(ValueError, match=r"0\.4 rad/s at the start and 0\.52 at the end"):
        qt.SpiralHelix.from_boundary(start, end)
    complete = qt.SpiralHelix.hermite(start, end, TK)
    assert miss(complete.velocity(0.0), start.velocity) < ROUND_OFF
    assert miss(complete.velocity(TK), end.velocity) < ROUND_OFF


def test_the_turn_is_a_right_angle(path):
    assert miss(path.turn, np.pi) > WRONG  # a straight angle, as the horizontal special case is called
    assert miss(path.turn, np.pi / 2) < ROUND_OFF


# The natural trihedral


def test_curvature_is_the_second_derivative_along_the_arc(derivatives, frame):
    _, v, a, _ = derivatives
    speed = np.linalg.norm(v)
    printed = np.linalg.norm(v / speed)  # |dr/ds|
    second = (a - v * (v @ a) / speed**2) / speed**2  # d²r/ds²
    assert miss(printed, 1.0) < ROUND_OFF
    assert miss(printed, frame.curvature) > WRONG
    assert miss(np.linalg.norm(second), frame.curvature) < ROUND_OFF
    assert miss(np.linalg.norm(np.cross(v, a)) / speed**3, frame.curvature) < ROUND_OFF


def test_denominator_of_the_normal(derivatives, frame):
    _, v, a, _ = derivatives
    c = np.cross(v, a)
    printed = -np.cross(v, c) / np.linalg.norm(c)
    corrected = printed / np.linalg.norm(v)
    assert miss(printed, frame.normal) > WRONG
    assert miss(corrected, frame.normal) < ROUND_OFF


def test_denominator_of_the_binormal(derivatives, frame):
    _, v, a, _ = derivatives
    c = np.cross(v, a)
    printed = -np.cross(v, np.cross(v, c)) / np.linalg.norm(c)
    corrected = printed / (v @ v)
    assert miss(printed, frame.binormal) > WRONG
    assert miss(corrected, frame.binormal) < ROUND_OFF


def test_expanded_normal(derivatives, frame):
    _, v, a, _ = derivatives
    area = np.linalg.norm(np.cross(v, a))
    printed = -((v @ a) * a - (a @ v) * v) / area
    corrected = ((v @ v) * a - (v @ a) * v) / (np.linalg.norm(v) * area)
    assert miss(printed, frame.normal) > WRONG
    assert miss(corrected, frame.normal) < ROUND_OFF


def test_fragment_before_the_binormal(derivatives):
    """r̈/|ṙ·r̈| stands among the formulas of n and b; it is neither of unit length nor across the path."""
    _, v, a, _ = derivatives
    printed = a / abs(v @ a)
    assert miss(np.linalg.norm(printed), 1.0) > WRONG
    assert abs(printed @ v) / np.linalg.norm(v) > WRONG


def cyclic():
    return [(0, 1, 2), (1, 0, 2), (2, 0, 1)]


def test_double_product_by_components(derivatives):
    _, v, a, _ = derivatives
    expected = matrices.cross_repeated(jnp.asarray(v), jnp.asarray(a), 2)
    inner = {k: v[i] * a[i] + v[j] * a[j] for k, i, j in cyclic()}
    printed = [v[k] * inner[k] - v[k] * inner[k] for k in range(3)]
    corrected = [v[k] * inner[k] - a[k] * (v[i] ** 2 + v[j] ** 2) for k, i, j in cyclic()]
    assert miss(printed, expected) > WRONG
    assert miss(corrected, expected) < ROUND_OFF
    assert miss(corrected, np.cross(v, np.cross(v, a))) < ROUND_OFF


def test_normal_is_not_over_speed_and_acceleration(derivatives, frame):
    """The column of n and the second matrix row divide by |ṙ||r̈|; only ṙ ⊥ r̈ would allow it."""
    _, v, a, _ = derivatives
    double = -np.cross(v, np.cross(v, a))
    printed = double / (np.linalg.norm(v) * np.linalg.norm(a))
    corrected = double / (np.linalg.norm(v) * np.linalg.norm(np.cross(v, a)))
    assert miss(printed, frame.normal) > WRONG
    assert miss(corrected, frame.normal) < ROUND_OFF


def det(top, bottom):
    return np.linalg.det(np.array([top, bottom]))


def test_determinants_of_the_normal(derivatives, alpha):
    _, v, a, _ = derivatives
    size = np.linalg.norm(v) * np.linalg.norm(np.cross(v, a))
    rows = {k: (v[k], v[i] * a[i] + v[j] * a[j]) for k, i, j in cyclic()}
    printed = [det(rows[k], rows[k]) / size for k in range(3)]
    corrected = [det((a[k], v[i] * a[i] + v[j] * a[j]), (v[k], v[i] ** 2 + v[j] ** 2)) / size for k, i, j in cyclic()]
    assert miss(printed, alpha[1]) > WRONG
    assert miss(corrected, alpha[1]) < ROUND_OFF


def test_determinants_of_the_binormal(derivatives, alpha):
    _, v, a, _ = derivatives
    size = np.linalg.norm(np.cross(v, a))
    pairs = [(1, 2), (2, 0), (0, 1)]
    printed = [det(v[[i, j]], v[[i, j]]) / size for i, j in pairs]
    corrected = [det(v[[i, j]], a[[i, j]]) / size for i, j in pairs]
    assert miss(printed, alpha[2]) > WRONG
    assert miss(corrected, alpha[2]) < ROUND_OFF


# The derivatives of the hodograph


def columns():
    t, w = INSTANT, V2A / R1A
    value, rate = np.array([1, t, t**2, t**3]), np.array([0, 1, 2 * t, 3 * t**2])
    return t, w, value, rate, np.cos(w * t), np.sin(w * t)


def test_velocity_needs_the_coefficients_in_both_terms(path, derivatives):
    _, w, value, rate, cos, sin = columns()
    rho = np.asarray(path.radius)
    for k, (first, second) in enumerate([(cos, -sin), (sin, cos)]):
        printed = rho @ rate * first + w * value.sum() * second
        corrected = rho @ (rate * first + w * value * second)
        assert miss(printed, derivatives[1, k]) > WRONG
        assert miss(corrected, derivatives[1, k]) < ROUND_OFF


@pytest.mark.parametrize(("k", "sense"), [(0, -1.0), (1, 1.0)])
def test_last_entry_of_the_acceleration_columns(path, derivatives, k, sense):
    t, w, value, rate, cos, sin = columns()
    rho = np.asarray(path.radius)
    first, second = (cos, sin) if k == 0 else (sin, cos)
    straight = np.array([0, 0, 2, 6 * t])

    def acceleration(radial):
        return rho @ (radial * first + sense * 2 * w * rate * second)

    printed = straight - w**2 * np.array([1, t, t**2, t**2])
    assert miss(acceleration(printed), derivatives[2, k]) > WRONG
    assert miss(acceleration(straight - w**2 * value), derivatives[2, k]) < ROUND_OFF


def test_sign_in_the_second_acceleration(path, derivatives):
    t, w, value, rate, cos, sin = columns()
    radial = np.array([0, 0, 2, 6 * t]) - w**2 * value
    rho = np.asarray(path.radius)
    printed = rho @ (radial * sin - 2 * w * rate * cos)
    corrected = rho @ (radial * sin + 2 * w * rate * cos)
    assert miss(printed, derivatives[2, 1]) > WRONG
    assert miss(corrected, derivatives[2, 1]) < ROUND_OFF


# Orientation

H = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]])


def test_column_of_the_squares_needs_its_one(alpha, frame):
    squares = np.asarray(frame.quaternion()) ** 2
    printed = H @ np.array([0.0, *np.diag(alpha)]) / 4
    corrected = H @ np.array([1.0, *np.diag(alpha)]) / 4
    assert miss(printed, squares) > WRONG
    assert miss(corrected, squares) < ROUND_OFF
    assert miss(qt.rotation.squares_from_dcm(frame.dcm()), squares) < ROUND_OFF


def test_squares_lose_the_relative_signs(alpha, frame):
    roots = np.sqrt(np.asarray(qt.rotation.squares_from_dcm(frame.dcm())))
    fitting = [
        signs
        for signs in itertools.product([1, -1], repeat=3)
        if miss(qt.rotation.to_dcm(jnp.asarray(roots * [1, *signs])), alpha) < ROUND_OFF
    ]
    assert miss(qt.rotation.to_dcm(jnp.asarray(roots)), alpha) > WRONG
    assert len(fitting) == 1  # of the eight attitudes that the diagonal allows
    assert miss(qt.rotation.to_dcm(qt.rotation.from_dcm(frame.dcm())), alpha) < ROUND_OFF


def test_gibbs_ratios_fail_in_the_horizontal_turn(path, frame):
    """They hold in space; in the plane α1 = α2 = 0, and both forms of G3, the only component, are 0/0."""
    ratios = qt.rotation.gibbs_ratios(frame.dcm())
    assert miss(ratios, np.repeat(np.asarray(frame.gibbs())[:, None], 2, axis=1)) < ROUND_OFF
    flat = qt.SpiralHelix(path.radius, path.angle, [0.0], path.duration)
    tri = qt.trihedral(flat, INSTANT)
    printed = np.asarray(qt.rotation.gibbs_ratios(tri.dcm()))
    heading = np.arctan2(tri.tangent[1], tri.tangent[0])
    assert not np.any(np.isfinite(printed[2]))
    assert miss(qt.rotation.gibbs_from_dcm(tri.dcm()), [0.0, 0.0, np.tan(heading / 2)]) < ROUND_OFF


def test_gibbs_vector_does_not_tell_half_turns_apart():
    """'Univalent' fails at Φ = π: the vector is infinite there, and its axis cannot be recovered from it."""
    attitude = jnp.array([0.0, 1.0, -2.0, 2.0]) / 3
    gibbs = qt.rotation.to_gibbs(attitude)
    assert np.all(np.isinf(gibbs))
    assert not np.any(np.isfinite(qt.rotation.from_gibbs(gibbs)))
    assert miss(qt.rotation.from_dcm(qt.rotation.to_dcm(attitude)), attitude) < ROUND_OFF
    # And on both sides of it: 2 mrad apart, yet opposite vectors.
    near, beyond = (qt.quaternion.exp(attitude[1:] * (np.pi + gap) / 2) for gap in (-1e-3, 1e-3))
    assert miss(qt.rotation.to_dcm(near), qt.rotation.to_dcm(beyond)) < WRONG
    assert miss(qt.rotation.to_gibbs(near), qt.rotation.to_gibbs(beyond)) > WRONG


# The hidden flip of the horizontal special case


def circumferential(ratio):
    """The horizontal special case with r2B = ratio·r1A: V1A = V2B = 0, unit radius and rate."""
    start = qt.BoundaryState([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    end = qt.BoundaryState([0.0, ratio, 0.0], [-ratio, 0.0, 0.0])
    return qt.SpiralHelix.from_boundary(start, end)


@jax.jit
def upwards(path, fractions):
    """The vertical component of the binormal at fractions of the duration."""
    return jax.vmap(lambda u: qt.trihedral(path, u * path.duration).binormal[2])(fractions)


def test_binormal_flips_at_0_1689_for_doubled_radius():
    rho = np.polynomial.Polynomial([1.0, 0.0, 3.0, -2.0])  # r2B = 2 r1A, u = t/t_k
    bend = (np.pi / 2) ** 2 * rho**2 + 2 * rho.deriv() ** 2 - rho * rho.deriv(2)
    roots = [root.real for root in bend.roots() if abs(root.imag) < 1e-9 and 0 < root.real < 1]
    assert np.round(roots, 4).tolist() == [0.1689]
    either_side = upwards(circumferential(2.0), np.array([roots[0] - 1e-3, roots[0] + 1e-3]))
    assert np.sign(either_side).tolist() == [-1.0, 1.0]


@pytest.mark.parametrize(
    ("change", "flips"), [(-1e-3, False), (1e-3, True)], ids=["under the threshold", "over the threshold"]
)
@pytest.mark.parametrize("inverse", [False, True], ids=["growing", "shrinking"])
def test_threshold_of_the_flip(change, flips, inverse):
    """The trihedral of the special case is continuous for r2B/r1A within 1+π²/24 ≈ 1.411 and its inverse only."""
    ratio = 1 + np.pi**2 / 24 + change
    b = upwards(circumferential(1 / ratio if inverse else ratio), np.linspace(0.0, 1.0, 201))
    assert bool(np.any(b < 0)) == flips
