"""Compare proofs on 1000 turns with checks of 10⁴ samples of each turn, both compiled, in one run.

`pytest benchmarks/test_certify.py -n 0 -s -k ratios` prints the ratios. `-k random` certifies 10 000 random turns, and
`-k tuned` certifies 1000 tuned turns; both check the status of every turn with 50 digits.
"""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.proof.certificate import STATUSES
from qtraj.path.quantity import QUANTITIES
from qtraj.path.values import squared

from .race import race, report
from .tuning.problems import problems
from .turns import element, exact_square, random_turns

COUNT, SAMPLES, ROUNDS = 1000, 10_000, 7
NAMES = [name for name, x in QUANTITIES.items() if not (name.endswith("angular_acceleration") or x.needs)]
UNDECIDED = STATUSES.index("undecided")


def peaks(paths, name):
    return jax.jit(lambda paths: jax.lax.map(lambda p: qt.peak(p, name)[1], paths, batch_size=64))(paths)


def proof(name):
    """Return a function that computes the codes of the findings for a batch."""

    def prove(path, limit):
        return qt.certify(path, qt.Limits(**{name: limit})).codes[0]

    return jax.jit(lambda paths, limits: jax.lax.map(lambda one: prove(*one), (paths, limits), batch_size=64))


def sampling(name):
    """Return a function that checks the limit at 10⁴ samples, path by path, so that the samples stay in the cache."""

    def keep(path, limit):
        times = path.duration * jnp.linspace(0.0, 1.0, SAMPLES)
        return jnp.max(jax.vmap(lambda t: squared(path, t, name))(times)) <= limit**2

    return jax.jit(lambda paths, limits: jax.lax.map(lambda one: keep(*one), (paths, limits)))


@pytest.mark.parametrize("name", NAMES)
def test_ratios(name):
    paths = random_turns(COUNT, "uniform")
    limits = peaks(paths, name) * (1 + 1e-6)
    runners = {"proof": proof(name), "10⁴ samples": sampling(name)}
    spent = race({key: lambda call=call: call(paths, limits) for key, call in runners.items()}, ROUNDS)
    undecided = int(jnp.sum(runners["proof"](paths, limits) == UNDECIDED))
    ratios = report(f"{name}: {COUNT} turns", spent, {"proof": f"{undecided} undecided", "10⁴ samples": ""})
    assert undecided <= COUNT // 1000
    assert ratios["10⁴ samples"] > 0.1


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_no_random_proof_is_contradicted(motion):
    """Check 5000 turns of each motion with 50 digits; the limits differ from the peaks by relative 1e-9 to 0.5."""
    count, rng = 5000, np.random.default_rng(50)
    paths = random_turns(count, motion, seed=1)
    beside = rng.choice([-1.0, 1.0], count) * 10 ** rng.uniform(-9, -0.3, count)
    for name in ("curvature", "speed", "lateral_acceleration", "torsion"):
        bounds = peaks(paths, name) * (1 + beside)
        found = jax.jit(
            lambda paths, bounds, name=name: jax.lax.map(
                lambda one: qt.certify(one[0], qt.Limits(**{name: one[1]})), (paths, bounds), batch_size=64
            )
        )(paths, bounds)
        status = np.asarray(found.codes)[:, 0]
        counts = {text: int(np.sum(status == k)) for k, text in enumerate(STATUSES)}
        print(motion, name, counts)
        assert counts["undecided"] * 1000 < count
        for k in range(count):
            contradicted(element(paths, k), name, bounds[k], found, k)


def test_no_proof_of_a_tuned_path_is_contradicted():
    """Check 1000 tuned paths, whose curvature reaches its limit."""
    given = problems(COUNT, seed=7)
    limits = jax.vmap(lambda k: qt.Limits(curvature=k))(jnp.asarray(given.limits))
    best = qt.tune(given.starts, given.ends, limits)
    found = best.certificate
    print(best)
    assert int(jnp.sum(best.converged)) == COUNT
    for k in range(COUNT):
        contradicted(element(best.path, k), "curvature", given.limits[k], found, k)


def contradicted(path, name, bound, found, k):
    """Raise an AssertionError if a 50-digit value contradicts the status of path k."""
    with mpmath.workdps(50):
        square = mpmath.mpf(float(bound)) ** 2
        worst = exact_square(path, name, float(found.times[k, 0]))
        proved = int(found.codes[k, 0]) == 0
        assert not (proved and worst > square), (name, k)
        assert not (int(found.codes[k, 0]) == 2 and worst <= square), (name, k)
        if proved:
            assert all(exact_square(path, name, float(path.duration) * j / 5) <= square for j in range(6)), (name, k)
