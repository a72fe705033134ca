"""Compare operations on a batch of rotations: qtraj and jaxlie, compiled in the same way, and SciPy."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
from scipy.spatial.transform import Rotation

import qtraj as qt

from ..race import race
from . import Measured

SO3 = jaxlie.SO3


def operations(count):
    """Return (qtraj, jaxlie, SciPy) by the name of the operation: calls without arguments that return arrays."""
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(count, 3))
    p, q = (rng.normal(size=(count, 4)) for _ in range(2))
    p, q = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (p, q))
    P, Q = (Rotation.from_quat(x, scalar_first=True) for x in (p, q))
    matrices = P.as_matrix()
    wxyz = lambda x: x.wxyz  # noqa: E731
    ours = {
        "product": (qt.quaternion.product, (p, q)),
        "rotate a vector": (qt.quaternion.rotate, (p, vectors)),
        "exponential": (qt.rotation.from_rotation_vector, (vectors,)),
        "logarithm": (qt.rotation.to_rotation_vector, (p,)),
        "to a matrix": (qt.rotation.to_dcm, (p,)),
        "from a matrix": (qt.rotation.from_dcm, (matrices.swapaxes(1, 2),)),
    }
    theirs = {
        "product": lambda p, q: wxyz(SO3(p) @ SO3(q)),
        "rotate a vector": lambda p, v: SO3(p) @ v,
        "exponential": lambda v: wxyz(SO3.exp(v)),
        "logarithm": lambda p: SO3(p).log(),
        "to a matrix": lambda p: SO3(p).as_matrix(),
        "from a matrix": lambda m: wxyz(SO3.from_matrix(m.swapaxes(0, 1))),
    }
    scipys = {
        "product": lambda: (P * Q).as_quat(scalar_first=True),
        "rotate a vector": lambda: P.apply(vectors),
        "exponential": lambda: Rotation.from_rotvec(vectors).as_quat(scalar_first=True),
        "logarithm": lambda: P.as_rotvec(),
        "to a matrix": lambda: P.as_matrix(),
        "from a matrix": lambda: Rotation.from_matrix(matrices).as_quat(scalar_first=True),
    }
    return {name: (_bound(*ours[name]), _bound(theirs[name], ours[name][1]), scipys[name]) for name in ours}


def _bound(function, arguments):
    compiled, given = jax.jit(jax.vmap(function)), tuple(map(jnp.asarray, arguments))
    return lambda: compiled(*given)


def measure(quick):
    count, rows = (10**4 if quick else 10**6), []
    for name, (own, lie, scipy) in operations(count).items():
        same(name, *(np.asarray(call()) for call in (own, lie, scipy)))
        spent = race({"qtraj": own, "jaxlie": lie, "SciPy": scipy}, 3 if quick else 9)
        ns = {key: 1e9 * float(np.median(times)) / count for key, times in spent.items()}
        row = {"operation": name} | {f"{key} [ns]": value for key, value in ns.items()}
        rows.append(row | {f"qtraj / {key}": ns["qtraj"] / ns[key] for key in ("jaxlie", "SciPy")})
    return Measured("Rotations, each operation on a batch, float64", rows, {"rotations": count})


def same(name, own, lie, scipy):
    """Raise a ValueError if results disagree; matrices are inertial to body, and quaternions may have either sign."""
    if name == "to a matrix":
        own = own.swapaxes(1, 2)
    for other in (lie, scipy):
        gap = np.abs(own - other)
        if own.shape[-1] == 4:
            gap = np.minimum(gap, np.abs(own + other).max(axis=1, keepdims=True))
        if not gap.max() < 1e-9:
            raise ValueError(f"{name}: the results disagree by {gap.max():.3g}")
