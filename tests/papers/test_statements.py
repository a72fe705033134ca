"""docs/statements.md: the functions and tests that it names exist, and a few statements that no other test shows."""

import ast
import importlib
import re
from pathlib import Path

import jax
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

import qtraj as qt

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "statements.md").read_text(encoding="utf-8")

NUMBERS = [
    *(f"(1.{k})" for k in range(1, 7)),
    *(f"(2.{k})" for k in range(1, 3)),
    *(f"(3.{k})" for k in range(1, 16)),
    *("remark 1", "remark 2", "section 2", "section 3"),
]
"""Everything that paper C numbers; section 1 consists of its equations. S numbers nothing."""

ROUND_OFF = 1e-12


def found(name):
    """What a dotted name stands for, with attributes of classes and fields of Modules."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            fields = getattr(thing, "__dataclass_fields__", {})
            thing = fields[part] if part in fields else getattr(thing, part)
        return thing
    raise ModuleNotFoundError(name)


def rows():
    """The cells of the tables, without their heads."""
    lines = [line for line in TEXT.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if "`" in line]


def test_every_row_names_functions_and_tests_that_exist():
    assert len(rows()) > 60
    for statement, here, tests in rows():
        names = re.findall(r"`([\w.]+)`", here)
        assert names, statement
        for name in names:
            assert found(name) is not None
        assert re.findall(r"`tests/[\w/]+\.py::test_\w+`", tests), statement
    for file, name in re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", TEXT):
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, f"{file}::{name}"


def test_every_numbered_statement_has_a_row():
    statements = " ".join(row[0] for row in rows())
    assert [number for number in NUMBERS if number not in statements] == []


def test_a_missing_name_is_detected():
    for name in ("qtraj.no_such_function", "qtraj.EulerTurn.no_such_field"):
        with pytest.raises((AttributeError, ModuleNotFoundError)):
            found(name)


def turn(rate_rho=(1.2, -0.7), rate_h=(0.5, 1.1)):
    """S's turn at a right angle: r1A, r2B, r3A, r3B, V2A, V1B, and the path."""
    r1a, r2b, r3a, r3b, v2a = 20.0, 26.0, 1.0, 9.0, 8.0
    v1b = v2a * r2b / r1a
    start = qt.BoundaryState([r1a, 0.0, r3a], [rate_rho[0], v2a, rate_h[0]])
    end = qt.BoundaryState([0.0, r2b, r3b], [-v1b, rate_rho[1], rate_h[1]])
    return (r1a, r2b, r3a, r3b, v2a, v1b), qt.SpiralHelix.from_boundary(start, end)


def test_both_durations_and_the_four_equations():
    (r1a, r2b, r3a, r3b, v2a, v1b), path = turn()
    tk = float(path.duration)
    assert tk == pytest.approx(np.pi * r1a / (2 * v2a), rel=ROUND_OFF)
    assert tk == pytest.approx(np.pi * r2b / (2 * v1b), rel=ROUND_OFF)
    for p, first, last, rates in ((path.radius, r1a, r2b, (1.2, -0.7)), (path.height, r3a, r3b, (0.5, 1.1))):
        value = last - first - rates[0] * np.pi * r1a / (2 * v2a)
        assert tk**2 * (p[2] + p[3] * tk) == pytest.approx(value, rel=ROUND_OFF)
        assert tk * (2 * p[2] + 3 * p[3] * tk) == pytest.approx(rates[1] - rates[0], rel=ROUND_OFF)


def test_the_work_of_the_forces_is_the_change_of_energy():
    """The force along the path from `forces`, integrated over the arc by an independent rule, to 1e-12."""
    _, path = turn()
    mass, gravity, tk = 12_000.0, 9.80665, float(path.duration)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    times = 0.5 * tk * (nodes + 1)
    forces = jax.jit(jax.vmap(lambda t: qt.dynamics.forces(path, t, mass, gravity)))(times)
    w = float(path.angle[1])
    rho, h = Polynomial(np.asarray(path.radius)), Polynomial(np.asarray(path.height))
    speed_squared = rho.deriv() ** 2 + (w * rho) ** 2 + h.deriv() ** 2
    work = 0.5 * tk * weights @ (np.asarray(forces)[:, 0] * np.sqrt(speed_squared(times)))
    energy = 0.5 * mass * speed_squared + mass * gravity * h
    assert work == pytest.approx(energy(tk) - energy(0.0), rel=ROUND_OFF)


def test_the_program_by_both_products():
    """(3.12) and (3.13) with SciPy's rotations: about e_ξ from the left, about e_z from the right."""
    start = Rotation.from_rotvec([0.3, -0.8, 0.5])
    end = Rotation.from_rotvec([-0.2, 0.9, 1.1])
    program = qt.EulerTurn(start.as_quat(scalar_first=True), end.as_quat(scalar_first=True), qt.TimeOptimal(0.2, 0.05))
    outer, inner = ((x * y.inv()).as_rotvec() for x, y in ((end, start), (start.inv(), end.inv())))
    e_xi, e_z = (x / np.linalg.norm(x) for x in (outer, inner))
    at = jax.jit(lambda t: program(t).quaternion)
    for part in (0.1, 0.5, 0.8):
        t = part * float(program.duration)
        phi, found_at = float(program.profile.angle(t)), Rotation.from_quat(at(t), scalar_first=True)
        for expected in (Rotation.from_rotvec(phi * e_xi) * start, start * Rotation.from_rotvec(phi * e_z)):
            assert (found_at.inv() * expected).magnitude() < ROUND_OFF
