"""Convert between quaternions λ and direction cosines α (inertial → body; the rows of α are the body axes)."""

from qtraj.algebra.quaternion import canonical, components, norm_squared, unit as unit_quaternion
from qtraj.algebra.vector import balanced
from qtraj.foundation.namespace import of_arrays, xp
from qtraj.foundation.types import Mat3, Quat, Scalar

SIGNS = ((1, 1, 1, 1), (1, 1, -1, -1), (1, -1, 1, -1), (1, -1, -1, 1))
"""Paper S's matrix H, which maps the squared components of a unit quaternion to (1, α11, α22, α33).

α are the direction cosines. The matrix H/2 is its own inverse.
"""


@of_arrays
def to_dcm(q: Quat) -> Mat3:
    """Return the direction cosines α of the attitude `q`, which convert inertial to body components.

    `q` and `c*q` give the same result for any c ≠ 0.
    """
    q = balanced(q)
    s, x, y, z = components(q)
    rows = [
        [s * s + x * x - y * y - z * z, 2 * (x * y + s * z), 2 * (x * z - s * y)],
        [2 * (x * y - s * z), s * s - x * x + y * y - z * z, 2 * (y * z + s * x)],
        [2 * (x * z + s * y), 2 * (y * z - s * x), s * s - x * x - y * y + z * z],
    ]
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2) / norm_squared(q)[..., None, None]


@of_arrays
def from_dcm(C: Mat3) -> Quat:
    """Return the unit quaternion λ of the direction cosines `C`; its first non-zero component is positive.

    Shepperd's method selects the row of the matrix 4 λ_i λ_k that contains the largest diagonal element. (The diagonal
    alone, as in `squares_from_dcm`, does not determine the signs of the components.) The value and the gradient are
    finite at every rotation. If `C` is not orthogonal, the result depends on the selected row.
    """
    return canonical(unit_quaternion(pivot_row(C)))


@of_arrays
def squares_from_dcm(C: Mat3) -> Quat:
    """Return the squared components of the unit quaternion of the direction cosines `C`.

    In paper S these are ¼H(1, α11, α22, α33), with the matrix H = `SIGNS` and the direction cosines α.
    """
    return 0.25 * xp.stack(_squares(C), axis=-1)


def pivot_row(C: Mat3) -> Quat:
    """Return 4 λ_k (λ0, λ1, λ2, λ3) for the k with the largest λ_k²; λ is the unit quaternion of the matrix `C`.

    The norm of the result is at least 2. Each component is selected separately, because the code that XLA generates for
    indexing an array of rows is slow for many matrices.
    """
    rows = _outer(C)
    a, b, c, d = (rows[k][k] for k in range(4))
    first, second, third = (a >= b) & (a >= c) & (a >= d), (b >= c) & (b >= d), c >= d
    choose = lambda w, x, y, z: xp.where(first, w, xp.where(second, x, xp.where(third, y, z)))  # noqa: E731
    return xp.stack([choose(*column) for column in zip(*rows, strict=True)], axis=-1)


def _outer(C: Mat3) -> list[list[Scalar]]:
    """Return the matrix with 4 λ_i λ_k in row i and column k; λ is the unit quaternion of the matrix `C`."""
    squares = _squares(C)
    d1, d2, d3 = C[..., 1, 2] - C[..., 2, 1], C[..., 2, 0] - C[..., 0, 2], C[..., 0, 1] - C[..., 1, 0]
    s1, s2, s3 = C[..., 1, 2] + C[..., 2, 1], C[..., 2, 0] + C[..., 0, 2], C[..., 0, 1] + C[..., 1, 0]
    return [
        [squares[0], d1, d2, d3],
        [d1, squares[1], s3, s2],
        [d2, s3, squares[2], s1],
        [d3, s2, s1, squares[3]],
    ]


def _squares(C: Mat3) -> list[Scalar]:
    return [1 + i * C[..., 0, 0] + j * C[..., 1, 1] + k * C[..., 2, 2] for _, i, j, k in SIGNS]
