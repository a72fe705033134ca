"""Find units and axes of a recording that are probably wrong, and say what to write instead."""

from collections.abc import Iterator, Sequence

import numpy as np

from qtraj.foundation.size_text import length_text
from qtraj.io.track.tangent_plane import place_text
from qtraj.io.track.track_facts import Columns
from qtraj.path.track import Track

AGREEMENT = 0.05
"""Relative deviation at which a ratio is taken for the ratio of two units."""

SPEED_RATIOS = {
    3.6: ("velocity", "km/h"),
    1 / 0.514444: ("velocity", "kn"),
    1 / 0.44704: ("velocity", "mph"),
    1 / 0.3048: ("velocity", "ft/s"),
    1e-3: ("position", "mm"),
    1e-2: ("position", "cm"),
    1e3: ("position", "km"),
}
"""Ratios of recorded speeds to the speeds of the positions, and the unit that explains each of them."""

FAST = 350.0
"""Median speed [m/s] above which a recording is odd."""

SLOW, LONG_STEP, LEAST = 0.05, 5.0, 20
"""Median speed [m/s], median time step [s] and number of samples at which times are probably in ms, µs or ns."""

HIGH = 5e4
"""Height [m] above which the height is probably in another unit."""

SPINNING = 10.0
"""Angular rate [rad/s] above which rates are probably in degrees per second."""

POLAR = 75.0
"""Latitude [°] beyond which latitude and longitude are probably exchanged."""

IN_RADIANS = (np.pi / 2, np.pi)
"""Latitude and longitude [°], in the ocean, within which both are probably in radians."""

EARTH_RADIUS, ABOVE_GROUND = (6.33e6, 6.4e6), 2e4
"""Distances [m] from the Earth's centre to its surface, and a height [m] that map coordinates do not reach."""


def oddities(
    track: Track, columns: Columns, origin: Sequence[float] | None = None, unordered: tuple[str, ...] | None = None
) -> tuple[str, ...]:
    """Return a text about each odd property of a recording.

    `origin`: latitude and longitude [°], and perhaps the height [m], of the first sample. `unordered`: columns of a
    quaternion that were left out.
    """
    times, positions = np.asarray(track.times), np.asarray(track.positions)
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) / np.diff(times)
    speed = float(np.median(speeds))
    found = [*_of_speed(track, speed), *_of_velocities(track, speed), *_of_rates(track)]
    found += [*_of_origin(origin), *_of_axes(columns, positions), *_of_the_earth(columns, positions)]
    if unordered:
        found.append(
            f"the columns {', '.join(unordered)} are a quaternion whose order their names do not tell, so the attitude "
            "was left out: pass quaternion='wxyz' (scalar first) or 'xyzw' (scalar last)"
        )
    return tuple(found)


def _of_speed(track: Track, speed: float) -> Iterator[str]:
    if speed > FAST:
        unit = next((unit for unit, factor in (("cm", 1e-2), ("mm", 1e-3)) if speed * factor < 50), None)
        advice = f' or, if positions are in {unit}, units={{"position": "{unit}"}}' if unit else ""
        yield (
            f'the median speed is {speed:.3g} m/s: if the times are in another unit, pass units={{"time": ...}}{advice}'
        )
    if _is_slow(track, speed):
        step = float(np.median(np.diff(np.asarray(track.times))))
        unit = next((unit for unit, factor in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if speed * factor > 0.3), "ns")
        yield (
            f"the median speed is {speed:.3g} m/s at steps of {step:.6g} s: if the times are in {unit}, pass "
            f'units={{"time": "{unit}"}}'
        )


def _is_slow(track: Track, speed: float) -> bool:
    """Return whether the times are probably in ms, µs or ns."""
    step = float(np.median(np.diff(np.asarray(track.times))))
    moves = float(np.ptp(np.asarray(track.positions), axis=0).max())
    return 0 < speed < SLOW and step >= LONG_STEP and len(track.times) >= LEAST and moves > 1


def _of_velocities(track: Track, speed: float) -> Iterator[str]:
    """Compare recorded velocities with the positions where the vehicle moves."""
    if track.velocities is None or _is_slow(track, speed):  # the unit of the times, which is named, explains the ratio
        return
    recorded = np.linalg.norm(np.asarray(track.velocities), axis=1)
    recorded = (recorded[1:] + recorded[:-1]) / 2
    speeds = np.linalg.norm(np.diff(np.asarray(track.positions), axis=0), axis=1) / np.diff(np.asarray(track.times))
    moving = (recorded > 0.2 * recorded.max(initial=0.0)) & (speeds > 0)
    if moving.sum() < 3:
        return
    ratio = float(np.median(recorded[moving] / speeds[moving]))
    if 0.8 < ratio < 1.25:
        return
    known = next((unit for value, unit in SPEED_RATIOS.items() if abs(ratio / value - 1) < AGREEMENT), None)
    part, unit = known or ("velocity", "...")
    yield (
        f"the recorded velocities are {ratio:.3g} times the velocities of the positions: "
        + (f"if the {part} is in {unit}, " if known else "check the units, and ")
        + f'pass units={{"{part}": "{unit}"}}'
    )


def _of_rates(track: Track) -> Iterator[str]:
    if track.rates is not None and (size := float(np.quantile(np.abs(np.asarray(track.rates)), 0.99))) > SPINNING:
        yield (
            f"the recorded angular rates reach {size:.3g} rad/s: if they are in degrees per second, pass "
            'units={"rate": "deg/s"}'
        )


def rows_without_a_fix(angles: np.ndarray) -> Iterator[str]:
    """Find rows whose latitude and longitude (n, 2) are 0, which receivers write before they know their position."""
    count = int((angles == 0).all(axis=1).sum())
    if count:
        yield (
            f"the latitude and the longitude are 0 in {count} of {len(angles)} rows, as receivers write them without a "
            "position fix: delete these rows"
        )


def _of_origin(origin: Sequence[float] | None) -> Iterator[str]:
    if origin is not None and len(origin) > 2 and abs(origin[2]) > HIGH:
        yield (
            f"the recording starts at a height of {length_text(origin[2])}: if the height is in mm, add the unit to "
            "the name of its column, such as alt_mm"
        )
    if origin is None or origin[0] == origin[1] == 0:
        return
    place = place_text(origin[0], origin[1])
    if abs(origin[0]) <= IN_RADIANS[0] and abs(origin[1]) <= IN_RADIANS[1]:
        yield (
            f"the recording starts at {place}, in the Atlantic Ocean: if latitude and longitude are in "
            'radians, pass units={"position": "rad"}'
        )
    if abs(origin[0]) > POLAR and abs(origin[1]) <= 90:
        yield (
            f"the recording starts at {place}: if latitude and longitude are exchanged, "
            "exchange the names of their columns"
        )


def _of_axes(columns: Columns, positions: np.ndarray) -> Iterator[str]:
    """Find positions that move in x and z, but hardly in y, as those of a camera do."""
    x, y, z = np.ptp(positions, axis=0).tolist()
    if columns.axes["position"] != "enu" or min(x, z) < 10 * y or min(x, z) == 0:
        return
    if abs(np.corrcoef(positions[:, 0], positions[:, 2])[0, 1]) < 0.95:
        yield (
            f"the positions extend over {length_text(x)}, {length_text(y)} and {length_text(z)} along x, y and z: if "
            "the vertical is -y, as for a camera, pass axes='camera'"
        )


def _of_the_earth(columns: Columns, positions: np.ndarray) -> Iterator[str]:
    """Find positions relative to the centre of the Earth, whose third axis is not up."""
    if columns.axes["position"] == "geographic" or np.abs(positions[:, 2]).min() < ABOVE_GROUND:
        return
    distances = np.linalg.norm(positions, axis=1)
    if EARTH_RADIUS[0] < distances.min() and distances.max() < EARTH_RADIUS[1]:
        yield (
            f"the positions are {length_text(distances[0])} from the origin, as those relative to the centre of the "
            "Earth (ECEF), whose z axis is not up: convert them to latitude, longitude and height, for example with "
            "pyproj: Transformer.from_crs(4978, 4979)"
        )
