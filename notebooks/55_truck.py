# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # A truck limited by its grip
#
# Friction and power depend on the vehicle and the road. The example is a loaded truck of 32 t on a banked, climbing
# ramp, with air drag and rolling resistance. It may use at most 80 % of the grip, according to the friction ellipse of
# the tyres, and 210 kW of engine power. How fast may the truck drive on roads from slippery to dry? Each
# problem of the batch has its own vehicle; one call tunes all of them, and one call evaluates their forces.

# %%
# %matplotlib inline
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt

GRIPS = jnp.asarray([0.35, 0.4, 0.45, 0.5, 0.6, 0.8])


@jax.vmap
def of_truck(grip):
    """The limits of the truck on a road with this coefficient of friction along, and a little less across."""
    truck = qt.Vehicle(
        32e3, drag_area=6.2, rolling_resistance=0.006, friction=grip * jnp.array([1.0, 0.9]), bank=0.0524
    )
    return qt.Limits(friction=0.8, power=210e3, vehicle=truck)


onto = qt.BoundaryState([60.0, 0.0, 0.0], [0.0, 17.0, 0.2])
off = qt.BoundaryState([0.0, 64.0, 3.0], [-16.0, 0.0, 0.2])
onto, off = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(GRIPS), 3)), (onto, off))
trucks = qt.tune(onto, off, of_truck(GRIPS), motion="hermite")
assert trucks.converged.all()
assert np.all(trucks.certificate.holds)

instants = jnp.linspace(0.0, trucks.path.duration, 1001, axis=1)
table = qt.evaluate(trucks.path, instants, ("speed", "friction", "power"), vehicle=trucks.vehicle)
print(f"{'friction':>9s}{'speed [km/h]':>20s}{'grip used':>12s}{'power [kW]':>12s}   active")
for k, grip in enumerate(GRIPS):
    speed, used, power = (np.asarray(x[k]) for x in (table.speed, table.friction, table.power))
    active = ", ".join(trucks[k].certificate.active) or "none"
    kmh = f"{3.6 * speed.min():.1f} to {3.6 * speed.max():.1f}"
    print(f"{float(grip):9.2f}{kmh:>20s}{used.max():11.1%}{power.max() / 1e3:12.1f}   {active}")
    assert used.max() <= 0.8
    assert power.max() <= 210e3
slowest = np.asarray(table.speed.min(axis=1))
assert "friction" in trucks[0].certificate.active
assert "friction" not in trucks[-1].certificate.active
assert "power" in trucks[-1].certificate.active
assert slowest[-1] > slowest[0] + 1.0  # [m/s] more grip, more speed

# %%
wet = trucks[2]
print(wet.result)
wet.plot(frame=qt.Upright())

# %% [markdown]
# The figure shows the wet road (0.45). On slippery roads the limit on friction is active; on dry roads the limit on
# power is active. The work of the drive on the ramp equals the gain of energy plus the losses by drag and rolling
# resistance, to within rounding error.

# %%
nodes, weights = np.polynomial.legendre.leggauss(60)
half = 0.5 * float(wet.path.duration)
names = ("power", "speed", "normal_load")
found = {
    name: np.asarray(x)
    for name, x in qt.evaluate(wet.path, half * (nodes + 1), names, vehicle=wet.vehicle).values.items()
}
ends = qt.evaluate(wet.path, [0.0, 2 * half], ("speed", "position"))
energy = 32e3 * (0.5 * np.asarray(ends.speed) ** 2 + 9.80665 * np.asarray(ends.position)[:, 2])
lost = (0.5 * 1.225 * 6.2 * found["speed"] ** 2 + 0.006 * found["normal_load"]) * found["speed"]
drive, gain, loss = half * weights @ found["power"], energy[1] - energy[0], half * weights @ lost
print(f"work {drive / 1e3:.1f} kJ = energy {gain / 1e3:.1f} kJ + losses {loss / 1e3:.1f} kJ")
assert abs(drive - gain - loss) < 1e-12 * (abs(gain) + loss)
