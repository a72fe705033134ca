"""Files of fixed formats with random variations and faults: TUM, KITTI, EuRoC, GPX, AIS, race lines and others."""

import numpy as np
from tests.io import drive, test_gpx as gpx
from tests.io.generated_columns import numbers, pick
from tests.io.generated_tables import Case

QUATERNIONS = drive.ROTATIONS.as_quat(scalar_first=True)
TIMES = r"pass rate= \(samples per second\)"


def tum(rng):
    """Times with four decimals at 300 Hz, so that rows share a time; perhaps one that jumps."""
    rows = np.arange(drive.COUNT)
    words, options = "", {}
    k = int(rng.integers(5, 30))
    positions = drive.POSITIONS.copy()
    fault = pick(rng, "", "", "close", "far", "first", "comment", "wxyz")
    if fault in ("close", "far", "first"):
        rows = np.insert(rows, k, k)
        positions = positions[rows]
        positions[k] += 1e-4 if fault == "close" else 50.0
        words = "duplicates='first'" if fault == "far" else ""
        options = {"duplicates": "last"} if fault == "first" else {}
    else:
        positions = positions[rows]
    first = fault == "wxyz"
    options |= {"quaternion": "wxyz"} if first else {}
    q = QUATERNIONS if first else np.roll(QUATERNIONS, -1, axis=1)
    stamps = numbers(1311868164.5 + drive.SECONDS[rows], pick(rng, 1, 4, 6))
    cells = zip(stamps, *(numbers(c, 6) for c in np.column_stack([positions, q[rows]]).T), strict=True)
    head = ["# ground truth trajectory", "# timestamp tx ty tz qx qy qz qw"] if fault == "comment" else []
    data = "\n".join([*head, *map(pick(rng, " ", " ", "  ").join, cells)]) + "\n"
    return Case(data.encode(), pick(rng, "a.txt", "a.tum"), options, words, attitudes=QUATERNIONS)


def kitti(rng):
    """Poses of a camera without times."""
    matrices = drive.CAMERA.T @ drive.ROTATIONS.as_matrix() @ drive.CAMERA_BODY
    poses = np.concatenate([matrices, (drive.POSITIONS @ drive.CAMERA)[:, :, None]], axis=2).reshape(-1, 12)
    data = "\n".join(" ".join(f"{x:.8e}" for x in row) for row in poses) + pick(rng, "", "\n", "\n\n")
    options, words = pick(rng, ({"rate": 2.0}, ""), ({"rate": 2.0, "axes": "camera"}, ""), ({}, "rate="))
    return Case(data.encode(), "00.txt", options, words, attitudes=QUATERNIONS)


def euroc(rng):
    """Ground truth of a drone, with biases at the end, or without."""
    names = "p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
    columns = [drive.POSITIONS, QUATERNIONS]
    if rng.random() < 0.7:
        names += ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]"
        columns.append(drive.VELOCITIES)
    if rng.random() < 0.5:
        names += ", b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1]"
        columns.append(0 * drive.POSITIONS)
    join = pick(rng, ",", ", ")
    stamps = [str(1_403_636_580_838_555_648 + round(10 * s) * 10**8) for s in drive.SECONDS]
    cells = zip(stamps, *(numbers(c, 7) for c in np.concatenate(columns, axis=1).T), strict=True)
    mark = pick(rng, "#", "# ")
    data = "\n".join([f"{mark}timestamp{pick(rng, ' [ns]', '')}, {names}", *map(join.join, cells)])
    return Case(data.encode(), "data.csv", {}, attitudes=QUATERNIONS)


def track_gpx(rng):
    """GPX with its faults: each with a probability, several at once."""
    count = drive.COUNT
    places = drive.geodetic(drive.POSITIONS)
    timed = rng.random(count) < pick(rng, 1.0, 1.0, 0.7, 0.0)
    high = rng.random(count) < pick(rng, 1.0, 1.0, 0.9, 0.0)
    back = int(rng.integers(10, 30)) if rng.random() < 0.2 else count
    seconds = drive.SECONDS - np.where(np.arange(count) >= back, 8.0, 0.0)
    more = gpx.EXTENSION if rng.random() < 0.4 else ""
    name = pick(rng, "trkpt", "trkpt", "trkpt", "rtept", "wpt")
    points = []
    for k, (place, second) in enumerate(zip(places, seconds, strict=True)):
        ele = f"<ele>{place[2]:.4f}</ele>" if high[k] else ""
        time = f"<time>{gpx.stamp(second, 3)}</time>" if timed[k] else ""
        points.append(f'<{name} lat="{place[0]:.9f}" lon="{place[1]:.9f}">{ele}{time}{more}</{name}>')
    cuts = sorted(rng.integers(0, count, int(rng.integers(0, 4))).tolist())
    parts = [points[a:b] for a, b in zip([0, *cuts], [*cuts, count], strict=True)]
    body = {"trkpt": gpx.track(*parts), "rtept": f"<rte>{''.join(points)}</rte>"}.get(name, "".join(points))
    version = pick(rng, "1.0", "1.1")
    text = f'<?xml version="1.0"{pick(rng, "", " encoding=" + chr(34) + "UTF-8" + chr(34))}?>\n'
    text += f'<gpx version="{version}" xmlns="http://www.topografix.com/GPX/{version.replace(".", "/")}" '
    text += f'xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v1">{body}</gpx>'
    data = text.encode(pick(rng, "utf-8", "utf-8-sig"))
    words = "export the track" if name == "wpt" else "" if timed.any() else "Pass rate="
    words = words or ("pass segment=1" if (timed & (np.arange(count) >= back)).any() and timed[:back].any() else "")
    rows = np.flatnonzero(timed)
    flat = 2 * high[rows].sum() < len(rows)
    expected = drive.POSITIONS[rows] * [1, 1, 0 if flat else 1]
    return Case(data, "a.gpx", {}, words, drive.SECONDS[rows], expected, tolerance=0.02 if high.all() else 0.2)


def ais(rng):
    """Positions of one vessel, or of two, which are not mixed."""
    places = drive.geodetic(drive.POSITIONS * [1, 1, 0])
    two = rng.random() < 0.3
    rows = []
    for k, second in enumerate(drive.SECONDS):
        for ship in range(1 + two):
            stamp = f"06/05/2026 {drive.clock(second, '')}"
            rows.append(f"{stamp},{219000000 + ship},{places[k, 0]:.9f},{places[k, 1] + ship:.9f},15.6,90.0,88")
    head = pick(rng, "# ", "") + "Timestamp,MMSI,Latitude,Longitude,SOG,COG,Heading"
    data = "\n".join([head, *rows])
    return Case(
        data.encode(),
        "ais.csv",
        {},
        "several vehicles" if two else "",
        positions=drive.POSITIONS * [1, 1, 0],
        tolerance=0.05,
    )


def race_line(rng):
    """Distances, headings and speeds instead of times."""
    flat = drive.POSITIONS * [1, 1, 0]
    fine = np.linspace(0, drive.SECONDS[-1], 20 * drive.COUNT - 19)
    x, y = 8 * fine, 30 * np.sin(fine / 9)
    s = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])[::20]
    v = np.hypot(8, 30 / 9 * np.cos(drive.SECONDS / 9))
    join = pick(rng, "; ", ";", ",")
    names = join.join(["s_m", "x_m", "y_m", "psi_rad", "kappa_radpm", "vx_mps", "ax_mps2"])
    columns = np.column_stack([s, flat[:, :2], drive.HEADING, 0 * s, v, 0 * s])
    rows = [join.join(numbers(row, 7)) for row in columns]
    data = "\n".join(["# 9b3e", "# a race line", f"# {names}", *rows])
    return Case(data.encode(), "race.csv", {}, positions=flat, times=drive.SECONDS, time_tolerance=1e-3)


def centre_line(rng):
    """The centre line of a race track, which is a shape."""
    columns = np.column_stack([drive.POSITIONS[:, :2], np.full((drive.COUNT, 2), 7.5)])
    mark = pick(rng, "# ", "#", "")
    data = "\n".join([f"{mark}x_m,y_m,w_tr_right_m,w_tr_left_m", *(",".join(numbers(row, 6)) for row in columns)])
    options = pick(rng, {}, {"rate": 2.0})
    words = "" if options else "is a shape, not a track"
    return Case(data.encode(), "track.csv", options, words, positions=drive.POSITIONS * [1, 1, 0])


def headers(rng):
    """Several lines above the names of the columns."""
    lines = ["robot,x", "frame,cog", "time,px,py,pz,qw,qx,qy,qz"][int(rng.integers(2)) :]
    rows = np.column_stack([drive.SECONDS, drive.POSITIONS, QUATERNIONS])
    data = "\n".join([*lines, *(",".join(numbers(row, 7)) for row in rows)])
    return Case(data.encode(), pick(rng, "a.csv", "a.txt"), {}, attitudes=QUATERNIONS)


def autopilot(rng):
    """Whole numbers without a unit, and north, east, down by an option; the velocities tell the unit."""
    factor = pick(rng, 10**3, 10**6, 10**9)
    stamps = [str(500 * factor + round(s * 10) * factor // 10) for s in drive.SECONDS]
    columns = np.column_stack([drive.ned(drive.POSITIONS), drive.ned(drive.VELOCITIES)])
    cells = zip(stamps, *(numbers(c, 6) for c in columns.T), strict=True)
    data = "\n".join(["timestamp,x,y,z,vx,vy,vz", *map(",".join, cells)])
    return Case(data.encode(), "log.csv", {"axes": "ned"}, velocities=drive.VELOCITIES)


def waypoints(rng):
    """Five points with times."""
    rows = np.arange(0, drive.COUNT, 8)
    columns = np.column_stack([drive.SECONDS, drive.POSITIONS])[rows]
    join = pick(rng, ",", ";", "\t", " ")
    data = "\n".join([join.join("txyz"), *(join.join(numbers(row, 4)) for row in columns)])
    return Case(data.encode(), "way.csv", {}, times=drive.SECONDS[rows], positions=drive.POSITIONS[rows])


KINDS = {
    "tum": tum,
    "kitti": kitti,
    "euroc": euroc,
    "gpx": track_gpx,
    "ais": ais,
    "race line": race_line,
    "centre line": centre_line,
    "headers": headers,
    "autopilot": autopilot,
    "waypoints": waypoints,
}
