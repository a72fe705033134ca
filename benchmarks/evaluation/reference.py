"""Provide references for `qtraj.evaluate`: NumPy with SciPy's Rotation, and a kernel in C if gcc is installed."""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

RADIUS, ANGLE, HEIGHT, DURATION = [20.0, 1.0, 0.3, -0.05], [0.2, 0.35], [1.0, 0.4, 0.05, -0.01], 4.5
CHANNELS = 17
FLAGS = ["-O3", "-march=native", "-ffast-math", "-fopenmp", "-shared", "-fPIC"]


def numpy_and_scipy(times, **options):
    """Evaluate the textbook formulas with NumPy arrays; each product is computed once.

    SciPy considers float32 matrices as not quite orthogonal. It therefore computes the singular values of each matrix,
    unless `options` contains assume_valid=True.
    """
    kind = times.dtype.type
    rho, h = [np.polynomial.Polynomial(np.asarray(c, kind)) for c in (RADIUS, HEIGHT)]
    w = kind(ANGLE[1])
    p = [rho.deriv(k)(times).astype(kind) for k in range(4)]
    along = [p[0], p[1], p[2] - w**2 * p[0], p[3] - 3 * w**2 * p[1]]
    across = [0 * p[0], w * p[0], 2 * w * p[1], 3 * w * p[2] - w**3 * p[0]]
    phi = kind(ANGLE[0]) + w * times
    cos, sin = np.cos(phi), np.sin(phi)
    heights = [h.deriv(k)(times).astype(kind) for k in range(4)]
    r = [
        np.stack([along[k] * cos - across[k] * sin, along[k] * sin + across[k] * cos, heights[k]], axis=-1)
        for k in range(4)
    ]
    c = np.cross(r[1], r[2])
    speed, area = np.linalg.norm(r[1], axis=-1), np.linalg.norm(c, axis=-1)
    tangent, binormal = r[1] / speed[:, None], c / area[:, None]
    axes = np.stack([tangent, np.cross(binormal, tangent), binormal], axis=-1)
    quaternion = Rotation.from_matrix(axes, **options).as_quat(scalar_first=True)
    curvature, torsion = area / speed**3, np.einsum("ij,ij->i", c, r[3]) / area**2
    return r[0], r[1], r[2], quaternion, curvature, torsion, speed * torsion, speed * curvature


class Kernel:
    """The kernel in C for one dtype; with `plain`, sine and cosine are calls of libm, otherwise they are vectorised."""

    def __init__(self, kind, plain):
        self.kind = np.dtype(kind)
        real = {"float64": "double", "float32": "float"}[self.kind.name]
        file = Path(tempfile.mkdtemp()) / "kernel.so"
        source = Path(__file__).with_name("kernel.c")
        extra = [f"-DREAL={real}", *(["-DPLAIN"] if plain else [])]
        subprocess.run(["gcc", *FLAGS, *extra, str(source), "-o", str(file), "-lm"], check=True)
        self.library = ctypes.CDLL(str(file))
        self.path = np.asarray([*RADIUS, *ANGLE, *HEIGHT], self.kind)

    @staticmethod
    def available():
        return shutil.which("gcc") is not None

    def evaluate(self, times, out):
        self.library.evaluate(_at(self.path), _at(times), ctypes.c_ssize_t(len(times)), _at(out))
        return out

    def peaks(self, times):
        out = np.empty(CHANNELS, self.kind)
        self.library.peaks(_at(self.path), _at(times), ctypes.c_ssize_t(len(times)), _at(out))
        return out

    def fill(self, out):
        self.library.fill(ctypes.c_ssize_t(out.shape[1]), _at(out))


def _at(array):
    return ctypes.c_void_p(array.ctypes.data)
