"""Attitudes in scenario files: every form against SciPy, in degrees and in radians."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from qtraj.scenario.keys import AttitudePart, KnownAttitudePart

ROUND_OFF = 1e-14
EULER = np.array([30.0, -20.0, 110.0])
VECTOR = np.array([40.0, -70.0, 25.0])
GIBBS = np.array([0.3, -0.5, 1.2])
Q = np.array([-0.4, 1.0, 0.3, -2.0])

FORMS = {
    "moving axes": ({"euler": EULER, "sequence": "ZYX"}, Rotation.from_euler("ZYX", EULER, degrees=True)),
    "fixed axes": ({"euler": EULER, "sequence": "zxz"}, Rotation.from_euler("zxz", EULER, degrees=True)),
    "a rotation vector": ({"rotation_vector": VECTOR}, Rotation.from_rotvec(VECTOR, degrees=True)),
    "modified Rodrigues parameters": ({"mrp": GIBBS}, Rotation.from_mrp(GIBBS)),
    "a Gibbs vector": ({"gibbs": GIBBS}, Rotation.from_quat([*GIBBS, 1.0])),
    "a quaternion": ({"quaternion": Q}, Rotation.from_quat(Q, scalar_first=True)),
}


@pytest.mark.parametrize(("table", "expected"), FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("angles", ["deg", "rad"])
def test_every_form_is_scipys(table, expected, angles):
    scale = 1.0 if angles == "deg" else math.pi / 180
    turned = {name: scale * value for name, value in table.items() if name in ("euler", "rotation_vector")}
    plain = {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in (table | turned).items()}
    q = np.asarray(AttitudePart.model_validate(plain).unit_quaternion(angles))
    assert abs(np.linalg.norm(q) - 1) < ROUND_OFF
    assert (Rotation.from_quat(q, scalar_first=True).inv() * expected).magnitude() < 10 * ROUND_OFF


def test_a_quaternion_keeps_its_sign():
    q = AttitudePart(quaternion=Q.tolist()).unit_quaternion("rad")
    assert np.asarray(q) == pytest.approx(Q / np.linalg.norm(Q))


@pytest.mark.parametrize("size", [1e-200, 1e200, 5e-324, 1.7e308])
def test_a_quaternion_may_have_any_length(size):
    q = AttitudePart(quaternion=[size, 0.0, -size, 0.0]).unit_quaternion("rad")
    assert np.asarray(q) == pytest.approx([math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0], abs=ROUND_OFF)


def test_a_gibbs_vector_may_be_long():
    q = AttitudePart(gibbs=[0.0, 1e200, 1e200]).unit_quaternion("rad")
    assert np.asarray(q) == pytest.approx([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)], abs=ROUND_OFF)


def test_a_rotation_vector_beyond_a_half_turn_is_told():
    assert AttitudePart(rotation_vector=[0.0, 0.0, 180.0]).beyond_half_turn("deg") is None
    assert AttitudePart(rotation_vector=[0.0, -120.0, 160.0]).beyond_half_turn("deg") == pytest.approx(
        math.radians(200)
    )
    assert AttitudePart(rotation_vector=[0.0, 0.0, 180.0]).beyond_half_turn("rad") == 180.0
    assert AttitudePart(gibbs=[0.0, 0.0, 180.0]).beyond_half_turn("rad") is None


def test_a_sequence_is_checked_where_it_stands():
    with pytest.raises(ValueError, match="an Euler sequence must be"):
        AttitudePart(euler=[1.0, 2.0, 3.0], sequence="xxy")


def test_no_attitude_is_none_or_an_error():
    assert AttitudePart().unit_quaternion("deg") is None
    with pytest.raises(ValueError, match="there is no attitude: specify one of quaternion, euler"):
        KnownAttitudePart()


def test_modified_rodrigues_parameters_may_be_long():
    """In the limit they describe a whole turn."""
    q = AttitudePart(mrp=[0.0, 1e200, 1e200]).unit_quaternion("rad")
    np.testing.assert_allclose(q, [-1.0, 0.0, 0.0, 0.0], atol=1e-15)
    third = Rotation.from_mrp([0.0, 3.0, 0.0])
    found = AttitudePart(mrp=[0.0, 3.0, 0.0]).unit_quaternion("rad")
    np.testing.assert_allclose(Rotation.from_quat(found, scalar_first=True).as_matrix(), third.as_matrix(), atol=1e-15)
