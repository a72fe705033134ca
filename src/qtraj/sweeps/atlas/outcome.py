"""The result of an atlas: classified points, the leaves between them, and the border of the feasible points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.drawing import draw
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import ArrayInput
from qtraj.foundation.units import with_unit
from qtraj.sweeps.atlas.axis import AtlasAxis
from qtraj.sweeps.atlas.border import border_lines
from qtraj.sweeps.atlas.classified import CLASSES, FEASIBLE, SAMPLED
from qtraj.sweeps.atlas.lookup import interpolated, nearest_corner

if TYPE_CHECKING:
    import os

    from matplotlib.figure import Figure

VALUE_UNITS = {"duration": "s"}
"""Units of values that `tuned_points` returns; all others have none or an unknown one."""


@storable
class Atlas(AbstractOutcome):
    """Classified points of a plane of two parameters, dense along the borders between the classes.

    - `x_axis`, `y_axis`: the parameters with their ranges and tolerances, each an `AtlasAxis`.
    - `lattice` (n, 2): the positions of the points, counted from 0 on the lattice of the finest cells.
    - `leaves` (m, 3): the squares between the points: the position of the first corner, and the size.
    - `codes` (n,): the class of each point, an index into "feasible", "sampled", "infeasible", "undecided", "failed".
    - `limit_codes` (n,): the limit of each point, an index into `limit_names`.
    - `values`: numbers of the points by name, (n,); NaN where unknown.
    - `refined`: the borders that were followed, as in `atlas`.
    - `code`: a `ResultCode`; `result` describes the atlas in words.
    """

    x_axis: AtlasAxis
    y_axis: AtlasAxis
    lattice: Int[np.ndarray, "n 2"]
    leaves: Int[np.ndarray, "m 3"]
    codes: Int[np.ndarray, " n"]
    limit_codes: Int[np.ndarray, " n"]
    limit_names: tuple[str, ...] = eqx.field(static=True)
    values: dict[str, Float[Array, " n"]]
    refined: str = eqx.field(static=True)
    code: Int[Array, ""]

    def __init__(
        self,
        x_axis: AtlasAxis,
        y_axis: AtlasAxis,
        lattice: ArrayInput,
        leaves: ArrayInput,
        codes: ArrayInput,
        limit_codes: ArrayInput,
        limit_names: Sequence[str],
        values: dict[str, Any],
        refined: str = "feasible",
        code: ArrayInput = 0,
    ):
        self.x_axis, self.y_axis, self.refined = x_axis, y_axis, refined
        self.lattice, self.leaves, self.codes, self.limit_codes = (
            np.asarray(x, np.int64) for x in (lattice, leaves, codes, limit_codes)
        )
        self.limit_names = tuple(limit_names)
        self.values = {name: as_float(x) for name, x in values.items()}
        self.code = as_array(code, jnp.int32)

    @property
    def cells(self) -> tuple[int, int]:
        """Number of the finest cells along x and y, with which a grid would have the same tolerance."""
        levels = max(self.x_axis.levels, self.y_axis.levels)
        return self.x_axis.steps * 2**levels, self.y_axis.steps * 2**levels

    @property
    def x(self) -> np.ndarray:
        """The values of the first parameter at the points, (n,)."""
        return self.x_axis.at(self.lattice[:, 0], self.cells[0])

    @property
    def y(self) -> np.ndarray:
        """The values of the second parameter at the points, (n,)."""
        return self.y_axis.at(self.lattice[:, 1], self.cells[1])

    @property
    def status(self) -> np.ndarray:
        """The class of each point as a string, (n,)."""
        return np.asarray(CLASSES)[self.codes]

    @property
    def first_limit(self) -> np.ndarray:
        """The limits that are met first at each point, (n,), joined by " + "; "" for none."""
        return np.asarray(self.limit_names)[self.limit_codes]

    @property
    def evaluations(self) -> int:
        """Number of points, each of which was computed once."""
        return len(self.codes)

    @property
    def border(self) -> list[np.ndarray]:
        """The border between the feasible points and all others as lines, each (k, 2) with x and y.

        Points that were only sampled count as feasible. The border passes between the neighbouring points of different
        classes: it is at most half a tolerance from the true border along one of the axes. A closed line ends at its
        first point.
        """
        inside = dict(zip(map(tuple, self.lattice.tolist()), (self.codes <= SAMPLED).tolist(), strict=True))
        leaves = [(i, j, s) for i, j, s in self.leaves.tolist()]
        return [self._placed(line) for line in border_lines(leaves, inside)]

    @property
    def shares(self) -> dict[str, float]:
        """The share of the area of each class that occurs; a leaf counts by its corners."""
        four = nearest_corner(self.lattice, self.leaves)
        area = np.repeat(self.leaves[:, 2:].astype(float) ** 2, 4, axis=1) / 4
        sums = np.bincount(self.codes[four].ravel(), area.ravel(), len(CLASSES)) / area.sum()
        return {name: float(share) for name, share in zip(CLASSES, sums, strict=True) if share > 0}

    def at(self, x: ArrayInput, y: ArrayInput) -> dict[str, np.ndarray]:
        """Return class, limit and values between the points, without computing new ones.

        Args:
            x: Values of the first parameter, of any shape, inside its range.
            y: Values of the second parameter; both shapes are broadcast.

        Returns:
            "status" and "first_limit" of the nearest corner of the leaf, and each of `values`: linear between the
            corners, and that of the nearest corner where the corners have different classes.

        Raises:
            ValueError: For values outside the range of the atlas.

        Example:
            >>> import qtraj as qt
            >>> x, y = (qt.AtlasAxis(name, 0.0, 2.0, tolerance=0.1) for name in "xy")
            >>> disc = qt.atlas(lambda x, y: x**2 + y**2 < 1, x, y)
            >>> disc.at([0.2, 1.5], 0.3)["status"]
            array(['feasible', 'infeasible'], dtype='<U10')
        """
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        units = [self._units(axis, v.ravel(), n) for axis, v, n in zip(self._axes, (x, y), self.cells, strict=True)]
        nearest, weights, four = interpolated(self.lattice, self.leaves, np.stack(units, axis=1))
        agree = (self.codes[four] == self.codes[four[:, :1]]).all(axis=1)
        found = {"status": self.status[nearest], "first_limit": self.first_limit[nearest]}
        for name, values in self.values.items():
            known = np.asarray(values)
            linear = np.sum(weights * known[four], axis=1)
            found[name] = np.where(agree & np.isfinite(linear), linear, known[nearest])
        return {name: values.reshape(x.shape) for name, values in found.items()}

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the atlas: areas, limits, the tolerance, the number of points, and what may be missing."""
        shares = ", ".join(f"{name} {100 * share:.3g} %" for name, share in self.shares.items())
        grid = (self.cells[0] + 1) * (self.cells[1] + 1)
        widths = [(axis.high - axis.low) / axis.steps for axis in self._axes]
        coarse = " × ".join(with_unit(w, axis.unit) for w, axis in zip(widths, self._axes, strict=True))
        ranges = [axis.high - axis.low for axis in self._axes]
        fine = [with_unit(r / n, axis.unit) for r, n, axis in zip(ranges, self.cells, self._axes, strict=True)]
        followed = f"Borders are known to {' × '.join(fine)}"
        if int(self.code) != ResultCode.successful:
            followed = "Not all borders were followed to the tolerance: pass a larger max_evaluations or tolerance"
        return (
            f"{shares} of the area. {followed}, from {self.evaluations} points ({100 * self.evaluations / grid:.3g} % "
            f"of a grid). Regions smaller than the coarse cells, {coarse}, may be missing."
        )

    def plot(self, value: str | None = None) -> Figure:
        """Draw the classes, the limits and the border, with a value as colour and contour lines (extra `viz`).

        Args:
            value: The name of the value inside the feasible region; by default "duration" if there is one.

        Returns:
            A Matplotlib figure.

        Raises:
            ModuleNotFoundError: With the extra to install, if matplotlib is missing.
            ValueError: For a value that the atlas does not contain.
        """
        return draw("atlas_plot", self, value)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the atlas to a TOML or JSON file; `qtraj.load` reads the file.

        **Raises:** ValueError if the suffix is neither .toml nor .json; OSError if the file cannot be written.
        """
        document.save(self, file)

    def record(self) -> Record:
        """Return the points over the dimension `point`, and the border over `vertex`, with the number of its line."""
        point, vertex = ("point",), ("vertex",)
        lines = self.border
        corner = np.concatenate(lines) if lines else np.zeros((0, 2))
        number = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
        variables = {
            "status": Quantity(self.status, "", f"class of the point: one of {', '.join(CLASSES)}", point),
            "first_limit": Quantity(self.first_limit, "", "limits that are met first, joined by +", point),
            **{
                name: Quantity(values, VALUE_UNITS.get(name, ""), name.replace("_", " "), point)
                for name, values in self.values.items()
            },
            "border_line": Quantity(number, "1", "number of the line of the border", vertex),
        }
        for k, axis in enumerate(self._axes):
            meaning = f"{axis.name} on the border of the feasible points"
            variables[f"border_{'xy'[k]}"] = Quantity(corner[:, k], axis.unit, meaning, vertex)
        coordinates = {
            axis.name: Quantity(values, axis.unit, axis.name.replace("_", " "), point)
            for axis, values in zip(self._axes, (self.x, self.y), strict=True)
        }
        shares = ", ".join(f"{name} {100 * share:.3g} %" for name, share in self.shares.items())
        summary = f"{self.x_axis.name} × {self.y_axis.name}, {self.evaluations} points: {shares}"
        return Record(summary, variables, coordinates)

    @property
    def _axes(self) -> tuple[AtlasAxis, AtlasAxis]:
        return self.x_axis, self.y_axis

    def _placed(self, line: np.ndarray) -> np.ndarray:
        """Return points on the lattice in the units of the axes."""
        return np.stack([axis.at(line[:, k], self.cells[k]) for k, axis in enumerate(self._axes)], axis=1)

    @staticmethod
    def _units(axis: AtlasAxis, values: np.ndarray, count: int) -> np.ndarray:
        """Return values of a parameter in units of the lattice.

        **Raises:** ValueError for values outside the axis.
        """
        outside = values[~((values >= axis.low) & (values <= axis.high))]
        if outside.size:
            raise ValueError(f"the atlas contains {axis.name} from {axis.low} to {axis.high}, but not {outside[0]}")
        return (values - axis.low) / (axis.high - axis.low) * count


FOLLOWED = {
    "feasible": lambda status, limit: (status > SAMPLED).astype(int),
    "status": lambda status, limit: status,
    "limit": lambda status, limit: np.where(status > FEASIBLE, status + len(CLASSES) * (1 + limit), status),
}
"""The kinds of points between which borders are followed, from the codes of their classes and limits."""
