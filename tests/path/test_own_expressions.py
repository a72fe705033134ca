"""Expressions of quantities of one's own: what functions are written as, and what texts may contain."""

import contextlib
import random
import time
from fractions import Fraction

import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.document import save
from qtraj.io.stored import load
from qtraj.path.own_recording import LONGEST

FUNCTIONS = [
    ("m/s", lambda p: p.velocity[2], "velocity[2]"),
    ("m/s", lambda p: p.velocity[-1], "velocity[2]"),
    ("1/m", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed**3, None),
    ("m/s", lambda p: p.speed - (p.velocity[0] - p.velocity[1]), "speed - (velocity[0] - velocity[1])"),
    ("m/s", lambda p: 0 - (-p.velocity[0]), "0 - -velocity[0]"),
    ("m^2/s^2", lambda p: (-p.velocity[0]) ** 2, "(-velocity[0])**2"),
    ("m^2/s^2", lambda p: -(p.velocity[0] ** 2), "-velocity[0]**2"),
    ("m^4/s^4", lambda p: (p.speed**2) ** 2, "(speed**2)**2"),
    ("1", lambda p: p.velocity[0] / (p.speed / Fraction(1, 3)), "velocity[0] / (speed / (1 / 3))"),
    ("m/s", lambda p: Fraction(-1, 3) * p.speed, "-1 / 3 * speed"),
    ("m/s", lambda p: np.float32(0.1) * p.speed, "0.10000000149011612 * speed"),
    ("m/s", lambda p: 2 * p.speed - -1e-7 * p.speed, "2 * speed - -1e-07 * speed"),
    ("m/s", lambda p: 3.0 - p.velocity.dot([1, 2.5, p.speed / p.speed]), None),
    ("N", lambda p: p.vehicle.mass * (p.acceleration + np.array([0, 0, 9.81])).norm(), None),
    ("m/s", lambda p: qt.sqrt(sum(x * x for x in p.velocity)), None),
    ("1", lambda p: abs(p.acceleration[0]) / (p.vehicle.gravity * p.vehicle.friction[1]), None),
    ("m/s^2", lambda p: (2 * p.acceleration - p.velocity * (1 / p.speed) * p.acceleration.norm()).norm(), None),
    ("m/s", lambda p: (p.speed * p.speed) ** 0.5 + 1, "(speed * speed)**0.5 + 1"),
]


@pytest.mark.parametrize(("unit", "function", "text"), FUNCTIONS)
def test_a_function_is_written_as_an_expression_with_the_same_formula(unit, function, text):
    one = qt.Quantity("mine", unit, function)
    assert text is None or one.expression == text
    again = qt.Quantity("mine", unit, one.expression)
    assert again == one
    assert again.expression == one.expression


def random_number(draw, depth):
    """A random function of the motion p that returns a number, as a function of p."""
    if depth == 0:
        vector, axis = random_vector(draw, 0), draw.randrange(3)
        return draw.choice([lambda p: vector(p)[axis], lambda p: p.speed, lambda p: vector(p).norm()])
    a, b = random_number(draw, depth - 1), random_number(draw, depth - 1)
    u, v, c = random_vector(draw, depth - 1), random_vector(draw, depth - 1), draw.choice([2, -3, 0.7, Fraction(-2, 3)])
    return draw.choice(
        [
            lambda p: a(p) + b(p),
            lambda p: a(p) - b(p),
            lambda p: a(p) * b(p),
            lambda p: a(p) / (b(p) ** 2 + c),
            lambda p: c - a(p),
            lambda p: c / (1 + b(p) ** 2),
            lambda p: -(a(p) ** 2),
            lambda p: abs(a(p)),
            lambda p: qt.sqrt(a(p) ** 2 + 1),
            lambda p: u(p).dot(v(p)),
            lambda p: u(p)[1],
        ]
    )


def random_vector(draw, depth):
    if depth == 0:
        name = draw.choice(["position", "velocity", "acceleration", "jerk", "snap"])
        return lambda p: getattr(p, name)
    u, v, a = random_vector(draw, depth - 1), random_vector(draw, depth - 1), random_number(draw, 0)
    return draw.choice(
        [
            lambda p: u(p) + v(p),
            lambda p: u(p) - v(p),
            lambda p: -u(p) * a(p),
            lambda p: u(p) / 3,
            lambda p: [0, 0, 9.81] - u(p),
            lambda p: u(p).cross(v(p)) if depth == 1 else u(p),
        ]
    )


def test_random_functions_are_written_exactly():
    draw, count = random.Random(45), 0
    for _ in range(60):
        with contextlib.suppress(ValueError):  # a function with another unit, or without the motion
            one = qt.Quantity("mine", "1", random_number(draw, 2))
            assert qt.Quantity("mine", "1", one.expression) == one
            count += 1
    assert count > 20


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not valid"),
        ("velocity[2", "is not valid"),
        ("velocity\0", "is not valid"),
        ("__import__('os').system('true')", "contains .*__import__"),
        ("velocity.__class__", "contains 'velocity.__class__'"),
        ("(lambda: speed)()", "contains"),
        ("[x for x in velocity]", "contains"),
        ("p.velocity[2]", "contains"),
        ("speed if speed else speed", "contains"),
        ("speed and speed", "contains"),
        ("'speed'", "contains"),
        ("velocity[True]", "contains"),
        ("velocity[3]", "components 0, 1 and 2"),
        ("velocity[speed]", "contains"),
        ("velocity", "must return one number"),
        ("[1, 2, 3]", "must return one number"),
        ("[1, 2] + [3]", "two lists"),
        ("velocity.dot([1, 2])", "three numbers"),
        ("velocity * acceleration", "use .dot or .cross"),
        ("speed.norm()", "only vectors"),
        ("speed[0]", "of a number"),
        ("velocity.norm(1)", "contains"),
        ("sin(speed)", r"contains 'sin\(speed\)'"),
        ("sqrt(speed, speed)", "contains"),
        ("speed**speed", "exponents"),
        ("speed**0.3", "exponents"),
        ("speed**99999999999", "power above"),
        ("((2**32)**32)**32 * speed", "power above"),
        ("1e999 * speed", "finite"),
        ("1e308**4 * speed", "cannot be computed"),
        ("sqrt(-2) * speed", "negative"),
        ("speed / 0", "divides by zero"),
        ("3.0", "does not depend"),
        ("-" * 900 + "speed", "nested"),
        ("(" * 400 + "speed" + ")" * 400, "not valid|nested"),
        ("speed + " * 200 + "speed", "characters"),
        ("velocity.cross(acceleration).cross(jerk).cross(snap)[0]", "cross products"),
        ("vehicle.colour * speed", "contains 'vehicle.colour'"),
        ("vehicle * speed", "contains 'vehicle'"),
    ],
)
def test_other_texts_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        qt.Quantity("mine", "m/s", text)


@pytest.mark.parametrize(
    "text",
    [
        "{w}.dot({w})",
        "({w} * {w}.dot({w})).norm()",
        "({w})[0] * ({w})[1] * sqrt(({w})[2])",
        " + ".join(f"speed**{k % 32}" for k in range(80)),
        "*".join(["(speed + velocity[0] + 1)**8"] * 30),
    ],
)
def test_no_expression_takes_long(text):
    """Nested crosses of sums have the most terms for their length."""
    v = "(velocity + acceleration + jerk + snap)"
    text = text.replace("{w}", f"{v}.cross({v}.cross(position + {v}))")
    assert len(text) <= LONGEST
    began = time.process_time()
    with contextlib.suppress(ValueError):  # most of these have another unit
        qt.Quantity("mine", "m/s", text)
    assert time.process_time() - began < 1.0


def test_a_longer_function_is_proved_but_not_stored(tmp_path):
    def squared_often(p):
        x = p.velocity[2]
        for _ in range(12):
            x = x + x
        return x

    limits = qt.Limits(own={qt.Quantity("mine", "m/s", squared_often): 1.0})
    assert next(iter(limits.own.names)).quantity.expression is None
    with pytest.raises(ValueError, match=r"mine of your own cannot be stored, because .*too long"):
        save(limits, tmp_path / "x.json")


@pytest.mark.parametrize("suffix", [".json", ".toml"])
def test_limits_and_certificates_with_own_quantities_are_stored(tmp_path, suffix):
    climb = qt.Quantity("climb_rate", "m/s", lambda p: p.velocity[2], "rate of climb")
    lateral = qt.Quantity("own_lateral", "m/s^2", lambda p: p.velocity.cross(p.acceleration).norm() / p.speed)
    limits = qt.Limits(speed=9.0, own={climb: (-0.2, 0.6), lateral: qt.Along([0, 5], [5, 3])})
    start, end = qt.BoundaryState([20, 0, 0], [1, 6, 0.3]), qt.BoundaryState([0, 20, 1.5], [-7, -1, 0.1])
    path = qt.SpiralHelix.hermite(start, end, 4.0)
    first = qt.certify(path, limits)
    assert set(first.status.values()) == {"proved", "broken"}
    save(limits, tmp_path / f"limits{suffix}")
    save(first, tmp_path / f"found{suffix}")
    loaded, found = load(tmp_path / f"limits{suffix}"), load(tmp_path / f"found{suffix}")
    assert found.names == first.names
    assert found.status == first.status
    again = qt.certify(path, loaded)
    assert again.status == first.status
    assert again.worst == first.worst
    assert repr(loaded) == repr(limits)
    assert loaded.own.names[0].quantity == climb
    assert climb.meaning in (tmp_path / f"limits{suffix}").read_text()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ('"velocity[2]"', "\"__import__('os')[2]\""),
        ('"velocity[2]"', '"position[2]"'),
        ('"velocity[2]"', "3"),
        ('"climb_rate_min"', '"speed"'),
        ('"climb_rate_min"', "[1]"),
        ('"m s-1"', '"furlong"'),
    ],
)
def test_changed_files_are_refused(tmp_path, changed, message):
    climb = qt.Quantity("climb_rate", "m/s", lambda p: p.velocity[2])
    path = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
    file = tmp_path / "found.json"
    save(qt.certify(path, qt.Limits(own={climb: (-0.2, 0.6)})), file)
    assert changed in file.read_text()
    file.write_text(file.read_text().replace(changed, message))
    with pytest.raises(ValueError, match=r"found\.json: "):
        load(file)


def test_a_constant_larger_than_float64_is_refused():
    with pytest.raises(ValueError, match=r"at most 1.79769e\+308"):
        qt.Quantity("large", "m/s", "9" * 900 + " * speed")
