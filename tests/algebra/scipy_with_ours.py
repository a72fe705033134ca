"""A plugin of pytest that replaces the formulas of SciPy's `Rotation` by those of qtraj, for SciPy's own tests.

Conversions, products, inverses, powers, magnitudes and applications are replaced in both of SciPy's implementations
(compiled, and for arrays of any shape). SciPy's functions are also called where they refuse arguments or warn of gimbal
lock. Run SciPy's tests with ours in place from the folder of the project:

    python -m pytest -p tests.algebra.scipy_with_ours -n 0 --pyargs scipy.spatial.transform.tests.test_rotation
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import _rotation_cy, _rotation_xp

from qtraj.algebra import quaternion, rotation


def wxyz(quat: Any) -> np.ndarray:
    return np.roll(np.asarray(quat, float), 1, axis=-1)


def xyzw(q: Any) -> np.ndarray:
    return np.roll(np.asarray(q, float), -1, axis=-1)


def from_matrix(theirs: Callable[..., Any], matrix: Any, assume_valid: bool = False) -> Any:
    matrix = np.asarray(matrix, float)
    if assume_valid:
        return xyzw(rotation.from_dcm(np.swapaxes(matrix, -1, -2)))
    theirs(matrix)  # raises for matrices without a rotation, which `nearest_dcm` does not refuse
    return xyzw(rotation.from_dcm(rotation.nearest_dcm(np.swapaxes(matrix, -1, -2))))


def as_matrix(theirs: Callable[..., Any], quat: Any) -> Any:
    return np.ascontiguousarray(np.swapaxes(np.asarray(rotation.to_dcm(wxyz(quat))), -1, -2))


def from_rotvec(theirs: Callable[..., Any], rotvec: Any, degrees: bool = False) -> Any:
    vectors = np.asarray(rotvec, float)
    if vectors.shape[-1:] != (3,):
        return theirs(rotvec, degrees)  # raises
    return xyzw(rotation.from_rotation_vector(np.radians(vectors) if degrees else vectors))


def as_rotvec(theirs: Callable[..., Any], quat: Any, degrees: bool = False) -> Any:
    vectors = np.asarray(rotation.to_rotation_vector(wxyz(quat)))
    return np.degrees(vectors) if degrees else vectors


def from_mrp(theirs: Callable[..., Any], mrp: Any) -> Any:
    if np.shape(mrp)[-1:] != (3,):
        return theirs(mrp)  # raises
    return xyzw(rotation.from_mrp(np.asarray(mrp, float)))


def as_mrp(theirs: Callable[..., Any], quat: Any) -> Any:
    return np.asarray(rotation.to_mrp(wxyz(quat)))


def from_euler(theirs: Callable[..., Any], seq: Any, angles: Any, degrees: bool = False) -> Any:
    found = theirs(seq, angles, degrees)  # raises, and gives the shape
    angles = np.asarray(angles, float)
    if len(seq) == 1 and angles.shape[-1:] != (1,):
        angles = angles[..., None]
    angles = np.radians(angles) if degrees else angles
    return xyzw(rotation.from_euler(seq, angles)).reshape(np.shape(found))


def as_euler(
    theirs: Callable[..., Any], quat: Any, seq: str, degrees: bool = False, suppress_warnings: bool = False
) -> Any:
    theirs(quat, seq, degrees, suppress_warnings=suppress_warnings)  # raises and warns
    angles = np.asarray(rotation.to_euler(wxyz(quat), seq))
    return np.degrees(angles) if degrees else angles


def compose_quat(theirs: Callable[..., Any], p: Any, q: Any) -> Any:
    return xyzw(quaternion.unit(quaternion.product(wxyz(p), wxyz(q))))


def apply(theirs: Callable[..., Any], quat: Any, vectors: Any, inverse: bool = False) -> Any:
    theirs(quat, vectors, inverse)  # raises for shapes that do not fit
    q = wxyz(quat)
    return np.asarray(quaternion.rotate(quaternion.conjugate(q) if inverse else q, vectors))


def inv(theirs: Callable[..., Any], quat: Any) -> Any:
    return xyzw(quaternion.inverse(wxyz(quat)))


def magnitude(theirs: Callable[..., Any], quat: Any) -> Any:
    q = wxyz(quat)
    return np.asarray(rotation.angle_between(np.array([1.0, 0.0, 0.0, 0.0]), q)).reshape(np.shape(theirs(quat)))


def power(theirs: Callable[..., Any], quat: Any, n: Any) -> Any:
    theirs(quat, n)  # raises for shapes that do not fit
    return xyzw(rotation.power(wxyz(quat), np.asarray(n, float)))


OURS = {
    "from_matrix": from_matrix,
    "as_matrix": as_matrix,
    "from_rotvec": from_rotvec,
    "as_rotvec": as_rotvec,
    "from_mrp": from_mrp,
    "as_mrp": as_mrp,
    "from_euler": from_euler,
    "as_euler": as_euler,
    "compose_quat": compose_quat,
    "apply": apply,
    "inv": inv,
    "magnitude": magnitude,
    "pow": power,
}
CALLS = dict.fromkeys(OURS, 0)


def _replaced(name: str, theirs: Callable[..., Any]) -> Callable[..., Any]:
    def call(*args: Any, **options: Any) -> Any:
        CALLS[name] += 1
        return OURS[name](theirs, *args, **options)

    return call


def pytest_configure() -> None:
    """Replace the formulas."""
    for module in (_rotation_cy, _rotation_xp):
        for name in OURS:
            setattr(module, name, _replaced(name, getattr(module, name)))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Say how often each of ours was called."""
    terminalreporter.write_line(f"ours: {', '.join(f'{name} {count}' for name, count in CALLS.items())}")
