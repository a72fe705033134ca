"""Define hodographs: smooth curves r(t) that a vehicle follows."""

import abc
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar, Self

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation import document
from qtraj.foundation.argument import require_type, require_whole
from qtraj.foundation.arrays import one_instant, part, real_vector, require_element
from qtraj.foundation.drawing import draw
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3
from qtraj.path import along_path
from qtraj.path.boundary import BoundaryState
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.nearest import Nearest, nearest
from qtraj.path.own_duration import with_array_duration

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PART = 1e-3
"""Span of a path that is neither polynomial nor a route, relative to its duration (see `regularity`)."""


class AbstractHodograph(eqx.Module):
    """A smooth position curve r(t) [m] in world axes, where t [s] is the time from the start, 0 ≤ t ≤ `duration`.

    An own path is a subclass with a `duration` [s] and the method `derivatives`. The duration may be declared as a
    number, an array, a static field or a class attribute; it becomes a field whose value is an array. A property must
    compute it from fields that are arrays.
    """

    duration: eqx.AbstractVar[Scalar]
    supports_numpy: ClassVar[bool] = False
    """Whether the methods of the class accept and return NumPy arrays if all fields are NumPy arrays.

    Paths that do not support this are computed by JAX, which compiles their functions.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        with_array_duration(cls)
        super().__init_subclass__(**options)

    @abc.abstractmethod
    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """Return r and its time derivatives up to `order` at one instant, world axes; row k in [m s^-k]."""

    def polynomials(self) -> MovingPolynomials | None:
        """Return the polynomials of the path in its own moving basis, or None if the path is not polynomial.

        For polynomial paths, limits can be proved to be satisfied, and batched evaluation is fast.
        """
        return None

    def nodes(self) -> Float[Array, " nodes"] | None:
        """Return times [s] in ascending order, from 0, between which the path is smooth, or None.

        None means that the path is smooth everywhere. At the end of the array, several times may equal the duration.
        """
        return None

    def driven(self) -> Any:
        """Return the motion of a vehicle on a single concrete route, for the frame `Driving`, or None for other paths.

        The motion has the methods of `qtraj.path.stops.Segments` that find stops and the states next to them.
        """
        return None

    def span(self, t: Array) -> Array:
        """Return how long [s] the derivatives at the times `t` are of their present size; see `regularity`.

        Here it is a small part of the duration, because the path may oscillate often in it.
        """
        return self.duration * PART

    def sampled(self, t: Float[Array, " n"], order: int) -> list[Float[Array, "n 3"]]:
        """Return r and its time derivatives up to `order`, each (n, 3), at instants `t` (n,), in world axes."""
        rows = jax.vmap(lambda t: self.derivatives(t, order))(t)
        return [rows[:, k] for k in range(order + 1)]

    def __call__(self, t: ScalarLike) -> Vec3:
        """Return the position r(t), (3,) [m]."""
        return self.position(t)

    def position(self, t: ScalarLike) -> Vec3:
        """Return the position r(t), (3,) [m]."""
        return self.derivatives(t, 0)[0]

    def velocity(self, t: ScalarLike) -> Vec3:
        """Return the velocity ṙ(t), (3,) [m/s]."""
        return self.derivatives(t, 1)[1]

    def acceleration(self, t: ScalarLike) -> Vec3:
        """Return the acceleration r̈(t), (3,) [m/s²]."""
        return self.derivatives(t, 2)[2]

    def jerk(self, t: ScalarLike) -> Vec3:
        """Return the jerk r⃛(t), (3,) [m/s³]."""
        return self.derivatives(t, 3)[3]

    def __getitem__(self, index: Any) -> Self:
        """Return one path of a batch, by its number, or several by a slice or a list of numbers.

        **Raises:** TypeError for a single path or another index, IndexError for a number that does not exist or an
        empty selection.
        """
        count = len(self)
        require_element(index, count, "paths in the batch")
        if isinstance(index, list):
            index = np.asarray(index)
        if index is None or isinstance(index, bool | tuple | str):
            raise TypeError(f"a batch of paths has the indices 0 to {count - 1} and slices, but {index!r} was given")
        if isinstance(index, slice) and not range(count)[index]:
            raise IndexError(f"there are {count} paths in the batch, and the slice {index} selects none of them")
        return jax.tree.map(lambda x: x[index] if isinstance(x, np.ndarray) else part(x, index), self)

    def __len__(self) -> int:
        """Return the number of paths of a batch.

        **Raises:** TypeError for a single path.
        """
        if not np.ndim(self.duration):
            raise TypeError(
                f"a single {type(self).__name__} is not a batch, so it has neither elements nor a number of elements: "
                "path(t) is the position at the time t"
            )
        return self.duration.shape[0]

    def __bool__(self) -> bool:
        """Return True, also for a single path, which has no length."""
        return True

    def __iter__(self) -> Iterator[Self]:
        """Return an iterator over the paths of a batch."""
        return (self[k] for k in range(len(self)))

    def state(self, t: ScalarLike) -> BoundaryState:
        """Return position and velocity at one instant as a boundary state, for example for another path."""
        r = self.derivatives(t, 1)
        return BoundaryState(r[0], r[1])

    def length(self) -> Scalar:
        """Return the arc length ∫|ṙ|dt over the duration [m].

        The relative error is about 1e-9 if the speed is smooth, and about 1e-6 in the worst case. The method is
        Gauss–Legendre quadrature on panels that are halved until the relative change is at most 1e-9 (in float32, 32
        machine epsilons), or a million speeds have been evaluated. If the last change is larger than 1e-6 (in float32,
        4e-6), the result is NaN. The first estimates use about a thousand instants, so details of the speed between
        these instants may be missed.
        """
        return along_path.until(self, self.duration)

    def arc_length(self, t: ScalarLike) -> Scalar:
        """Return the arc length [m] from the start to the time `t` [s], 0 ≤ t ≤ duration, as accurately as `length`."""
        return along_path.until(self, one_instant(t))

    def time_at(self, length: ScalarLike) -> Scalar:
        """Return the time [s] at which the arc length reaches `length` [m]; at a stop, the start of the stop.

        For lengths outside the range, the result is the time of the start or the end. Where the speed is not zero, the
        result is differentiable; its derivative dt/ds is the inverse of the speed.
        """
        return along_path.time_at(self, one_instant(length))

    def nearest(self, point: ArrayInput) -> Nearest:
        """Find the point on the path nearest to `point` (3,) [m], and its time, position and distance; world axes.

        The path is sampled at 1025 instants, at more if it turns by more than 0.4 rad between two of them, and at its
        `nodes`; a traced path at 1025 instants only. Newton's method then refines each sample. First
        derivatives of time, position and distance are exact.
        """
        return nearest(self, real_vector(point, "the point", 3))

    def plot(self, frame: Any = None, trihedra: int = 6) -> "Figure":
        """Plot the path in space and trihedra along it, as a matplotlib figure (extra `viz`).

        `trihedra` is the number of trihedra, which are drawn at equal time steps. `frame` is a frame as in
        `qtraj.evaluate`, by default the natural trihedral. Save the figure with `figure.savefig(file)`; notebooks
        display the figure.

        **Raises:** ModuleNotFoundError, naming the extra to install, if matplotlib is missing; ValueError for a batch
        of paths.
        """
        return draw("path_plot", self, frame, trihedra)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the path to a TOML or JSON file without loss of precision; `qtraj.load` reads the file.

        **Raises:** ValueError for any other suffix, or if the path contains a user-defined function.
        """
        document.save(self, file)


def require_path(path: AbstractHodograph) -> None:
    """Raise a ValueError if the argument `path` is not a path."""
    expected = "a path, such as a SpiralHelix, Route or Curve"
    require_type(
        path, AbstractHodograph, "path", expected, "" if isinstance(path, AbstractHodograph) else path_advice(path)
    )


def require_order(order: int) -> None:
    """Raise a ValueError unless the `order` of a derivative is a whole number, at least 0."""
    require_whole(order, "the order of a derivative")


def path_advice(given: Any) -> str:
    """Return advice on an argument from which a path can be made."""
    kinds = {kind.__name__ for kind in type(given).__mro__}
    if kinds & {"PPoly", "BPoly", "BSpline"}:
        return "convert it with qtraj.Route.from_piecewise(spline)"
    if "Track" in kinds:
        return "fit a route with qtraj.fit_route(track).path, or a single turn with qtraj.fit(track).path"
    if isinstance(getattr(given, "path", None), AbstractHodograph):
        return "pass its field path"
    if isinstance(given, list | tuple | np.ndarray | jax.Array):
        return "qtraj.Shape.through(points) is a curve through points"
    if callable(given) and not isinstance(given, type):
        return "qtraj.Curve(function, duration) is the path of a function of time"
    return ""
