"""Convert latitude, longitude and height to east, north and up [m] relative to a point, without approximation.

The ellipsoid is WGS 84 (NGA.STND.0036). Earth-fixed coordinates are computed in closed form; a translation and a
rotation transform them to the tangent plane. Therefore lengths and angles in space are exact, whereas a map projection
distorts them.
"""

from dataclasses import dataclass

import numpy as np

SEMI_MAJOR_AXIS = 6378137.0
"""Semi-major axis of WGS 84 [m]."""
FLATTENING = 1 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)

SCALED = 1e4
"""Size of a latitude above which it is probably in another unit than degrees."""

OPTIONS = (
    "projection='tangent-plane' (in a scenario projection = 'tangent-plane'): east, north and up coordinates in metres "
    "relative to the first sample, with the tangent plane of WGS 84 at this sample as the horizontal plane; or "
    "qtraj.TangentPlane(origin) (in a scenario origin = [latitude, longitude, height]) for another origin; on "
    "the command line --units position=deg"
)
"""The options for latitude and longitude, for error messages."""


@dataclass(frozen=True)
class TangentPlane:
    """Axes east, north and up at `origin`; in these axes, `origin` has the position (0, 0, 0).

    `origin` is (latitude [°], longitude [°], height above the ellipsoid [m]) on WGS 84, or None for the first sample of
    the recording. Distances and angles are exact. Because the Earth is curved, z is not the height: at 10 km from the
    origin, level ground is 7.8 m below the plane.

    **Raises:** ValueError if the origin is not three finite numbers, or for a latitude beyond ±90° or a longitude
    beyond ±360°.
    """

    origin: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.origin is None:
            return
        origin = np.asarray(self.origin, float)
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise ValueError(
                "the origin of a tangent plane must be [latitude °, longitude °, height m], but "
                f"{self.origin!r} was given"
            )
        _require_angles(origin[None], "the origin of a tangent plane")
        object.__setattr__(self, "origin", tuple(map(float, origin)))

    def project(self, geodetic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions (n, 3) [m] of samples, and the rotations (n, 3, 3) from their local axes to the plane.

        The columns of `geodetic` (n, 3) are latitude [°], longitude [°] and height above the ellipsoid [m]. Each
        rotation maps components along east, north and up at the sample to components along east, north and up at the
        origin. The recorded velocity and attitude of a sample refer to the axes at the sample.

        **Raises:** ValueError for a latitude beyond ±90° or a longitude beyond ±360°; the message contains the number
        of the sample.
        """
        geodetic = np.asarray(geodetic, float)
        _require_angles(geodetic, "the recording")
        origin = geodetic[:1] if self.origin is None else np.asarray([self.origin], float)
        plane = local_axes(origin)[0]
        offsets = earth_fixed(geodetic) - earth_fixed(origin)
        return offsets @ plane.T, plane @ np.swapaxes(local_axes(geodetic), -1, -2)


def place_text(latitude: float, longitude: float) -> str:
    """Return a place [°] for a message, such as "48.10° N, 11.50° E"."""
    north, east = "S" if latitude < 0 else "N", "W" if longitude < 0 else "E"
    return f"{abs(latitude):.2f}° {north}, {abs(longitude):.2f}° {east}"


def earth_fixed(geodetic: np.ndarray) -> np.ndarray:
    """Convert latitude [°], longitude [°] and height [m] to Earth-centred, Earth-fixed positions (n, 3) [m]."""
    latitude, longitude, height = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1]), geodetic[:, 2]
    normal = SEMI_MAJOR_AXIS / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    level = (normal + height) * np.cos(latitude)
    up = (normal * (1 - ECCENTRICITY_SQUARED) + height) * np.sin(latitude)
    return np.stack([level * np.cos(longitude), level * np.sin(longitude), up], axis=1)


def local_axes(geodetic: np.ndarray) -> np.ndarray:
    """Return the unit vectors east, north and up in Earth-fixed components, as the rows of matrices (n, 3, 3)."""
    latitude, longitude = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1])
    (s, c), (sl, cl) = (np.sin(latitude), np.cos(latitude)), (np.sin(longitude), np.cos(longitude))
    rows = [[-sl, cl, 0 * s], [-s * cl, -s * sl, c], [c * cl, c * sl, s]]
    return np.moveaxis(np.array(rows), -1, 0)


def _require_angles(geodetic: np.ndarray, what: str) -> None:
    bad = np.flatnonzero((np.abs(geodetic[:, 0]) > 90) | (np.abs(geodetic[:, 1]) > 360))
    if bad.size:
        latitude, longitude = geodetic[bad[0], :2].tolist()
        scaled = (
            ' Otherwise, if they are in 1e-7 degrees, pass units={"position": "1e-7 deg"}; in semicircles, as in '
            'files of Garmin, pass units={"position": "semicircles"}.'
            if abs(latitude) > SCALED
            else ""
        )
        raise ValueError(
            f"{what} has latitude {latitude:.9g}° and longitude {longitude:.9g}° (sample {bad[0]}), but a latitude "
            "must be within ±90° and a longitude within ±360°. Name the columns in the order latitude, longitude, "
            f"height.{scaled}"
        )
