"""The balls of which a body consists, and their centres along a path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.vector import cross, unit
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp

UP = np.array([0.0, 0.0, 1.0])


@storable
class Body(eqx.Module):
    """Balls that move with the upright frame of a path, as `Limits(body=...)` makes them.

    `offsets` (m, 3) [m] are the centres relative to the position of the path, forwards, to the left and upwards, and
    `radii` (m,) [m] their radii, which may be zero.

    **Raises:** ValueError for wrong shapes, negative radii, and numbers that are not finite.
    """

    offsets: Float[Array, "m 3"]
    radii: Float[Array, " m"]

    def __init__(self, offsets: Any, radii: Any):
        self.offsets, self.radii = as_float(offsets), as_float(radii)
        if self.offsets.ndim != 2 or self.offsets.shape[1] != 3 or self.radii.shape != self.offsets.shape[:1]:
            raise ValueError(
                f"a body needs offsets (m, 3) and radii (m,), but {self.offsets.shape} and {self.radii.shape} were "
                "given"
            )
        if self.radii.shape == (0,):
            raise ValueError("a body must contain at least one ball (offset, radius)")
        offsets, radii = concrete(self.offsets), concrete(self.radii)
        if offsets is not None and not np.isfinite(offsets).all():
            raise ValueError(f"the offsets of a body must be finite [m], but {offsets.tolist()} was given")
        if radii is not None and not (np.isfinite(radii).all() and (radii >= 0).all()):
            raise ValueError(
                f"the radii of a body must not be negative and must be finite [m], but {radii.tolist()} was given"
            )

    def __repr__(self) -> str:
        offsets, radii = concrete(self.offsets), concrete(self.radii)
        if offsets is None or radii is None:
            return f"Body({self.radii.shape[0]} balls)"
        balls = zip(offsets.tolist(), radii.tolist(), strict=True)
        return f"[{', '.join(f'({_short(x)} m, {r:.6g} m)' for x, r in balls)}]"

    @property
    def turns(self) -> bool:
        """Whether the direction of the path matters."""
        return bool(np.any(np.asarray(self.offsets)))

    def centres(self, position: Any, direction: Any, signs: Any = 1.0) -> Any:
        """Return the centres (m, ..., 3) [m] for positions (..., 3) and directions (..., 3) of any length.

        `signs` (...) are −1 in reverse. Where the direction is zero, the centres are NaN, except without an offset.
        """
        tau = unit(direction, xp.full_like(direction, np.nan)) * xp.asarray(signs)[..., None]
        up = xp.broadcast_to(xp.asarray(UP, dtype=direction.dtype), direction.shape)
        left = unit(cross(up, tau), xp.full_like(direction, np.nan))
        axes = tau, left, cross(tau, left)
        rows = []
        for k in range(self.radii.shape[0]):
            own = position
            for axis, v in enumerate(axes):
                x = self.offsets[k, axis]
                known = concrete(x)
                if known is None or known:
                    own = own + x * v
            rows.append(own)
        return xp.stack(rows)


BodyInput = Sequence[tuple[Any, Any]] | Body | None
"""The balls (offset, radius) of a body; None is the point that follows the path."""


def body_of(given: BodyInput) -> Body | None:
    """Return the body; an offset is in the direction of travel, or (3,) in the axes of the upright frame.

    **Raises:** TypeError for anything but pairs, and ValueError for pairs that `Body` does not accept.
    """
    if given is None or isinstance(given, Body):
        return given
    try:
        pairs = [(offset, radius) for offset, radius in given]
    except (TypeError, ValueError) as error:
        raise TypeError(
            "body must be a list of balls (offset, radius), such as [(0.0, 1.0), (2.0, 1.0)], but "
            f"{described(given)} was given"
        ) from error
    offsets = []
    for offset, _ in pairs:
        own = as_float(offset)
        if own.shape not in ((), (3,)):
            raise ValueError(
                f"the offset of a ball must be a number [m], in the direction of travel, or (3,) [m], forwards, to the "
                f"left and upwards, but its shape is {own.shape}"
            )
        offsets.append(own if own.ndim else xp.stack([own, 0.0 * own, 0.0 * own]))
    radii = [as_float(radius) for _, radius in pairs]
    return Body(xp.stack(offsets) if pairs else np.zeros((0, 3)), xp.stack(radii) if pairs else np.zeros(0))


POINT = Body([[0.0, 0.0, 0.0]], [0.0])
"""The body that is one point."""


def _short(x: list[float]) -> str:
    return f"{x[0]:.6g}" if not any(x[1:]) else "[" + ", ".join(f"{v:.6g}" for v in x) + "]"
