"""`qtraj simulate` and input that makes no closed loop: one message with file, key and advice, and nothing written."""

import pytest

import qtraj as qt

from .loop_scenarios import LAW, SLEW

BODY = "[body]\ninertia = [12, 15, 9]\n"
WHEELS = "[body.wheels]\naxes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"

BAD = {
    "an empty file": ("", ["the key 'angles' is missing", "and 2 more"]),
    "no program": (
        "angles = 'deg'\n[program]\n" + LAW,
        ["[program]: there is no program", "path = 'a path scenario", "file = 'a saved"],
    ),
    "two programs": (
        SLEW + "[program]\nfile = 'p.toml'\n" + LAW,
        ["[program]: there are several programs (slew"],
    ),
    "a frame of a turn": (
        SLEW + "[program]\nframe = 'natural'\n" + LAW,
        ["the key 'frame' requires a program along a path"],
    ),
    "gyros of a rate law": (
        SLEW + LAW + "kind = 'rate'\n[sensor]\nkind = 'gyros'\nsampling = 0.1\n",
        ["[law]: gyros need a continuous rate", "under a rate law the rate is discontinuous"],
    ),
    "a misspelt limit": (
        SLEW.replace("max_acc", "max_ac") + LAW,
        ["unknown key 'program.slew.law.max_aceleration'", "did you mean 'max_acceleration'?"],
    ),
    "an impossible turn": (SLEW + "duration = 0.1\n" + LAW, ["[law]: a motion of", "Increase the duration"]),
    "no gains": (SLEW + "[law]\n", ["[law]: there are no gains", "settling_time", "weights"]),
    "a turn that breaks its limits": (
        SLEW.replace("max_acceleration = 20", "kind = 'quintic'\nduration = 10\nmax_rate = 1") + LAW,
        ["in [program.slew], limits are violated: max_rate by 462 %", "takes at least 56.25 s", "Increase the"],
    ),
    "a turn that ends in motion, and longer": (
        SLEW + "max_rate = 4\nend_rate = 2\n" + LAW + "[simulation]\nduration = 60\n",
        [
            "'simulation.duration' has the value 60",
            "the duration of the program: only a slew that ends at rest can be simulated for longer",
        ],
    ),
    "a negative gain": (SLEW + "[law]\nk1 = -1\nk2 = 1\n", ["'law.k1' has the value -1", "a positive finite number"]),
    "no gain of a rate law": (SLEW + "[law]\nkind = 'rate'\nk = 0\n", ["'law.k' has the value 0", "a positive finite"]),
    "a far sign in the normalization of Gibbs": (
        SLEW + LAW + "[error]\nnormalization = 'gibbs'\nsign = 'far'\n",
        ["the key 'error.normalization': the normalization 'gibbs' means μ0 = 1, which contradicts the sign 'far'"],
    ),
    "a sign for a baseline": (
        SLEW + LAW + "kind = 'geometric'\n[error]\nsign = 'auto'\n",
        ["'error.sign' cannot be used with a law of kind 'geometric'", "the same for λ and −λ"],
    ),
    "a seed beyond integers": (
        SLEW + LAW + "[sensor]\nsampling = 1\nrate_noise = 1\nseed = 9223372036854775808\n",
        ["'sensor.seed' has the value 9223372036854775808", "from 0 to 2⁶³ − 1"],
    ),
    "commands without end": (
        SLEW + LAW + "[sensor]\nsampling = 1e-7\n",
        ["the key 'sensor.sampling': a sampling period of 1e-07 s requires", "but the maximum is 1000000"],
    ),
    "a held command without end": (
        SLEW + LAW + "[actuator]\nsampling = 1e-7\n",
        ["the key 'actuator.sampling': a sampling period of 1e-07 s requires"],
    ),
    "two gains": (
        SLEW + LAW + "damping = 1\nfrequency = 1\n",
        ["the gains are specified in several ways (settling_time, damping)"],
    ),
    "one gain of two": (SLEW + "[law]\nk1 = 1\n", ["[law]: 'k2' is missing: k1 and k2 must be specified together"]),
    "a gain that is a text": (
        SLEW + "[law]\nk1 = 'x'\nk2 = 1\n",
        ["'law.k1' has the value 'x'", "a positive finite"],
    ),
    "a gain beyond floats": (SLEW + f"[law]\nk1 = 1{'0' * 400}\nk2 = 1\n", ["'law.k1' has the value 1000"]),
    "a ragged gain": (
        SLEW + "[law]\nk1 = [[1, 2], [3]]\nk2 = 1\n",
        ["[law]: k1 must be a number, 4 numbers for a diagonal, or a 4 × 4 matrix, but [[1.0, 2.0], [3.0]] was"],
    ),
    "a small gain": (
        SLEW + "[law]\nk1 = [1, 2, 3]\nk2 = 1\n",
        ["[law]: k1 must be a number, 4 numbers for a diagonal", "but [1.0, 2.0, 3.0] with shape (3,) was given"],
    ),
    "a gain of another law": (
        SLEW + "[law]\nk = 1\n",
        ["[law]: 'k' cannot be used with a law of kind 'body': specify k1 and k2, or settling_time"],
    ),
    "a residual of nothing": (
        SLEW + "[law]\nk1 = 1\nk2 = 1\nresidual = 0.1\n",
        ["'residual' requires 'settling_time'"],
    ),
    "an infinite weight": (SLEW + "[law.weights]\nerror = inf\n", ["'law.weights.error' has the value inf", "[1/s⁴]"]),
    "an error twice": (
        SLEW + LAW + "[error]\ngibbs = [0, 0, 0]\nquaternion = [1, 0, 0, 0]\n",
        ["[error]: the attitude is specified"],
    ),
    "a normalization at a half turn": (
        SLEW + LAW + "[error]\nrotation_vector = [180, 0, 0]\nnormalization = 'gibbs'\n",
        ["the key 'error.normalization': the normalization 'gibbs' is not possible for an error of a half turn"],
    ),
    "a Gibbs normalization of another error": (
        SLEW + LAW + "kind = 'additive'\n[error]\nnormalization = 'gibbs'\n",
        ["the key 'error.normalization': the normalization 'gibbs' is possible only for a law with the body or the"],
    ),
    "a rate error of a rate law": (
        SLEW + LAW + "kind = 'rate'\n[error]\nrate = [1, 0, 0]\n",
        ["'error.rate' cannot be used with a law of kind 'rate'"],
    ),
    "a disturbed rate law": (
        SLEW + LAW + "kind = 'rate'\n[disturbance]\nacceleration = [1, 0, 0]\n",
        ["[law]: a rate law commands the rate directly, so a disturbance has no effect", "or omit the disturbance"],
    ),
    "a torque on nothing": (
        SLEW + LAW + "[disturbance]\ntorque = [1, 0, 0]\n",
        ["torque and inertia must be specified together"],
    ),
    "two inertias": (
        SLEW + LAW + "[disturbance]\ntorque = [1, 0, 0]\ninertia = [1, 2]\n",
        ["'disturbance.inertia' has the value [1, 2]", "[kg m²]"],
    ),
    "a negative inertia": (
        SLEW + LAW + "[disturbance]\ntorque = [1, 0, 0]\ninertia = [1, 2, -3]\n",
        ["'disturbance.inertia' has the value [1, 2, -3]", "three positive finite numbers"],
    ),
    "a negative moment of inertia": (
        SLEW + LAW + "[disturbance]\ntorque = [1, 0, 0]\ninertia = -2.0\n",
        ["'disturbance.inertia' has the value -2.0", "positive finite numbers"],
    ),
    "an impossible inertia": (
        SLEW + LAW + "[disturbance]\ntorque = [1, 0, 0]\ninertia = [1, 1, 9]\n",
        ["the key 'disturbance.inertia': no body has a principal moment of inertia that exceeds the sum"],
    ),
    "an inertia twice": (
        SLEW + LAW + BODY + "[disturbance]\ntorque = [1, 0, 0]\ninertia = 2\n",
        ["the inertia is specified twice: omit 'disturbance.inertia'"],
    ),
    "an inertia of nothing": (
        SLEW + LAW + "[disturbance]\nacceleration = [1, 0, 0]\ninertia = 2\n",
        ["[disturbance]: the key 'inertia' requires a torque, which is missing"],
    ),
    "an acceleration and a torque": (
        SLEW + LAW + BODY + "[disturbance]\nacceleration = [1, 0, 0]\n[disturbance.magnetic]\ndipole = [0, 0, 1]\n"
        "field = [0, 1, 0]\n",
        ["[disturbance]: specify either acceleration, or torques (torque, gravity_gradient, magnetic, aerodynamic)"],
    ),
    "a gravity gradient at no place": (
        SLEW + LAW + BODY + "[disturbance.gravity_gradient]\n",
        ["[disturbance.gravity_gradient] needs [disturbance.orbit], or a constant position"],
    ),
    "drag without a velocity": (
        SLEW + LAW + BODY + "[disturbance.aerodynamic]\ncentre = [1, 0, 0]\narea = 1\ndensity = 1e-9\n",
        ["[disturbance.aerodynamic] needs [disturbance.orbit], or a constant velocity"],
    ),
    "an orbit for nothing": (
        SLEW + LAW + BODY + "[disturbance]\ntorque = [1, 0, 0]\n[disturbance.orbit]\nradius = 7e6\n",
        ["[disturbance]: [disturbance.orbit] has no effect"],
    ),
    "an orbit without a plane": (
        SLEW + LAW + BODY + "[disturbance.gravity_gradient]\n[disturbance.orbit]\nradius = 7e6\nnormal = [1, 0, 0]\n",
        ["[disturbance.orbit]: normal must not be zero or along start"],
    ),
    "a period of a field": (
        SLEW + LAW + BODY + "[disturbance]\nperiod = 3\n[disturbance.magnetic]\ndipole = [0, 0, 1]\n"
        "field = [0, 1, 0]\n",
        ["[disturbance]: the key 'period' requires 'acceleration' or 'torque'"],
    ),
    "a misspelt torque": (
        SLEW + LAW + BODY + "[disturbance.gravity]\n",
        ["unknown key 'disturbance.gravity'; did you mean 'gravity_gradient'?"],
    ),
    "a body of a rate law": (
        SLEW + LAW + "kind = 'rate'\n" + BODY,
        ["[body] cannot be used with a law of kind 'rate', which commands the rate directly"],
    ),
    "limits of thrusters with wheels": (
        SLEW + LAW + BODY + "max_torque = 1\n" + WHEELS,
        ["[body]: 'max_torque' limits thrusters, but there are wheels: use 'max_torque' of [body.wheels]"],
    ),
    "wheels in a plane": (
        SLEW + LAW + BODY + "[body.wheels]\naxes = [[1, 0, 0], [0, 1, 0], [1, 1, 0]]\n",
        ["[body.wheels]: the spin axes of the wheels must span three dimensions"],
    ),
    "two wheels": (
        SLEW + LAW + BODY + "[body.wheels]\naxes = [[1, 0, 0], [0, 1, 0]]\n",
        ["'body.wheels.axes' has the value", "expected three or more vectors [x, y, z]"],
    ),
    "momenta of other wheels": (
        SLEW + LAW + BODY + WHEELS + "momentum = [1, 2]\n",
        ["[body.wheels]: the momenta of 3 wheels must have shape (3,), but shape (2,) was given"],
    ),
    "an assumed inertia of nothing": (
        SLEW + LAW + "[body]\nassumed = 3\n",
        ["the key 'body.inertia' is missing"],
    ),
    "a hysteresis without samples": (
        SLEW + LAW + "[law.hysteresis]\n",
        ["the key 'law.hysteresis.sampling' is missing: the sign of λ is updated at samples"],
    ),
    "a hysteresis of another law": (
        SLEW + LAW + "kind = 'geometric'\n[law.hysteresis]\nsampling = 1\n",
        ["[law]: 'hysteresis' cannot be used with a law of kind 'geometric'"],
    ),
    "a hysteresis beyond all errors": (
        SLEW + LAW + "[law.hysteresis]\nhalf_width = 1\n",
        ["'law.hysteresis.half_width' has the value 1", "a number from 0 to below 1"],
    ),
    "another sampling of the hysteresis": (
        SLEW + LAW + "[law.hysteresis]\nsampling = 0.1\n[actuator]\nsampling = 0.2\n",
        ["the key 'law.hysteresis.sampling': actuator and hysteretic law must have the same sampling"],
    ),
    "the Gibbs normalization of a baseline with hysteresis": (
        SLEW + LAW + "kind = 'quaternion'\n[law.hysteresis]\nsampling = 1\n[error]\nnormalization = 'gibbs'\n",
        ["the key 'error.normalization': the normalization 'gibbs' is possible only for a law with the body or the"],
    ),
    "noise without samples": (SLEW + LAW + "[sensor]\nrate_noise = 0.1\n", ["the key 'sampling' is missing: noise"]),
    "a negative noise": (
        SLEW + LAW + "[sensor]\nrate_noise = -0.1\n",
        ["'sensor.rate_noise' has the value -0.1", "0 or more [angle/s]"],
    ),
    "two samplings": (
        SLEW + LAW + "[sensor]\nsampling = 0.1\n[actuator]\nsampling = 0.2\n",
        ["the key 'sensor.sampling': sensor and actuator must have the same sampling"],
    ),
    "a limit of each axis": (
        SLEW + LAW + "[actuator]\nlimit = [1, 2, 3]\n",
        ["[actuator]: a limit for each axis requires saturation = 'axis'"],
    ),
    "a limit of zero": (
        SLEW + LAW + "[actuator]\nlimit = 0\n",
        ["'actuator.limit' has the value 0", "a positive finite"],
    ),
    "one sample": (SLEW + LAW + "[simulation]\nsamples = 1\n", ["'simulation.samples' has the value 1", "from 2 to"]),
    "a missing program": ("angles = 'deg'\n[program]\nfile = 'gone.toml'\n" + LAW, ["gone.toml", "No such file"]),
    "a program that is none": (
        "angles = 'deg'\n[program]\nfile = 'path.toml'\n" + LAW,
        ["a saved program was expected, but the file contains an object of type SpiralHelix"],
    ),
    "a straight path": (
        "angles = 'deg'\n[program]\npath = 'path.toml'\nframe = 'natural'\n" + LAW,
        ["the natural frame of this path does not exist at t = 0 s", "'upright'"],
    ),
    "a heading of another frame": (
        "angles = 'deg'\n[program]\npath = 'path.toml'\nframe = 'natural'\nheading = 3\n" + LAW,
        ["[program]: 'heading' is valid only with the frame 'thrust-aligned', but the frame is 'natural'"],
    ),
    "a path that ends": (
        "angles = 'deg'\n[program]\npath = 'path.toml'\nframe = 'upright'\n[simulation]\nduration = 9\n" + LAW,
        ["'simulation.duration' has the value 9", "at most 3 s, the duration of the program: only a slew"],
    ),
}


@pytest.mark.parametrize("content", BAD.values(), ids=BAD)
def test_bad_scenarios(qtraj, tmp_path, content):
    text, fragments = content
    qt.SpiralHelix([1.0, 2.0, 0.0, 0.0], [0.3, 0.0], [0.0, 0.5, 0.0, 0.0], 3.0).save(tmp_path / "path.toml")
    (tmp_path / "scenario.toml").write_text(text)
    before = sorted(tmp_path.iterdir())
    result = qtraj("simulate", tmp_path / "scenario.toml", "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith(f"error: {tmp_path}")
    assert result.stderr.count("\n") == 1
    for fragment in fragments:
        assert fragment in result.stderr
    assert sorted(tmp_path.iterdir()) == before
