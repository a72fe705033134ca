"""Results are on the device of the arguments; two CPU devices stand in for a CPU and an accelerator."""

import subprocess
import sys

CODE = """
import equinox as eqx, jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_enable_x64", True)
import qtraj as qt

first, second = jax.local_devices()
move = lambda tree, device: jax.tree.map(lambda x: jax.device_put(x, device) if eqx.is_array(x) else x, tree)


def devices(tree):
    return set().union(*(x.devices() for x in jax.tree.leaves(tree) if isinstance(x, jax.Array)))


make = lambda k: qt.SpiralHelix(jnp.stack([20.0 + k, jnp.asarray(1.0)]), [0.2, 1.9], [1.0, 0.4, 0.05], 4.0)
batch = jax.vmap(make)(jnp.arange(3.0))
few, many = jnp.linspace(0.0, 4.0, 8), jnp.linspace(0.0, 4.0, 80_000)
for paths in (make(0.0), batch):
    for times, reduce in ((few, None), (many, None), (few, "max"), (many, "integral")):
        expected = qt.evaluate(paths, times, ("position", "rate"), reduce=reduce)
        for device in (first, second):
            there = move((paths, times), device)
            for found in (
                qt.evaluate(*there, ("position", "rate"), reduce=reduce),
                qt.evaluate(there[0], np.asarray(times), ("position", "rate"), reduce=reduce),
                qt.evaluate(*move((paths, times), first), ("position", "rate"), reduce=reduce, devices=[device]),
            ):
                assert devices(found) == {device}, (devices(found), device)
                for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
                    np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12)
assert devices(qt.evaluate(make(0.0), many)) == {first, second}  # nothing was moved
with jax.default_device(second):
    assert devices(qt.evaluate(make(0.0), many).position) == {second}
both = qt.evaluate(*move((batch, few), second), ("position",), devices=[first, second])
assert len(both.position.sharding.device_set) == 2
table = qt.evaluate(*move((batch, many), second), ("speed",))
assert devices(qt.evaluate(*move((batch, many), second), ("speed",), reuse=table)) == {second}
for bad, text in (
    (lambda: qt.evaluate(move(batch, first), move(many, second)), "cpu:0 and cpu:1"),
    (lambda: qt.evaluate(move(batch, first), move(few, second)), "jax.device_put(x, device)"),
    (lambda: qt.quaternion.product(move(jnp.ones(4), first), move(jnp.ones(4), second)), "cpu:0 and cpu:1"),
    (lambda: qt.trihedral(move(make(0.0), first), move(jnp.asarray(1.0), second)), "cpu:0 and cpu:1"),
    (lambda: qt.evaluate(batch, few, devices=["cpu"]), "jax.local_devices()[:1]"),
    (lambda: qt.evaluate(batch, few, devices=[]), "jax.local_devices()[:1]"),
):
    try:
        bad()
    except ValueError as error:
        assert text in str(error), error
    else:
        raise AssertionError(text)
print("agreed")
"""


def test_results_are_on_the_device_of_the_arguments(cached_code):
    process = subprocess.run([sys.executable, "-c", CODE], env=cached_code, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    assert process.stdout == "agreed\n"
