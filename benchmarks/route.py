"""Fit a route to a whole recorded drive: measure its accuracy, its yaw rate and the run times.

Run `python -m benchmarks.route FILE` with a CSV file that `read_track` can read. If the file contains angular rates,
the yaw rate of the route is compared with them. Times are processor times of all threads.
"""

import argparse
import time

import jax
import numpy as np

import qtraj as qt
from qtraj.motion.rate_residual import MIN_SPEED

LIMITS = {"curvature": 0.3, "lateral_acceleration": 6.0, "jerk": 60.0, "yaw_rate": 1.2}


def timed(call, repeats=7):
    """Return the result of a call, the processor time [s] of the first call, and the minimum over later calls."""
    times = []
    for _ in range(repeats + 1):
        start = time.process_time()
        result = call()
        times.append(time.process_time() - start)
    return result, times[0], min(times[1:])


def prediction(track):
    """Return the distances [m] of every other sample from a route that is fitted to the remaining samples only."""
    parts = (track.times, track.positions, track.velocities)
    kept = qt.Track(*(None if x is None else np.asarray(x)[::2] for x in parts))
    route = qt.fit_route(kept).path
    left = slice(1, 2 * (len(kept.times) - 1), 2)
    found = qt.evaluate(route, np.asarray(track.elapsed)[left], ("position",)).position
    return np.linalg.norm(np.asarray(found) - np.asarray(track.positions)[left], axis=1)


def main():
    """Print the results for one file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file")
    file = parser.parse_args().file
    jax.config.update("jax_enable_x64", True)
    track = qt.read_track(file)
    found, first, warm = timed(lambda: qt.fit_route(track))
    print(f"fit: first {first:.2f} s, warm {1e3 * warm:.0f} ms; {found!r}")
    print(f"smoothing {float(found.smoothing):.3g} s^5, length {float(found.path.length()):.0f} m")
    errors = prediction(track)
    print(
        f"predicted: {1e3 * np.sqrt(np.mean(errors**2)):.2f} mm RMS, {1e3 * np.quantile(errors, 0.95):.2f} mm at 95 %"
    )
    if found.rates is not None:
        rms, correlation = float(found.rates.rms[-1]), float(found.rates.correlation[-1])
        print(f"yaw rate above {MIN_SPEED} m/s: {rms:.4f} rad/s RMS, correlation {correlation:.4f}")
    certificate, first, warm = timed(lambda: qt.certify(found.path, qt.Limits(**LIMITS)))
    print(f"certify: first {first:.1f} s, warm {1e3 * warm:.0f} ms; {certificate!r}")


if __name__ == "__main__":
    main()
