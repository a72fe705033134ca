"""Convert between quaternions and Euler angles of all 12 sequences of axes, named as in SciPy.

Lower case means rotations about fixed axes (extrinsic): `"zyx"` rotates about z first, then about y, then about x, so λ
= e_x(a3)∘e_y(a2)∘e_z(a1), where e_x(a) is the quaternion of a rotation by a about x. Upper case means rotations about
the moving axes (intrinsic): for `"ZYX"`, λ = e_z(a1)∘e_y(a2)∘e_x(a3). If λ maps body to inertial axes, the angles of
"ZYX" are yaw, pitch and roll.

For an extrinsic sequence i, j, i the quaternion is the sum of components in two planes, λ = A + B∘e_j with A =
cos(a2/2) exp(e_i (a3+a1)/2) and B = sin(a2/2) exp(e_i (a3−a1)/2). The polar forms of A and B yield the three angles. A
quarter turn about j reduces a sequence i, j, k to this case: e_j(π/2)∘λ has the angles (a1, a2 + π/2, ±a3).
"""

import itertools
import math
from functools import reduce
from typing import Any

from qtraj.algebra.quaternion import canonical, components, product
from qtraj.algebra.vector import balanced, norm
from qtraj.foundation.namespace import of_arrays, xp
from qtraj.foundation.types import Flag, Quat, Scalar, Vec3

Pair = tuple[Any, Any]

_LOCK = 16  # in units of machine epsilon; at a smaller distance from gimbal lock, one outer angle is only round-off


@of_arrays
def from_euler(seq: str, angles: Any) -> Quat:
    """Return the unit quaternion for Euler `angles` (..., n) [rad] in the order of `seq`.

    `seq` names n = 1, 2 or 3 axes; the angle about one axis may also be a scalar.

    **Raises:** ValueError unless `seq` is one to three axis letters, all upper case or all lower case, none twice in a
    row, and for angles of another shape.
    """
    axes, intrinsic = parse(seq, fewest=1)
    angles = xp.asarray(angles)
    if len(axes) == 1 and angles.ndim == 0:
        angles = angles[None]
    if angles.shape[-1:] != (len(axes),):
        raise ValueError(f"from_euler: angles must have shape (..., {len(axes)}), but shape {angles.shape} was given")
    turns = [turn(axis, angles[..., k]) for k, axis in enumerate(axes)]
    return reduce(product, turns if intrinsic else turns[::-1])


@of_arrays
def to_euler(q: Quat, seq: str) -> Vec3:
    """Return the Euler angles [rad] in the order of `seq`; `q` and `c*q` give the same result for any c ≠ 0.

    The first and third angles are in [−π, π]. The second angle is in [0, π] for sequences such as xyx, and in
    [−π/2, π/2] for sequences such as zyx. In gimbal lock the third angle is 0, as in SciPy (but without a warning), and
    the derivatives are finite. SciPy treats attitudes within 1e-7 rad of gimbal lock as locked, with errors of this
    size; the threshold of this function is 16 machine epsilons.

    **Raises:** ValueError unless `seq` is three axis letters, all upper case or all lower case, none twice in a row.
    """
    axes, intrinsic = parse(seq)
    i, j, k = axes[::-1] if intrinsic else axes
    other = 3 - i - j
    parity = 1.0 if (j - i) % 3 == 1 else -1.0  # e_i∘e_j = parity·e_other
    parts = components(canonical(balanced(q)))
    s, a, b, c = parts[0], parts[1 + i], parts[1 + j], parity * parts[1 + other]
    if i == k:
        plane_a, plane_b, offset, sign = (s, a), (b, c), 0.0, 1.0
    else:
        plane_a, plane_b, offset, sign = (s - b, a + c), (b + s, c - a), 0.5 * math.pi, parity
    first, second, third = _polar(plane_a, plane_b, intrinsic)
    outer = [_wrap(first), sign * _wrap(third)]
    start, end = outer[::-1] if intrinsic else outer
    return xp.stack([start, second - offset, end], axis=-1)


def _polar(plane_a: Pair, plane_b: Pair, keep_third: bool) -> tuple[Scalar, Scalar, Scalar]:
    """Return the angles first, second and third of e_i(third)∘e_j(second)∘e_i(first) = A + B∘e_j.

    `plane_a` and `plane_b` are the components of A and B in the plane of 1 and e_i (see the module).

    In gimbal lock, `first` is 0 if `keep_third` is true; otherwise `third` is 0.
    """
    size_a, size_b = norm(xp.stack(plane_a, axis=-1)), norm(xp.stack(plane_b, axis=-1))
    margin = _LOCK * float(xp.finfo(size_a.dtype).eps)
    lost_a, lost_b = size_a <= margin * size_b, size_b <= margin * size_a
    half_sum, half_difference = _argument(plane_a, lost_a), _argument(plane_b, lost_b)
    first, third = half_sum - half_difference, half_sum + half_difference
    only = xp.where(lost_a, half_difference if keep_third else -half_difference, half_sum)
    locked = lost_a | lost_b
    kept, dropped = (third, first) if keep_third else (first, third)
    kept, dropped = xp.where(locked, 2 * only, kept), xp.where(locked, 0.0, dropped)
    first, third = (dropped, kept) if keep_third else (kept, dropped)
    return first, 2 * xp.arctan2(size_b, size_a), third


def _argument(plane: Pair, lost: Flag) -> Scalar:
    """Return the polar angle of a pair; 0 with zero derivative if `lost`, that is, if the pair is only round-off."""
    return xp.arctan2(xp.where(lost, 0.0, plane[1]), xp.where(lost, 1.0, plane[0]))


def _wrap(angle: Scalar) -> Scalar:
    """Reduce an angle in [−2π, 2π] to [−π, π]."""
    turns = xp.where(angle > math.pi, 1.0, xp.where(angle < -math.pi, -1.0, 0.0))
    return angle - 2 * math.pi * turns


def turn(axis: int, angle: Scalar) -> Quat:
    """Return the quaternion of a rotation by `angle` about a coordinate axis."""
    parts = [xp.cos(0.5 * angle)] + 3 * [xp.zeros_like(angle)]
    parts[1 + axis] = xp.sin(0.5 * angle)
    return xp.stack(parts, axis=-1)


def parse(seq: str, fewest: int = 3) -> tuple[list[int], bool]:
    """Return the indices of the axes of a sequence, `fewest` to three, and whether it is intrinsic (upper case)."""
    letters = seq if isinstance(seq, str) else ""
    axes = ["xyz".find(letter) for letter in letters.lower()]
    one_case = letters in (letters.lower(), letters.upper())
    twice = any(a == b for a, b in itertools.pairwise(axes))
    if not fewest <= len(axes) <= 3 or min(axes) < 0 or not one_case or twice:
        count = "three" if fewest == 3 else "one to three"
        raise ValueError(
            f"an Euler sequence must be {count} of the letters xyz (extrinsic) or XYZ (intrinsic), none twice in a "
            f"row, such as 'ZYX' or 'zxz', but {seq!r} was given"
        )
    return axes, letters.isupper()
