"""Read a line of a GeoJSON file (RFC 7946): longitudes, latitudes and heights."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.untrusted import decoded, parse_json
from qtraj.io.track.column_table import ColumnTable

START = 2**16
"""Number of bytes at the start of a file among which the type is sought."""

_TYPE = re.compile(
    rb'"type"\s*:\s*"(Feature|FeatureCollection|GeometryCollection|(Multi)?(Point|LineString|Polygon))"', re.ASCII
)
_OBJECT = re.compile(rb"(\xef\xbb\xbf)?\s*\{")
_WGS84 = re.compile(r"CRS:?:?84|EPSG:?:?:?4326|4979", re.IGNORECASE)


def is_geojson(data: bytes) -> bool:
    """Return whether the content of a file is a GeoJSON object."""
    return _OBJECT.match(data) is not None and _TYPE.search(data[:START]) is not None


def read_geojson(path: Path, data: bytes) -> tuple[ColumnTable, list[int], tuple[str, ...]]:
    """Return the points of all lines, the first points of further lines, and notes about what was left out.

    **Raises:** ValueError for a file that is not valid, has other coordinates than WGS 84, or contains no line.
    """
    try:
        content = parse_json(decoded(path, data))
    except ValueError as error:
        raise ValueError(f"{path}: not valid GeoJSON: {str(error).removeprefix(f'{path}: ')}") from None
    _require_wgs84(path, content)
    geometries = list(_geometries(content))
    lines = [line for geometry in geometries for line in _lines(geometry)]
    if not lines:
        kinds = sorted({str(x.get("type"))[:40] for x in geometries}) or ["none"]
        raise ValueError(
            f"{path}: a shape is a LineString, but the geometries of this file are {', '.join(kinds)}: export the line "
            "as a LineString"
        )
    points = [_points(path, line, k) for k, line in enumerate(lines)]
    spatial = all(x.shape[1] == 3 for x in points)
    rows = np.concatenate([x[:, : 3 if spatial else 2] for x in points])
    columns = {"longitude": rows[:, 0], "latitude": rows[:, 1]} | ({"height": rows[:, 2]} if spatial else {})
    others = len(geometries) - sum(x.get("type") in ("LineString", "MultiLineString") for x in geometries)
    notes = (f"{others} geometries other than lines left out",) if others else ()
    return ColumnTable(columns, "point"), np.cumsum([len(x) for x in points])[:-1].tolist(), notes


def _geometries(value: Any) -> Iterator[dict[str, Any]]:
    """Return the geometries of an object, which may be a Feature or a collection; `parse_json` limits its depth."""
    if not isinstance(value, dict):
        return
    for key in ("features", "geometries"):
        items = value.get(key)
        for item in items if isinstance(items, list) else ():
            yield from _geometries(item)
    if isinstance(value.get("geometry"), dict):
        yield from _geometries(value["geometry"])
    if "coordinates" in value:
        yield value


def _lines(geometry: dict[str, Any]) -> list[Any]:
    kind, coordinates = geometry.get("type"), geometry["coordinates"]
    if kind == "LineString":
        return [coordinates]
    return coordinates if kind == "MultiLineString" and isinstance(coordinates, list) else []


def _points(path: Path, line: Any, index: int) -> np.ndarray:
    expected = "points [longitude, latitude] or [longitude, latitude, height]"
    fault = ValueError(f"{path}: line {index + 1} must be a list of {expected}, with finite numbers of equal count")
    try:
        found = np.array(line, float)
    except (TypeError, ValueError, OverflowError):
        raise fault from None
    if found.ndim != 2 or len(found) < 2 or found.shape[1] < 2 or not np.isfinite(found).all():
        raise fault
    return found[:, :3]


def _require_wgs84(path: Path, content: Any) -> None:
    crs = content.get("crs") if isinstance(content, dict) else None
    if crs is not None and not _WGS84.search(str(crs)):
        raise ValueError(
            f"{path}: the coordinates must be longitude and latitude (WGS 84), but the file has another reference "
            "system (crs): export it in EPSG:4326, or write x and y in metres to a CSV file"
        )
