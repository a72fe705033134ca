# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # The two papers, formula by formula
#
# This library starts from two papers:
#
# - **S**: Sakhno, Kravets, Bas, Krivda, *Orientation of natural trihedral of the spiral-helix supporting trajectory of
#   spatial vehicle movement* (received 2017, in print 2018): where a vehicle must be, and how it is then oriented.
# - **C**: Chelnokov, *Quaternion solution of kinematic problems of rigid body orientation control*, part 1 (Mechanics
#   of Solids, 1993): how a body must rotate to reach an attitude, and how to correct errors.
#
# This notebook follows both papers in the order of their formulas, computes each formula in plain NumPy and with the
# library, and redraws the figures of S (C has none). Where a printed formula or its scan is wrong, the notebook
# computes both forms. It fails unless the printed form is wrong by more than one percent and the corrected form is
# correct to within rounding errors. The page [Errata](../docs/errata.md) contains the complete list, with remarks on
# scan errors.

# %%
# %matplotlib inline
import itertools

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.algebra import matrices
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import loops_figure, orientation_figure, path_figure, profiles_figure

ERRATA = []


def miss(actual, expected):
    """The largest deviation, relative to the largest component."""
    expected = np.asarray(expected)
    return float(np.max(np.abs(np.asarray(actual) - expected)) / np.max(np.abs(expected)))


def holds(actual, expected):
    """A formula that is printed right."""
    assert miss(actual, expected) < 1e-12, miss(actual, expected)


def erratum(where, printed, corrected, expected):
    """A formula that is not: both forms against the truth."""
    ERRATA.append((where, miss(printed, expected), miss(corrected, expected)))
    assert ERRATA[-1][1] > 1e-2, ERRATA[-1]
    assert ERRATA[-1][2] < 1e-12, ERRATA[-1]


# %% [markdown]
# # S: where the vehicle must be
#
# ## Boundary conditions (figure 1)
#
# The vehicle turns by a right angle about the vertical axis and climbs: at $t=0$ it is at $\bar r_A = \bar i r_{1A} +
# \bar k r_{3A}$ with $\bar V_A = \bar i V_{1A} + \bar j V_{2A} + \bar k V_{3A}$, at $t=t_k$ at $\bar r_B = \bar j
# r_{2B} + \bar k r_{3B}$ with $\bar V_B = -\bar i V_{1B} + \bar j V_{2B} + \bar k V_{3B}$. The hodograph is
#
# $$\bar r(t) = \rho(t)\,(\bar i\cos\omega t + \bar j\sin\omega t) + \bar k\,h(t),\qquad
#   \rho = \textstyle\sum\rho_k t^k,\quad h=\sum h_k t^k,\quad k = 0\ldots3 .$$
#
# There are ten boundary values for nine unknowns ($\rho_k$, $h_k$, $\omega$; $t_k=\pi/2\omega$). The paper notes that
# $V_{2A}/V_{1B} = r_{1A}/r_{2B}$ follows; in fact this is a *condition on the data*. We choose data that satisfy it.

# %%
r1A, r2B, r3A, r3B = 20.0, 26.0, 1.0, 9.0
V1A, V2A, V3A = 1.2, 8.0, 0.5
V1B, V2B, V3B = V2A / r1A * r2B, -0.7, 1.1

A = qt.BoundaryState([r1A, 0.0, r3A], [V1A, V2A, V3A])
B = qt.BoundaryState([0.0, r2B, r3B], [-V1B, V2B, V3B])
path = qt.SpiralHelix.from_boundary(A, B)
w, tk = V2A / r1A, np.pi * r1A / (2 * V2A)
holds(path.duration, tk)
holds(path.turn, np.pi / 2)  # "straight angle" in the horizontal special case is a slip for the right angle

data = path_dataset(
    {"hodograph r(t)": path}, attributes={"title": "S, figure 1: boundary conditions of a climbing turn"}
)
path_figure(data, trihedra=0, velocities=True, reference=True, view=(24, 35))

# %% [markdown]
# Data that violate the condition are rejected, with a message that contains both rates. `hermite` uses a polynomial
# angle and satisfies all ten values.

# %%
faster = qt.BoundaryState(B.position, [-1.3 * V1B, V2B, V3B])
try:
    qt.SpiralHelix.from_boundary(A, faster)
except ValueError as refusal:
    print(refusal)
else:
    raise AssertionError("ten numbers for nine unknowns were accepted")
complete = qt.SpiralHelix.hermite(A, faster, tk)
holds(complete.velocity(tk), faster.velocity)

# %% [markdown]
# ## The coefficients
#
# $$\rho_2 = \frac{3\Delta}{t_k^2} - \frac{V_{2B}+2V_{1A}}{t_k},\qquad
#   \rho_3 = -\frac{2\Delta}{t_k^3} + \frac{V_{2B}+V_{1A}}{t_k^2},\qquad \Delta = r_{2B}-r_{1A},$$
#
# and $h$ has the same form. The second term of the printed $\rho_3$ has a minus sign. After the substitution of
# $t_k=\pi r_{1A}/2V_{2A}$, the printed $\rho_3$ and $h_3$ also contain an extra factor of 2. The paper's complete
# expression for $\bar r(t)$ contradicts both misprints, and is correct.


# %%
def cubic(first, last, rate_first, rate_last, sign=1.0, factor=1.0):
    gap = last - first
    third = -2 * gap / tk**3 + sign * (rate_last + factor * rate_first) / tk**2
    return np.array([first, rate_first, 3 * gap / tk**2 - (rate_last + 2 * rate_first) / tk, third])


def at_the_end(coefficients):
    """Value and rate at t_k."""
    ascending = np.polynomial.Polynomial(coefficients)
    return np.array([ascending(tk), ascending.deriv()(tk)])


rho, h = (r1A, r2B, V1A, V2B), (r3A, r3B, V3A, V3B)
erratum("S: sign in ρ3", at_the_end(cubic(*rho, sign=-1.0)), at_the_end(cubic(*rho)), [r2B, V2B])
erratum("S: ρ3 with t_k put in", at_the_end(cubic(*rho, factor=2.0)), at_the_end(cubic(*rho)), [r2B, V2B])
erratum("S: h3 with t_k put in", at_the_end(cubic(*h, factor=2.0)), at_the_end(cubic(*h)), [r3B, V3B])
holds(cubic(*rho), path.radius)
holds(cubic(*h), path.height)

# Both printed t_k, and the four equations that the coefficients solve.
holds([np.pi * r1A / (2 * V2A), np.pi * r2B / (2 * V1B)], [tk, tk])
for p, (first, last, rate_first, rate_last) in ((path.radius, rho), (path.height, h)):
    holds(tk**2 * (p[2] + p[3] * tk), last - first - rate_first * np.pi * r1A / (2 * V2A))
    holds(tk * (2 * p[2] + 3 * p[3] * tk), rate_last - rate_first)


def full(t):
    """The full r(t), as it is printed."""
    turning = 2 * V2A / (np.pi * r1A)

    def part(first, last, rate_first, rate_last):
        square = turning * (6 * V2A / (np.pi * r1A) * (last - first) - rate_last - 2 * rate_first)
        cube = 4 / np.pi**2 * w**2 * (rate_last + rate_first - 4 * V2A / (np.pi * r1A) * (last - first))
        return first + rate_first * t + square * t**2 + cube * t**3

    return np.array([part(*rho) * np.cos(w * t), part(*rho) * np.sin(w * t), part(*h)])


t = 2.6  # [s] the instant at which everything below is compared
r, v, a, jerk = np.asarray(path.derivatives(t, 3))
holds(full(t), r)
for end, state in ((0.0, A), (tk, B)):
    holds(path.position(end), state.position)
    holds(path.velocity(end), state.velocity)

# %% [markdown]
# ## Special cases
#
# With $V_{1A}=V_{3A}=V_{2B}=V_{3B}=0$ each printed bracket keeps only its constant, quadratic and cubic terms,
#
# $$\rho = r_{1A} + \frac{12}{\pi^2}\left(\frac{V_{2A}}{r_{1A}}\right)^2(r_{2B}-r_{1A})\,t^2
#        - \frac{16}{\pi^3}\left(\frac{V_{2A}}{r_{1A}}\right)^3(r_{2B}-r_{1A})\,t^3,$$
#
# and $h$ has the same form. With $r_{3A}=r_{3B}=0$ the turn is horizontal. The vehicle does not stop at the ends, where
# its velocities are circumferential.


# %%
def special(t, r3A, r3B):
    """The printed r(t) of the special case."""

    def part(first, last):
        return first + 12 / np.pi**2 * w**2 * (last - first) * t**2 - 16 / np.pi**3 * w**3 * (last - first) * t**3

    return np.array([part(r1A, r2B) * np.cos(w * t), part(r1A, r2B) * np.sin(w * t), part(r3A, r3B)])


for low, high in ((r3A, r3B), (0.0, 0.0)):
    begin = qt.BoundaryState([r1A, 0.0, low], [0.0, V2A, 0.0])
    finish = qt.BoundaryState([0.0, r2B, high], [-V1B, 0.0, 0.0])
    case = qt.SpiralHelix.from_boundary(begin, finish)
    for instant in (0.4, t, 3.7):
        assert miss(case.position(instant), special(instant, low, high)) < 1e-12
    assert float(jnp.linalg.norm(case.velocity(0.0))) > 7.9  # [m/s]
    print(f"climb of {high - low:g} m: at {t} s the vehicle is at", np.round(special(t, low, high), 3))

# %% [markdown]
# ## The natural trihedral (figure 2)
#
# The trihedral at the moving point M has the unit vectors $\bar\tau = d\bar r/ds$, $\bar n = \frac1K d^2\bar r/ds^2$
# and $\bar b=\bar\tau\times\bar n$.

# %%
data.attrs["title"] = "S, figure 2: the hodograph and the natural trihedral"
path_figure(data, trihedra=5, reference=True, view=(24, 35))

# %% [markdown]
# The paper prints $K = |d\bar r/ds|$, which is 1 on every curve; the curvature is $|d^2\bar r/ds^2| = |\dot
# r\times\ddot r|/|\dot r|^3$. With time derivatives, each vector product multiplies the magnitude by a factor; some of
# these factors are missing in the printed formulas:
#
# $$\bar n = -\frac{\dot r\times(\dot r\times\ddot r)}{|\dot r||\dot r\times\ddot r|}
#   = \frac{(\dot r\cdot\dot r)\ddot r-(\dot r\cdot\ddot r)\dot r}{|\dot r||\dot r\times\ddot r|},\qquad
#   \bar b = -\frac{\dot r\times[\dot r\times(\dot r\times\ddot r)]}{|\dot r|^2|\dot r\times\ddot r|}
#   = \frac{\dot r\times\ddot r}{|\dot r\times\ddot r|}.$$

# %%
frame = qt.trihedral(path, t)
speed, c = np.linalg.norm(v), np.cross(v, a)
area = np.linalg.norm(c)
double, triple = np.cross(v, c), np.cross(v, np.cross(v, c))

holds(v / speed, frame.tangent)
erratum("S: curvature K", np.linalg.norm(v / speed), area / speed**3, frame.curvature)
erratum("S: n, denominator", -double / area, -double / (speed * area), frame.normal)
expanded = (v @ v) * a - (v @ a) * v
erratum("S: n expanded", -((v @ a) * a - (a @ v) * v) / area, expanded / (speed * area), frame.normal)
erratum("S: n over |ṙ||r̈|", -double / (speed * np.linalg.norm(a)), -double / (speed * area), frame.normal)
erratum("S: b, denominator", -triple / area, -triple / (speed**2 * area), frame.binormal)
holds(c / area, frame.binormal)

# %% [markdown]
# The paper expresses vector products by quaternion matrices: $\frac12(\dot R_0-\dot R_0')$ applied to $(0,\ddot r)$ is
# the vector product with $\dot r$, and the square and the cube of this matrix yield the double and triple products. The
# components of the double product are printed as zero. The printed determinants of the direction cosines are also zero,
# because their two rows are equal.

# %%
v1, v2, v3 = v
R0 = [[0, v1, v2, v3], [-v1, 0, -v3, v2], [-v2, v3, 0, -v1], [-v3, -v2, v1, 0]]
R0_prime = [[0, v1, v2, v3], [-v1, 0, v3, -v2], [-v2, -v3, 0, v1], [-v3, v2, -v1, 0]]
assert np.array_equal(matrices.r0(jnp.asarray(v)), R0)  # printed right, entry by entry
assert np.array_equal(matrices.r0_prime(jnp.asarray(v)), R0_prime)
b1, b2, b3 = np.random.default_rng(0).normal(size=(3, 3))
holds(matrices.double_product(b1, b2, b3), np.cross(b1, np.cross(b2, b3)))  # the two vector identities
holds(matrices.triple_product(b1, b2, b3, v), np.cross(b1, np.cross(b2, np.cross(b3, v))))
for times, product in ((1, c), (2, double), (3, triple)):
    holds(matrices.cross_repeated(jnp.asarray(v), jnp.asarray(a), times), product)
    holds(np.linalg.matrix_power(np.asarray(matrices.cross(jnp.asarray(v))), times) @ [0.0, *a], [0.0, *product])
holds(triple, -(v @ v) * c)

CYCLIC = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


def det(top, bottom):
    return top[0] * bottom[1] - top[1] * bottom[0]


dots = [v[i] * a[i] + v[j] * a[j] for _, i, j in CYCLIC]
squares = [v[i] ** 2 + v[j] ** 2 for _, i, j in CYCLIC]
printed = [v[k] * dots[k] - v[k] * dots[k] for k in range(3)]
erratum("S: double product", printed, [v[k] * dots[k] - a[k] * squares[k] for k in range(3)], double)

alpha = np.asarray(frame.dcm())
printed = [det((v[k], dots[k]), (v[k], dots[k])) / (speed * area) for k in range(3)]
corrected = [det((a[k], dots[k]), (v[k], squares[k])) / (speed * area) for k in range(3)]
erratum("S: α21, α22, α23", printed, corrected, alpha[1])
printed = [det((v[i], v[j]), (v[i], v[j])) / area for _, i, j in CYCLIC]
corrected = [det((v[i], v[j]), (a[i], a[j])) / area for _, i, j in CYCLIC]
erratum("S: α31, α32, α33", printed, corrected, alpha[2])
holds(alpha[0], v / speed)

# %% [markdown]
# ## Derivatives of the hodograph
#
# The derivatives are columns of powers of $t$, multiplied by the row of coefficients. In the paper, the row multiplies
# only the first column, the last entry of the acceleration has $t^2$ instead of $t^3$, and $\ddot r_2$ has a wrong
# sign.

# %%
value, slope = t ** np.arange(4), np.array([0, 1, 2 * t, 3 * t**2])
bend = np.array([0, 0, 2, 6 * t]) - w**2 * value
misprint = np.array([0, 0, 2, 6 * t]) - w**2 * np.array([1, t, t**2, t**2])
cos, sin = np.cos(w * t), np.sin(w * t)
p = np.asarray(path.radius)

printed = [p @ slope * cos - w * value.sum() * sin, p @ slope * sin + w * value.sum() * cos]
corrected = [p @ (slope * cos - w * value * sin), p @ (slope * sin + w * value * cos)]
erratum("S: ṙ1, ṙ2", printed, corrected, v[:2])
corrected = [p @ (bend * cos - 2 * w * slope * sin), p @ (bend * sin + 2 * w * slope * cos)]
printed = [p @ (misprint * cos - 2 * w * slope * sin), p @ (misprint * sin + 2 * w * slope * cos)]
erratum("S: r̈1, r̈2, last entry", printed, corrected, a[:2])
erratum("S: r̈2, sign", p @ (bend * sin - 2 * w * slope * cos), corrected[1], a[1])
holds([np.asarray(path.height) @ slope, np.asarray(path.height) @ [0, 0, 2, 6 * t]], [v[2], a[2]])

# %% [markdown]
# ## Rodrigues–Hamilton parameters
#
# With the quaternion matrices $A^t\cdot{}^tA^t = \mathrm{diag}(1, \alpha)$; its diagonal gives a linear system for the
# *squares* of the parameters. The printed solution lacks the leading 1 of the right-hand side. The squares do not
# determine the signs: seven of the eight sign patterns are wrong, so the off-diagonal cosines are also needed.
# `rotation.from_dcm` uses them.

# %%
q = frame.quaternion()
a0, a1, a2, a3 = np.asarray(q)
At = [[a0, a1, a2, a3], [-a1, a0, a3, -a2], [-a2, -a3, a0, a1], [-a3, a2, -a1, a0]]
tAt = [[a0, -a1, -a2, -a3], [a1, a0, a3, -a2], [a2, -a3, a0, a1], [a3, a2, -a1, a0]]
assert np.array_equal(matrices.at(q), At)  # printed right, entry by entry
assert np.array_equal(matrices.tat(q), tAt)
holds(matrices.at(q) @ matrices.tat(q), np.block([[np.ones((1, 1)), np.zeros((1, 3))], [np.zeros((3, 1)), alpha]]))
H = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]])
holds(H @ H, 4 * np.eye(4))
erratum("S: squares", H @ [0, *np.diag(alpha)] / 4, H @ [1, *np.diag(alpha)] / 4, np.asarray(q) ** 2)

roots = np.sqrt(np.asarray(qt.rotation.squares_from_dcm(frame.dcm())))
patterns = [np.array([1, *signs]) for signs in itertools.product([1, -1], repeat=3)]
right = [s for s in patterns if miss(qt.rotation.to_dcm(jnp.asarray(roots * s)), alpha) < 1e-12]
print(f"{len(right)} of {len(patterns)} sign patterns is the trihedral: {right[0]}")
assert len(right) == 1
holds(qt.rotation.to_dcm(qt.rotation.from_dcm(frame.dcm())), alpha)

# %% [markdown]
# The same matrices give the kinematics of the trihedral (Alpatov, Kravets, Kravets and Lapkhanov, 2021): $\omega$
# from $\lambda$ and $\dot\lambda$, and the derivative of $A^t\cdot{}^tA^t$, whose rows are $\dot{\bar\tau}$,
# $\dot{\bar n}$, $\dot{\bar b}$. They must agree with Frenet and Serret: $\omega=v(\chi\bar\tau+K\bar b)$.

# %%
followed = qt.FrameProgram(path)
lam, lam_slope = jax.jvp(lambda t: followed(t).quaternion, (jnp.asarray(t),), (jnp.asarray(1.0),))
K, chi = float(frame.curvature), float(frame.torsion)
serret = speed * np.array([[0.0, K, 0.0], [-K, 0.0, chi], [0.0, -chi, 0.0]])
holds(matrices.rate(lam, lam_slope), [speed * chi, 0.0, speed * K])
holds(matrices.rotation_slope(lam, lam_slope)[1:, 1:], serret @ alpha)
holds(0.5 * matrices.kinematic(jnp.asarray([speed * chi, 0.0, speed * K])) @ lam, lam_slope)

# %% [markdown]
# ## The Gibbs vector
#
# $G_k=\alpha_k/\alpha_0$ has the same components in both bases, $\alpha G = G$. The paper prints six ratios of
# direction cosines for it, each 0/0 where its denominator $4\alpha_0\alpha_k$ vanishes. In the paper's own horizontal
# turn both ratios for $G_3$, the only nonzero component, are undefined. The following forms are regular up to 180°:
# $G_1=(\alpha_{23}-\alpha_{32})/(1+\mathrm{tr}\,\alpha)$, and cyclically.

# %%
G = frame.gibbs()
holds(alpha @ np.asarray(G), G)
holds(qt.rotation.gibbs_ratios(frame.dcm()), np.repeat(np.asarray(G)[:, None], 2, axis=1))
regular = [alpha[1, 2] - alpha[2, 1], alpha[2, 0] - alpha[0, 2], alpha[0, 1] - alpha[1, 0]]
holds(np.array(regular) / (1 + np.trace(alpha)), G)

level = qt.SpiralHelix(path.radius, path.angle, [0.0], path.duration)
flat = qt.trihedral(level, t)
ratios = np.asarray(qt.rotation.gibbs_ratios(flat.dcm()))
print("level turn: printed ratios for G3:", ratios[2], " regular form:", qt.rotation.gibbs_from_dcm(flat.dcm())[2])
assert not np.isfinite(ratios[2]).any()
heading = np.arctan2(flat.tangent[1], flat.tangent[0])
holds(qt.rotation.gibbs_from_dcm(flat.dcm())[2], np.tan(heading / 2))

# %% [markdown]
# ## A flip of the trihedral
#
# In the horizontal special case ($V_{1A}=V_{2B}=0$, $r_{3A}=r_{3B}=0$) the vertical component of $\dot r\times\ddot r$
# is $\omega(\omega^2\rho^2+2\dot\rho^2-\rho\ddot\rho)$. It changes sign when $r_{2B}/r_{1A} > 1+\pi^2/24\approx1.411$
# (or is below the inverse): the path first bends to the *other* side, and at the inflection point $\bar n$ and $\bar b$
# jump by 180°. For $r_{2B}=2r_{1A}$ this happens at $0.1689\,t_k$. At that instant, which the figure marks, the natural
# trihedral does not exist.

# %%
doubled = qt.SpiralHelix.from_boundary(
    qt.BoundaryState([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), qt.BoundaryState([0.0, 2.0, 0.0], [-2.0, 0.0, 0.0])
)
profile = np.polynomial.Polynomial(np.asarray(doubled.radius))
component = profile**2 + 2 * profile.deriv() ** 2 - profile * profile.deriv(2)  # ω = 1
[flip] = [x.real for x in component.roots() if abs(x.imag) < 1e-9 and 0 < x.real < float(doubled.duration)]
assert round(flip / float(doubled.duration), 4) == 0.1689
table = qt.evaluate(doubled, jnp.linspace(0.0, doubled.duration, 401), outputs=("quaternion", "defined", "dcm"))
up = np.asarray(table.dcm)[:, 2, 2]
assert np.array_equal(np.sign(up), np.where(np.asarray(table.time) < flip, -1.0, 1.0))
orientation_figure(
    table.time, table.quaternion, table.defined, "S, horizontal turn with r2B = 2 r1A: the trihedral flips"
)

# %% [markdown]
# ## Contact forces and power (conclusions)
#
# The paper concludes with the contact forces that keep a vehicle on the path, and with the power of these forces.
# $\bar F = m\ddot r - m\bar g$ has the components $m\dot v - m g_\tau$ along $\bar\tau$, $m\kappa v^2 - m g_n$ along
# $\bar n$ and $-m g_b$ along $\bar b$. Its power $\bar F\cdot\dot r$ is the rate of the energy $\frac12mv^2+mgh$, so
# over the whole turn its work is the difference of that energy, which the quadrature below confirms to round-off.

# %%
MASS, GRAVITY = 12_000.0, 9.80665  # [kg], [m/s²]
force = qt.dynamics.forces(path, t, MASS, GRAVITY)
weight = alpha @ [0.0, 0.0, -MASS * GRAVITY]
along, inward = (v @ a) / speed, float(frame.curvature) * speed**2
holds(force, np.array([MASS * along, MASS * inward, 0.0]) - weight)
holds(qt.dynamics.power(path, t, MASS, GRAVITY), force[0] * speed)  # no force across the motion does work
print(f"along τ, n, b: {np.round(np.asarray(force) / 1e3, 2)} kN, power {float(force[0]) * speed / 1e3:.1f} kW")


def energy(t):
    return MASS * (0.5 * path.velocity(t) @ path.velocity(t) + GRAVITY * path.position(t)[2])


points, weights = np.polynomial.legendre.leggauss(8)  # exact for this polynomial power, of degree 9
powers = jax.vmap(lambda t: qt.dynamics.power(path, t, MASS, GRAVITY))(0.5 * tk * (points + 1))
holds(0.5 * tk * weights @ np.asarray(powers), energy(tk) - energy(0.0))

# %% [markdown]
# A `Vehicle` adds air drag, tyres and the bank of the road. The force $\bar F$ then includes the drag
# $\frac12\rho C_dA\,v\dot r$, and the drive power includes the rolling resistance $C_{rr}F_b$. `friction` is the used
# fraction of the grip, according to the friction ellipse of the tyres. `moment` contains the moments
# $J\varepsilon+\omega\times J\omega$ about $\bar\tau$, $\bar n$, $\bar b$ for a body that rotates with the trihedral.
# The energy balance is satisfied again: the work of the drive equals the gain of energy plus the losses, and the work
# of the moments equals the gain of $\frac12\omega\cdot J\omega$. If $\bar\tau$, $\bar n$, $\bar b$ are principal axes,
# each of the three moments can also be limited, and its limit is proved like a limit on a force. In the figure,
# `friction` exceeds 1, because this turn is too fast for these tyres.

# %%
J = np.diag([15e3, 60e3, 66e3])  # [kg m²]
truck = qt.Vehicle(MASS, J, drag_area=6.0, rolling_resistance=0.007, friction=(0.6, 0.5))
points, weights = np.polynomial.legendre.leggauss(60)
instants, weights = 0.5 * tk * (points + 1), 0.5 * tk * weights
outputs = ("force", "moment", "normal_load", "power", "speed", "rate")
driven = {name: np.asarray(x) for name, x in qt.evaluate(path, instants, outputs, vehicle=truck).values.items()}

drag = 0.5 * 1.225 * 6.0 * driven["speed"] ** 2
rolling = 0.007 * driven["normal_load"]
without_air = np.asarray(jax.vmap(lambda t: qt.dynamics.forces(path, t, MASS, GRAVITY))(instants))
holds(driven["force"], without_air + drag[:, None] * [1.0, 0.0, 0.0])
work = {"drive": driven["power"], "drag": drag * driven["speed"], "rolling": rolling * driven["speed"]}
work = {name: float(weights @ power) for name, power in work.items()}
gained = float(energy(tk) - energy(0.0))
holds(work["drive"], gained + work["drag"] + work["rolling"])
ends = np.asarray(qt.evaluate(path, [0.0, tk], ("rate",)).rate)
spun = 0.5 * np.einsum("ni,ij,nj->n", ends, J, ends)
holds(weights @ np.sum(driven["moment"] * driven["rate"], axis=1), spun[1] - spun[0])
turning = ("tangential_moment", "normal_moment", "binormal_moment")
components = qt.evaluate(path, instants, turning, vehicle=truck).values
holds(np.stack([components[name] for name in turning], axis=1), np.abs(driven["moment"]))
peaks = {name: 1.001 * float(qt.peak(path, name, truck)[1]) for name in turning}
assert set(qt.certify(path, qt.Limits(**peaks, vehicle=truck)).status.values()) == {"proved"}
losses = ", ".join(f"{name} {work[name] / 1e3:.1f} kJ" for name in ("drag", "rolling"))
print(f"work of the drive {work['drive'] / 1e3:.1f} kJ = energy {gained / 1e3:.1f} kJ + {losses}")

# The grip by the friction ellipse, from the components in the plane of a banked road.
banked = qt.Vehicle(MASS, drag_area=6.0, friction=(0.6, 0.5), bank=0.05)
seen = qt.evaluate(path, [t], ("force", "lateral_force", "normal_load", "friction"), qt.Upright(), vehicle=banked)
ahead, left, above = np.asarray(seen.force[0])
across, load = (np.array([[np.cos(0.05), -np.sin(0.05)], [np.sin(0.05), np.cos(0.05)]]) @ [left, above]).tolist()
holds(seen.lateral_force[0], abs(across))
holds(seen.normal_load[0], load)
holds(seen.friction[0], np.hypot(ahead / 0.6, across / 0.5) / load)
even = jnp.linspace(0.0, tk, 201)
qt.evaluate(path, even, ("force", "moment", "friction", "power"), vehicle=truck).plot()

# %% [markdown]
# # C: how the body must turn
#
# ## Equations of motion (1.2)–(1.6)
#
# $\dot\omega_x=\varepsilon_x$, $2\dot\lambda = \lambda\circ\omega_x$, where $\lambda$ may have *any* nonzero norm:
# $\omega_x=\omega_0+\omega_v$ has a scalar part, which changes only $|\lambda|$. In inertial axes
# $2\dot\lambda=\omega_\xi\circ\lambda$ with $\omega_\xi=\lambda\circ\omega_x\circ\lambda^{-1}$.

# %%
product, inverse = qt.quaternion.product, qt.quaternion.inverse
STEADY, GROWING, GROWTH = jnp.array([0.4, -0.2, 0.7]), jnp.array([-0.1, 0.5, 0.2]), 0.3


def attitude(t):
    """An attitude that turns and grows, |λ| = exp(0.3 t²)."""
    turning = product(qt.quaternion.exp(t * STEADY), qt.quaternion.exp(t**2 * GROWING))
    return jnp.exp(GROWTH * t**2) * turning


def rate_of(f, t):
    return jax.jvp(f, (t,), (jnp.ones_like(t),))[1]


def body_rate(t):
    return 2 * product(inverse(attitude(t)), rate_of(attitude, t))


def inertial_rate(t):
    return 2 * product(rate_of(attitude, t), inverse(attitude(t)))


@jax.jit
def motion(t):
    x, xi = body_rate(t), inertial_rate(t)
    changed = [product(product(attitude(t), y), inverse(attitude(t))) for y in (x, rate_of(body_rate, t))]
    logarithm = rate_of(lambda t: jnp.log(qt.quaternion.norm_squared(attitude(t))), t)
    return attitude(t), rate_of(attitude, t), x, xi, rate_of(inertial_rate, t), changed, logarithm


lam, lam_rate, omega, omega_xi, epsilon_xi, changed, logarithm = motion(jnp.asarray(0.7))
holds(changed[0], omega_xi)
holds(changed[1], epsilon_xi)
holds(2 * qt.quaternion.derivative(lam, omega), 2 * lam_rate)
holds(product(omega_xi, lam), 2 * lam_rate)  # (1.4)
holds(2 * qt.quaternion.derivative(lam, omega_xi, axes="inertial"), 2 * lam_rate)

(l0, l1, l2, l3), (w0, w1, w2, w3) = np.asarray(lam), np.asarray(omega)
scalar_equations = [  # (1.3), printed right
    w0 * l0 - w1 * l1 - w2 * l2 - w3 * l3,
    w1 * l0 + w0 * l1 + w3 * l2 - w2 * l3,
    w2 * l0 - w3 * l1 + w0 * l2 + w1 * l3,
    w3 * l0 + w2 * l1 - w1 * l2 + w0 * l3,
]
holds(scalar_equations, 2 * lam_rate)
erratum("C: sign of ω0 = d/dt ln|λ|²", -logarithm, logarithm, omega[0])

# %% [markdown]
# $\varepsilon_0$ is free: we can choose any law for the norm, without effect on the body. Here $\varepsilon_0=0.2$, so
# $|\lambda(t)|^2=|\lambda(0)|^2\exp\int\omega_0$, while the attitude is a steady spin.

# %%
instants = jnp.linspace(0.0, 4.0, 41)
spin = jnp.array([0.0, 0.3, -0.5, 0.4])
grown = qt.integrate(lambda t, q, w: jnp.array([0.2, 0.0, 0.0, 0.0]), [1.0, 0.0, 0.0, 0.0], spin, instants)
assert np.allclose(grown.norm, np.exp(0.05 * instants**2), rtol=1e-9)
steady = jax.vmap(lambda t: qt.rotation.to_dcm(qt.quaternion.exp(0.5 * t * spin[1:])))(instants)
assert np.allclose(jax.vmap(qt.rotation.to_dcm)(grown.quaternion), steady, atol=1e-9)
print(f"|λ| grew to {grown.norm[-1]:.3f} = exp(0.8); the attitude is that of the steady spin")

# %% [markdown]
# ## The Euler turn about a fixed axis (3.1)–(3.15)
#
# A rotation by $\Phi_*$ about one axis $e$ leads from any attitude to any other: $a=\bar\lambda_0\circ\lambda_*$,
# $\cos(\Phi_*/2)=a_0$, $e=a_v/\sin(\Phi_*/2)$, and $\lambda^0(t) =
# \lambda_0\circ(\cos\frac{\Phi(t)}2+e\sin\frac{\Phi(t)}2)$, $\omega^0=\dot\Phi e$, $\varepsilon^0=\ddot\Phi e$. The
# printed $(\sin\Phi_*/2)^{-1}$ must be read as $1/\sin(\Phi_*/2)$. $\arccos a_0$ loses small angles, so the
# library uses $\Phi_*=2\,\mathrm{atan2}(|a_v|,|a_0|)$.

# %%
start = qt.quaternion.exp(jnp.array([0.3, -0.8, 0.5]) / 2)
axis, angle = np.array([2.0, -1.0, 2.0]) / 3, np.radians(90.0)
end = product(start, qt.quaternion.exp(jnp.asarray(angle * axis / 2)))
turn = qt.EulerTurn(start, end, qt.TimeOptimal(np.radians(1.0), np.radians(0.05)))
a_z, a_xi = product(qt.quaternion.conjugate(start), end), product(end, qt.quaternion.conjugate(start))  # (3.5), (3.3)
holds(a_z[0], np.cos(angle / 2))
erratum("C: (3.9), (3.10)", a_z[1:] / (np.sin(angle) / 2), a_z[1:] / np.sin(angle / 2), turn.axis())
holds(a_xi[1:] / np.sin(angle / 2), turn.axis("inertial"))
holds(turn.angle, angle)

tiny = product(qt.quaternion.conjugate(start), product(start, qt.quaternion.exp(jnp.asarray(0.5e-9 * axis))))
with np.errstate(invalid="ignore"):
    print("a turn by 1e-9 rad: arccos gives", 2 * np.arccos(float(tiny[0])), end=", ")
print("atan2 gives", np.linalg.norm(qt.rotation.to_rotation_vector(tiny)))

now = turn(37.0)
assert np.allclose(now.rate, turn.profile.rate(37.0) * axis, atol=1e-15)  # (3.15)
program_rate = 2 * product(
    qt.quaternion.conjugate(now.quaternion), rate_of(lambda t: turn(t).quaternion, jnp.asarray(37.0))
)
assert np.allclose(program_rate, [0.0, *now.rate], atol=1e-12)  # (1.5)

# The same in inertial axes: (1.6), (3.12), (3.14).
inertial = turn.at(37.0, axes="inertial")
doubled_slope = 2 * rate_of(lambda t: turn(t).quaternion, jnp.asarray(37.0))
holds(product(jnp.array([0.0, *inertial.rate]), now.quaternion), doubled_slope)  # (1.6)
holds(inertial.rate, qt.quaternion.rotate(now.quaternion, now.rate))
slope = rate_of(lambda t: turn.at(t, axes="inertial").rate, jnp.asarray(37.0))
assert np.allclose(slope, inertial.acceleration, atol=1e-15)
half, e_xi = float(turn.profile.angle(37.0)) / 2, np.asarray(a_xi[1:]) / np.sin(angle / 2)
holds(product(jnp.array([np.cos(half), *np.sin(half) * e_xi]), start), now.quaternion)  # (3.12)
assert np.allclose(inertial.rate, turn.profile.rate(37.0) * e_xi, atol=1e-15)  # (3.14)
assert np.allclose(inertial.acceleration, turn.profile.acceleration(37.0) * e_xi, atol=1e-15)

# So are the rates of the trihedral: of its program, of `trihedral` and of `evaluate`.
attitude_there = followed(t).quaternion
doubled_slope = 2 * rate_of(lambda t: followed(t).quaternion, jnp.asarray(t))
for rate in (
    followed.at(t, axes="inertial").rate,
    qt.trihedral(path, t, axes="inertial").rate,
    qt.evaluate(path, [t], ("rate",), axes="inertial").rate[0],
):
    holds(product(jnp.array([0.0, *rate]), attitude_there), doubled_slope)

# %% [markdown]
# $\Phi(t)$ follows from limits on rate and acceleration. The paper names relay laws, polynomials and prescribed
# durations. A cubic with a prescribed duration has no free coefficient for limits; its peaks are $1.5\Phi/T$
# and $6\Phi/T^2$.

# %%
limits = np.radians(1.0), np.radians(0.05)
laws = {"time-optimal": qt.TimeOptimal(*limits), "cubic": qt.Cubic(max_rate=limits[0], max_acceleration=limits[1])}
profiles = {name: law.profile(angle) for name, law in laws.items()}
assert abs(float(profiles["time-optimal"].duration) - 110.0) < 1e-9
assert abs(float(profiles["cubic"].duration) - max(1.5 * angle / limits[0], np.sqrt(6 * angle / limits[1]))) < 1e-9
profiles_figure(profiles, *limits, title="C, section 3: an Euler turn by 90° under 1 °/s and 0.05 °/s²")

# %% [markdown]
# A cubic *spline* has knots, so it can have a prescribed duration and satisfy limits. The example is a slew of 90°
# within 0.8 rad/s and 2 rad/s². A single cubic needs at least 2.95 s. The spline with the smallest $\int\ddot\Phi^2dt$
# also satisfies the limits in 2.8 s, and in shorter durations down to the minimum time of 2.36 s.

# %%
try:
    qt.Cubic(2.8, 0.8, 2.0).profile(angle, unit="rad")
except ValueError as refusal:
    print(refusal)
else:
    raise AssertionError("a single cubic met its limits")
fastest = qt.TimeOptimal(0.8, 2.0).profile(angle)
splines = {f"cubic spline in {time:g} s": qt.MultiKnotCubic(time, 0.8, 2.0).profile(angle) for time in (2.8, 2.4)}
for spline in splines.values():
    assert float(spline.peak(1)[1]) < 0.8 * (1 + 1e-9)
    assert float(spline.peak(2)[1]) < 2.0 * (1 + 1e-9)
print(f"minimum time {float(fastest.duration):.4f} s")
assert round(float(fastest.duration), 2) == 2.36
profiles_figure(splines | {"time-optimal": fastest}, 0.8, 2.0, title="90° within 0.8 rad/s and 2 rad/s²")

# %% [markdown]
# The shortest rotation has $\Phi_*\le180°$. For $a_0<0$ the program therefore ends at $-\lambda_*$, the same attitude
# with the opposite sign, and later errors must be computed relative to that sign.

# %%
far = product(start, qt.quaternion.exp(jnp.asarray(np.radians(250.0) * axis / 2)))
short = qt.EulerTurn(start, far, qt.TimeOptimal(*limits))
holds(short.angle, np.radians(110.0))
holds(short.end, -far)

# %% [markdown]
# ## The program as open-loop control
#
# $\varepsilon^0(t)$ is itself a control: under this acceleration, a body that starts with the state of the program
# follows the program, in body axes (3.15) and in inertial axes (3.14). Open-loop control does not correct errors. Under
# a constant disturbance of 0.003 °/s² the final attitude error of this slew, which takes 110 s, is 17°. Under feedback
# with the error equation below, the error of the same body is small and does not grow.

# %%
instants = jnp.linspace(0.0, turn.duration, 111)
for axes in ("body", "inertial"):
    reproduced = qt.open_loop(turn, instants, axes=axes)
    print(f"open loop in {axes} axes: at most {float(reproduced.angle.max()):.0e} rad from the program")
    assert float(reproduced.angle.max()) < 1e-8
push = jnp.radians(jnp.array([0.0, 0.003, 0.0]))
slow = qt.AccelerationLaw(*qt.control.from_settling_time(20.0))
corrected = qt.simulate(turn, slow, start, jnp.zeros(4), instants, disturbance=lambda t: push, jumps=turn.switches)
disturbed = {"open loop": qt.open_loop(turn, instants, disturbance=lambda t: push), "with feedback": corrected}
for name, result in disturbed.items():
    print(f"{name}, disturbed: {np.degrees(result.angle[-1]):.3f}° from the program at the end")
assert np.degrees(disturbed["open loop"].angle[-1]) > 10.0
assert np.isclose(corrected.angle[-1], jnp.linalg.norm(push) / slow.k2, rtol=1e-3)  # from the error equation at rest
loops_figure(disturbed, title="The program as control, disturbed, without and with feedback")

# %% [markdown]
# ## Feedback control (section 2) and the law of part 2
#
# The command is the acceleration of the program plus a correction, (2.1) in body axes or (2.2) in inertial axes. Part 1
# ends before the feedback laws. From its equations it follows, with the error $\mu=\bar\lambda^0\circ\lambda$, that
#
# $$\varepsilon_x = \mu^{-1}\circ[\varepsilon_z^0\circ\mu + \omega_z^0\circ\dot\mu - \dot\mu\circ\omega_x
#   - 2K_1\dot\mu - 2K_2(\mu-1)]
#   \iff \ddot\mu + K_1\dot\mu + K_2(\mu-1)=0 .$$
#
# The error equation is linear, time-invariant and independent of the program, so it has a closed form, with which we
# compare the simulation. The program is in motion, and the body starts with an error of 60° and a tumbling motion.

# %%
gains = qt.control.from_settling_time(6.0, 0.01)
swift = qt.EulerTurn(start, end, qt.Quintic(duration=8.0))
off = product(start, qt.quaternion.exp(jnp.radians(jnp.array([40.0, -30.0, 33.0])) / 2))
tumbling = jnp.array([0.0, 0.2, -0.1, 0.3])
instants = jnp.linspace(0.0, 8.0, 161)
law = qt.AccelerationLaw(*gains)
loop = qt.simulate(swift, law, off, tumbling, instants)
now, lam, command = swift(0.5), loop.quaternion[10], loop.command[10]
mu, mu_rate = qt.control.error_quaternion(swift(0.0), off), qt.control.error_rate(swift(0.0), off, tumbling)
closed = qt.error_response(law, mu, mu_rate, instants)
gap = float(jnp.abs(loop.error - closed).max())
print(f"largest difference of simulation and closed form: {gap:.1e}")
assert gap < 1e-9

# The command at 0.5 s, in the form of (2.1) and of (2.2): different corrections, one acceleration.
delta = qt.control.body_correction(now, command)
holds(qt.control.body_command(now, delta), command)
big_delta = qt.control.inertial_correction(now, lam, command)
holds(qt.control.inertial_command(now, lam, big_delta), command)
print(f"|δε| = {jnp.linalg.norm(delta[1:]):.4f}, |Δε| = {jnp.linalg.norm(big_delta[1:]):.4f} rad/s²")
assert abs(jnp.linalg.norm(delta[1:]) - jnp.linalg.norm(big_delta[1:])) > 1e-3  # as the paper remarks
loops_figure({"simulated": loop}, {"simulated": closed}, np.radians(1.0), "The law of part 2 against its closed form")

# %% [markdown]
# ## Three forms of the error
#
# The error may be the rotation in body axes $\mu=\bar\lambda^0\circ\lambda$, the rotation in inertial axes
# $\mu^*=\lambda\circ\bar\lambda^0$, or the difference $\lambda-\lambda^0$. Each error has its own law, and each obeys
# the same linear equation exactly.

# %%
shared = jnp.linspace(0.0, 6.0, 61)
for form in ("body", "inertial", "additive"):
    own = qt.AccelerationLaw(*gains, error=form)
    result = qt.simulate(swift, own, off, tumbling, shared)
    first = qt.control.error_quaternion(swift(0.0), off, form), qt.control.error_rate(swift(0.0), off, tumbling, form)
    expected = qt.error_response(own, *first, shared)
    programmed = jax.vmap(lambda t: swift(t).quaternion)(shared)
    conjugates = jax.vmap(qt.quaternion.conjugate)(programmed)
    errors = {
        "body": lambda: jax.vmap(product)(conjugates, result.quaternion),  # noqa: B023
        "inertial": lambda: jax.vmap(product)(result.quaternion, conjugates),  # noqa: B023
        "additive": lambda: result.quaternion - programmed,  # noqa: B023
    }
    gap = float(jnp.abs(errors[form]() - expected).max())
    print(f"{form:9s} error against its closed form: {gap:.0e}")
    assert gap < 1e-8

# %% [markdown]
# ## Optimal gains
#
# For this linear error equation, optimal gains are known in closed form. The gains that minimise $\int(q_1x^2+q_2\dot
# x^2+ru^2)\,dt$ for $\ddot x=u$ are $K_2=\sqrt{q_1/r}$, $K_1=\sqrt{q_2/r+2K_2}$. SciPy's solver of the Riccati equation
# returns the same gains.

# %%
from scipy.linalg import solve_continuous_are

q1, q2, weight_u = 2.0, 0.7, 0.4
optimal = qt.control.from_weights(q1, q2, weight_u)
riccati = solve_continuous_are(np.array([[0.0, 1.0], [0.0, 0.0]]), [[0.0], [1.0]], np.diag([q1, q2]), [[weight_u]])
holds(optimal[::-1], riccati[1] / weight_u)
print(f"K1 = {optimal[0]:.4f} 1/s, K2 = {optimal[1]:.4f} 1/s²")

# %% [markdown]
# ## Remarks 1 and 2
#
# **Remark 1.** A strapdown system measures $\omega_x$ in body axes, and computes $\lambda$ from the measurements. Here
# the gyro of the body above is sampled, and the attitude that is propagated from its samples equals the attitude of the
# simulation. So the command can be computed in body axes, by (2.1). A manipulator without such gyros computes it in
# inertial axes, by (2.2).
#
# **Remark 2.** For a spherical body the torques are $M=J\varepsilon$, so the kinematic solution is also the dynamic
# solution: under Euler's equations the motion is the same. With a general inertia the torques are
# $J\varepsilon+\omega\times J\omega$, and the error equation is still exact if the on-board computer knows this
# inertia.

# %%
fine = jnp.linspace(0.0, 8.0, 1601)
flight = qt.simulate(swift, law, off, tumbling, fine)
strapdown = qt.propagate_samples(fine, flight.rate[:, 1:], flight.quaternion[0])
drift = jax.vmap(lambda p, q: qt.rotation.to_rotation_vector(product(qt.quaternion.conjugate(p), q)))
print(f"remark 1: strapdown attitude within {float(jnp.abs(drift(strapdown, flight.quaternion)).max()):.0e} rad")
assert float(jnp.abs(drift(strapdown, flight.quaternion)).max()) < 1e-5

holds(qt.dynamics.torque(now, 35.0), 35.0 * np.asarray(now.acceleration))
for name, inertia in {"spherical body": 35.0, "body with three moments": (20.0, 35.0, 50.0)}.items():
    moved = qt.simulate(swift, law, off, tumbling, loop.times, body=qt.RigidBody(inertia))
    gap = float(jnp.abs(moved.quaternion - loop.quaternion).max())
    print(f"remark 2: a {name} under torques deviates by {gap:.0e} from the kinematic solution")
    assert gap < 1e-7

# %% [markdown]
# ## Summary of the misprints
#
# Every printed formula in the table is wrong by at least one percent, and every corrected formula is correct to within
# rounding errors. The conditions that the papers omit (boundary data, signs of the parameters, the flip, the final sign
# of a slew) are shown above.

# %%
print(f"{'formula':32s}{'as printed':>12s}{'corrected':>12s}")
for where, printed, corrected in ERRATA:
    print(f"{where:32s}{printed:12.1e}{corrected:12.1e}")
