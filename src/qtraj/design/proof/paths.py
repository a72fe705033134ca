"""Prepare paths for a proof: the arrays of polynomial paths, and the sources of batches of paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from qtraj.design.proof.curves import CurveSource
from qtraj.design.proof.sources import PolynomialSource, Source, polynomial_source
from qtraj.path.hodograph import AbstractHodograph

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def polynomial_arrays(path: AbstractHodograph) -> tuple[Any, ...] | None:
    """Return x, y, z, angle, duration, orientation, origin of a batch of polynomial paths, or None for other paths.

    The batch axes come first. The first four are the coefficients of `MovingPolynomials`, and the orientation (4,) and
    the origin (3,) are the quaternion and the origin of the placement.
    """
    batch = path.duration.shape
    function: Any = lambda path: path.polynomials()  # noqa: E731
    for _ in batch:
        function = eqx.filter_vmap(function)
    found = function(path)
    if found is None:
        return None
    y = np.zeros((*batch, 1)) if found.y is None else found.y
    placed = found.placement
    if placed is None:
        placement = np.broadcast_to(IDENTITY, (*batch, 4)), np.zeros((*batch, 3))
    else:
        placement = placed.orientation, placed.origin
    return found.x, y, found.z, found.angle, path.duration, *placement


def source_of(arrays: Sequence[np.ndarray]) -> PolynomialSource:
    """Return the source of n paths, whose `polynomial_arrays` have one batch axis."""
    x, y, *others = (np.asarray(a, float) for a in arrays)
    return polynomial_source(x, y if y.any() else None, *others)


def curve_source(path: AbstractHodograph) -> Source:
    """Return the source of a batch of paths that are not polynomial, with all batch axes merged into one."""
    return CurveSource(_flat(path))


def world_source(path: AbstractHodograph) -> Source:
    """Return the source of a batch of polynomial paths whose derivatives are numbers in world axes."""
    return CurveSource(_flat(path), in_numpy=path.supports_numpy)


def _flat(path: AbstractHodograph) -> AbstractHodograph:
    axes = path.duration.ndim
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[axes:]) if eqx.is_array(x) else x, path)
