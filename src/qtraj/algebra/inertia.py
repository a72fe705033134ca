"""Inertias of rigid bodies: a scalar J for a spherical body, (3,) principal moments, or a (3, 3) tensor [kg m²]."""

import jax.numpy as jnp
import numpy as np

from qtraj.foundation.arrays import as_float, concrete, require_finite
from qtraj.foundation.types import ArrayInput, Mat3

SYMMETRY = 1e-6
"""Asymmetry of an inertia tensor, relative to its largest entry, that counts as round-off from a file."""


def inertia_matrix(inertia: ArrayInput) -> Mat3:
    """An inertia as a (3, 3) tensor [kg m²].

    **Raises:** ValueError for another shape, or a concrete value that is not symmetric and positive definite.
    """
    J = as_float(inertia)
    if J.shape not in ((), (3,), (3, 3)):
        raise ValueError(f"an inertia must be a scalar, (3,) or (3, 3), but shape {J.shape} was given")
    J = J if J.ndim == 2 else jnp.diag(jnp.broadcast_to(J, (3,)))
    require_finite(J, "the inertia")
    value = concrete(J)
    if value is not None:
        symmetric = np.abs(value - value.T).max() <= SYMMETRY * np.abs(value).max()
        if not symmetric or not (np.linalg.eigvalsh(value) > 0).all():
            raise ValueError(
                f"an inertia must be symmetric with positive principal moments, but {value.tolist()} was given"
            )
    return J
