"""Inertias of rigid bodies: a scalar J, three principal moments (3,), or a tensor (3, 3) [kg m²]."""

import numpy as np

from qtraj.foundation.arrays import as_float, concrete, require_finite
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import ArrayInput, Mat3

SYMMETRY = 1e-6
"""Maximum asymmetry of an inertia tensor, relative to its largest entry, that is accepted as rounding of the input.

It is also the fraction by which a principal moment may exceed the sum of the other two.
"""


def inertia_matrix(inertia: ArrayInput) -> Mat3:
    """Convert an inertia of shape (), (3,) or (3, 3) to a (3, 3) tensor [kg m²].

    **Raises:** ValueError for any other shape; for concrete values, also if the tensor is not finite, symmetric and
    positive definite, or has a principal moment larger than the sum of the other two, which no body has.
    """
    J = as_float(inertia)
    if J.shape not in ((), (3,), (3, 3)):
        raise ValueError(f"an inertia must be a scalar, (3,) or (3, 3), but shape {J.shape} was given")
    J = J if J.ndim == 2 else xp.diag(xp.broadcast_to(J, (3,)))
    require_finite(J, "the inertia")
    value = concrete(J)
    if value is not None:
        symmetric = np.abs(value - value.T).max() <= SYMMETRY * np.abs(value).max()
        if not symmetric or not (np.linalg.eigvalsh(value) > 0).all():
            raise ValueError(
                f"an inertia must be symmetric with positive principal moments, but {value.tolist()} was given"
            )
        moments = np.linalg.eigvalsh(value)
        if moments[2] > (1 + SYMMETRY) * (moments[0] + moments[1]):
            raise ValueError(
                "no body has a principal moment of inertia that exceeds the sum of the other two, but the moments "
                f"{', '.join(f'{x:.6g}' for x in moments)} kg m² were given"
            )
    return J
