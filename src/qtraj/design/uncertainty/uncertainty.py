"""The standard deviations of quantities along a fitted path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.uncertainty.motion_covariance import motion_covariance
from qtraj.design.uncertainty.propagation import propagate
from qtraj.design.uncertainty.quantity_expansion import HEADING
from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import require_inside
from qtraj.foundation.data_frame import data_frame
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.drawing import draw
from qtraj.foundation.extras import require_package
from qtraj.foundation.methods import method
from qtraj.foundation.namespace import on_host
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, times_text
from qtraj.foundation.seconds import seconds
from qtraj.foundation.types import ArrayInput
from qtraj.path.channel import MAGNITUDES
from qtraj.path.own_name import OwnName, name_of
from qtraj.path.own_quantity import Quantity as OwnQuantity
from qtraj.path.path_quantity import VEHICLE, PathQuantity
from qtraj.path.quantity import QUANTITIES, quantity
from qtraj.path.road_parameters import NO_VEHICLE
from qtraj.path.sides import upper_side
from qtraj.path.vehicle import Vehicle, fixed_parameters, require, require_vehicle
from qtraj.path.vehicle_data import batch_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

VECTORS = {"position": "m", "velocity": "m s-1", "acceleration": "m s-2", "jerk": "m s-3"}
"""The derivatives of the path in the order of the derivative, with their units."""

ENTRIES = {HEADING.name: HEADING} | {
    entry.variable: entry for name in QUANTITIES.values() for entry in (quantity(upper_side(name)), name)
}
ENTRIES |= MAGNITUDES
"""The quantities by the names of the outputs of `evaluate`."""

DEFAULT = ("position", "heading", "horizontal_curvature", "yaw_rate", "lateral_acceleration")


class Uncertainty(AbstractResult):
    """Quantities along a fitted path at n instants, with their standard deviations.

    - `time` (n,) [s], from the start of the path.
    - `values`: the values by name, (n,) or (n, 3), in the units of `evaluate`.
    - `sigma`: their standard deviations, to first order in the errors of the fit.
    - `nonlinearity`: the size of the terms of second order relative to the standard deviation, (n,) or (n, 3). Below
      0.1 the standard deviation is accurate to about 1 %; above 0.3 the distribution is not normal, as for a magnitude
      close to zero.

    All three are NaN where a quantity is undefined, such as the heading at rest; the last two also where the covariance
    is unknown, which is at the stops of a route and where it is a curve with a progress next to them.
    """

    time: Float[Array, " n"]
    values: dict[str, Array]
    sigma: dict[str, Array]
    nonlinearity: dict[str, Array]

    def plot(self, *names: str) -> Figure:
        """Plot the values over time, each with a band of two standard deviations on both sides (extra `viz`).

        **Raises:** ModuleNotFoundError with the extra to install, if matplotlib is missing; ValueError for a quantity
        that the result does not contain.
        """
        return draw("uncertainty_plot", self, names)

    def to_dataframe(self) -> pandas.DataFrame:
        """Convert to a pandas DataFrame with one row for each instant and columns such as `yaw_rate_sigma`.

        **Raises:** ModuleNotFoundError if pandas is missing.
        """
        require_package("pandas", "a data frame", extra=None)
        return data_frame(self.record())

    def record(self) -> Record:
        """Return the values, the standard deviations and the nonlinearities over `time`, each a variable."""
        variables = {}
        for name, values in self.values.items():
            unit, meaning = _described(name)
            axes = ("time", "world")[: np.ndim(values)]
            variables[name] = Quantity(values, unit, meaning, axes)
            variables[f"{name}_sigma"] = Quantity(self.sigma[name], unit, f"standard deviation of: {meaning}", axes)
            of = f"second-order terms divided by the standard deviation of: {meaning}"
            variables[f"{name}_nonlinearity"] = Quantity(self.nonlinearity[name], "1", of, axes)
        omitted = max(
            (int(np.isnan(x).any(axis=tuple(range(1, x.ndim))).sum()) for x in self.sigma.values()), default=0
        )
        note = f"; unknown at {omitted} instants" if omitted else ""
        time = Quantity(self.time, "s", "time from the start of the path", ("time",))
        summary = f"{times_text(self.time)}: {', '.join(self.values)}{note}"
        return Record(summary, variables, {"time": time}, {"frame": "world"})


@of_one_device
def uncertainty(
    fitted: Fitted | FittedRoute,
    times: ArrayInput,
    quantities: Sequence[str | OwnQuantity] = DEFAULT,
    vehicle: Vehicle | None = None,
) -> Uncertainty:
    """Return quantities along a fitted path with their standard deviations, by the delta method.

    The covariance of the fit is propagated to first order, with exact derivatives of the formulas. The errors of the
    samples are assumed to be independent: if the errors of k successive samples are correlated, the standard deviations
    are about √k times larger. For a route, the covariance is that of the effect of these errors, plus the square of the
    expected error by smoothing, which is estimated from the route itself. It underestimates the error where the motion
    changes faster than the route can, as at the moment when a vehicle begins to brake. For a result of `fit`, see
    `Fitted.covariance`.

    At a stop of a route the quantities that need a direction of travel are undefined, and all standard deviations are
    NaN, because the fit decided that the vehicle is at rest. Next to a stop, where the route is a curve with a progress
    (see `fit_route`), the standard deviations are NaN, too.

    Args:
        fitted: The result of `fit` or `fit_route`.
        times: (n,) [s] from the start of the path, such as `track.elapsed`.
        quantities: Names: "heading" [rad], the direction of the horizontal velocity from the x axis to the left;
            "position", "velocity", "acceleration" and "jerk" (n, 3) in world axes; any path quantity that `evaluate`
            computes, such as "yaw_rate", "curvature" or "power"; and own quantities. By default "position", "heading",
            "horizontal_curvature", "yaw_rate" and "lateral_acceleration".
        vehicle: Needed for forces, power, friction, moments and steering.

    Returns:
        An `Uncertainty` with `values`, `sigma` and `nonlinearity`, by name.

    Raises:
        ValueError: If `fitted` is not the result of a fit, for an unknown quantity, a missing vehicle, times outside
            the path, or a result of an older `fit` without a covariance.

    Example:
        >>> import numpy as np, qtraj as qt
        >>> t = np.arange(0.0, 20.0, 0.1)
        >>> noise = np.random.default_rng(0).normal(0, 0.02, (200, 3))
        >>> fitted = qt.fit_route(qt.Track(t, np.stack([8 * t, 20 * np.sin(0.3 * t), 0 * t], 1) + noise))
        >>> found = qt.uncertainty(fitted, [5.0, 10.0], ["yaw_rate"])
        >>> bool(np.all(found.sigma["yaw_rate"] < 0.05))
        True
    """
    known = require_fit(fitted)
    if isinstance(quantities, str) or not isinstance(quantities, Sequence) or not quantities:
        raise ValueError(f"quantities must be a sequence of names, such as ['yaw_rate'], but {quantities!r} was given")
    names = list(dict.fromkeys(map(name_of, quantities)))
    entries = {name: output(name) for name in names if name not in VECTORS}
    t = instants(known, times)
    found = propagate(known, t, entries, road_of(vehicle, entries))
    parts: dict[str, Any] = {name: _vector(known, t, name) if name in VECTORS else found[name] for name in names}
    return Uncertainty(t, *({name: x[k] for name, x in parts.items()} for k in range(3)))


def require_fit(fitted: Any) -> Any:
    """Return the result of a fit in NumPy.

    **Raises:** ValueError for any other argument, and for a result without a covariance.
    """
    require_type(fitted, Fitted | FittedRoute, "fitted", "the result of qtraj.fit or qtraj.fit_route")
    if isinstance(fitted, Fitted) and not fitted.factor.size:
        raise ValueError("this result of fit has no covariance, because it was saved by an older version: fit again")
    if isinstance(fitted, FittedRoute) and not fitted.information.size:
        raise ValueError("this result of fit_route has no covariance: fit again")
    if isinstance(fitted, FittedRoute) and np.isnan(np.asarray(fitted.position_sigma)):
        raise ValueError(
            "fewer than eight samples do not determine the noise of a recording: pass position_sigma to fit_route"
        )
    return jax.tree.map(on_host, fitted)


def instants(fitted: Any, times: ArrayInput) -> Any:
    """Return times within the fitted path in seconds.

    **Raises:** ValueError for times of another shape, or outside the path.
    """
    t = np.asarray(seconds(times), float)
    if t.ndim != 1 or not t.size:
        raise ValueError(
            f"times must have shape (n,), with at least one instant, but an array of shape {t.shape} was given"
        )
    require_inside(t, fitted.path.duration, "path", extrapolates=False)
    return t


def output(name: Any) -> PathQuantity:
    """Return the quantity with this output of `evaluate`, or the heading.

    **Raises:** ValueError for an unknown name.
    """
    if isinstance(name, OwnName):
        return name.output
    if name not in ENTRIES:
        raise ValueError(f"unknown quantity {name!r}; the known quantities are {', '.join((*VECTORS, *ENTRIES))}")
    return ENTRIES[name]


def road_of(vehicle: Vehicle | None, entries: dict[Any, PathQuantity]) -> Any:
    """Return the parameters of the vehicle, which must be one that the quantities need."""
    if vehicle is not None:
        require_vehicle(vehicle, "the argument vehicle")
        if batch_of(vehicle):
            raise ValueError(f"one vehicle is needed, but the vehicles have the batch shape {batch_of(vehicle)}")
    for name, entry in entries.items():
        if entry.needs:
            require(vehicle, entry.needs, f"the quantity {name!r}")
    if vehicle is None:
        return NO_VEHICLE
    needs_road = any(entry.needs == VEHICLE for entry in entries.values())
    return vehicle.parameters(np.float64) if needs_road else fixed_parameters(vehicle, np.float64)


def _vector(fitted: Any, t: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    order = list(VECTORS).index(name)
    values = np.asarray(method(fitted.path, "sampled")(t, order)[order], float)
    covariance = motion_covariance(fitted, t, range(order, order + 1))
    sigma = np.sqrt(np.einsum("nkk->nk", covariance))
    return values, sigma, 0.0 * sigma


def _described(name: str) -> tuple[str, str]:
    if name in VECTORS:
        return VECTORS[name], f"{name}, world axes"
    entry = output(name)
    return entry.unit, entry.meaning
