"""Datasets for reports, from closed forms and without JAX."""

import numpy as np
import xarray
from tests.viz.instants import Column, instants_dataset

HOSTILE = "</script><script>window.hacked = 1</script>"
IMAGE = "<img src=x onerror='window.hacked = 2'>&amp; <b>x</b> %{x} \u2028"
RADIUS, RATE, CLIMB, TIMES = 10.0, 0.4, 0.5, {"slow": 20.0, IMAGE: 10.0}
CENTRE = np.array([600000.0, 4800000.0, 150.0])
SAMPLES = 65


def helix(time, rate):
    """Position, velocity and direction cosines of a helix about the vertical."""
    angle, zero, one = rate * time, np.zeros_like(time), np.ones_like(time)
    cosine, sine = np.cos(angle), np.sin(angle)
    position = CENTRE + np.stack([RADIUS * cosine, RADIUS * sine, CLIMB * time], axis=1)
    velocity = np.stack([-RADIUS * rate * sine, RADIUS * rate * cosine, CLIMB * one], axis=1)
    tangent = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    normal = np.stack([-cosine, -sine, zero], axis=1)
    return position, velocity, np.stack([tangent, normal, np.cross(tangent, normal)], axis=1)


def two_paths(**attributes):
    """Two helices in the form of `path_dataset`; the second one has a hostile name and violates a limit."""
    progress = np.linspace(0.0, 1.0, SAMPLES)
    times = np.stack([duration * progress for duration in TIMES.values()])
    parts = [helix(time, RATE * 20 / time[-1]) for time in times]
    position, velocity, dcm = (np.stack(column) for column in zip(*parts, strict=True))
    speed = np.linalg.norm(velocity, axis=2)
    defined = np.ones((2, SAMPLES), bool)
    defined[1, 20:24] = False
    three = ("path", "sample", "world")
    variables = {
        "position": (three, position, {"units": "m"}),
        "velocity": (three, velocity, {"units": "m s-1"}),
        "dcm": (("path", "sample", "body", "world"), dcm, {"units": "1"}),
        "defined": (("path", "sample"), defined, {"units": "1"}),
        "speed": (("path", "sample"), speed, {"units": "m s-1", "limit": 5.0}),
        "recorded_position": (("record", "world"), position[0, ::8] + 0.1, {"units": "m"}),
    }
    coordinates = {"path": list(TIMES), "time": (("path", "sample"), times, {"units": "s"}), "world": list("xyz")}
    return xarray.Dataset(variables, coordinates, {"title": HOSTILE, "recording": IMAGE, **attributes})


def turned(angle):
    """Quaternions of rotations about z, of different lengths."""
    zero = np.zeros_like(angle)
    return 3 * np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=1)


def closed_loop():
    """A dataset like that of `qtraj track`: a decaying error; the simulation stopped after three quarters."""
    time = np.linspace(0.0, 8.0, SAMPLES)
    error = np.where(time < 6, 0.4 * np.exp(-time), np.nan)
    columns = {
        "angle": Column(error, "rad", "error angle"),
        "error": Column(turned(error) / 3, "1", "error", "component"),
        "quaternion": Column(turned(error), "1", "attitude", "component"),
        "program_quaternion": Column(turned(0 * time), "1", "attitude", "component"),
        "rate": Column(np.stack([0 * time, 0 * time, -error], axis=1), "rad s-1", "rate", "body"),
        "program_rate": Column(np.zeros((SAMPLES, 3)), "rad s-1", "rate", "body"),
        "command": Column(np.stack([0 * time, 0 * time, error], axis=1), "rad s-2", "command", "body"),
        "closed_form_angle": Column(0.4 * np.exp(-time), "rad", "error angle"),
    }
    dataset = instants_dataset(time, columns, {"title": "A loop", "result": "stopped."})
    dataset["command"].attrs["limit"] = 0.2
    return dataset
