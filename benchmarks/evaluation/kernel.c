/* The evaluation by hand: one fused loop over the instants of a spiral-helix with uniform rotation.
 *
 * Compiled by the benchmark, for float and for double (-DREAL=...), with
 *     gcc -O3 -march=native -ffast-math -fopenmp -shared -fPIC
 * `evaluate` writes 17 channels, each contiguous over the instants: position, velocity, acceleration, quaternion,
 * curvature, torsion and the two components of the rate that are not zero. `peaks` reduces the same 17 channels to
 * their maxima without writing them. `fill` writes the same bytes and computes nothing.
 */
#include <math.h>
#include <stddef.h>

#ifndef REAL
#define REAL double
#endif
#define CHANNELS 17

typedef struct {
    REAL radius[4], angle[2], height[4]; /* ascending coefficients */
} path;

/* Plain names, no array: the compiler vectorises over the instants only so. */
#define EACH(do) do(0) do(1) do(2) do(3) do(4) do(5) do(6) do(7) do(8) do(9) do(10) do(11) do(12) do(13) do(14) do(15) do(16)
#define MOST m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16
typedef struct {
#define DECLARE(k) REAL c##k;
    EACH(DECLARE)
} channels;

#ifdef PLAIN
static inline void turn(REAL x, REAL *c, REAL *s) { *c = (REAL)cos(x), *s = (REAL)sin(x); } /* a call of sincos each */
#else
/* Reduction by multiples of π/2 and two polynomials, so that the whole loop is vectorised. */
static inline __attribute__((always_inline)) void turn(REAL x, REAL *c, REAL *s) {
    const REAL n = (REAL)floor(x * (REAL)0.6366197723675814 + (REAL)0.5);
    const REAL r = (x - n * (REAL)1.5707963267341256) - n * (REAL)6.077100506506192e-11, z = r * r;
    const REAL a = (REAL)-0.16666666666666666 + z * ((REAL)0.008333333333330946 + z * ((REAL)-0.0001984126983675497 +
        z * ((REAL)2.755731610068303e-06 + z * ((REAL)-2.5051131455427946e-08 + z * (REAL)1.591810123027412e-10))));
    const REAL b = (REAL)0.041666666666666664 + z * ((REAL)-0.0013888888888887395 + z * ((REAL)2.4801587298763433e-05 +
        z * ((REAL)-2.7557317270560326e-07 + z * ((REAL)2.0876146024689747e-09 + z * (REAL)-1.1382614868556325e-11))));
    const REAL sine = r + r * z * a, cosine = 1 - (REAL)0.5 * z + z * z * b;
    const int q = (int)n;
    const REAL s1 = (q & 1) ? cosine : sine, c1 = (q & 1) ? sine : cosine;
    *s = (q & 2) ? -s1 : s1, *c = ((q + 1) & 2) ? -c1 : c1;
}
#endif

static inline __attribute__((always_inline)) channels instant(const path *p, REAL t) {
    const REAL *a = p->radius, *b = p->height, w = p->angle[1];
    const REAL rho = ((a[3] * t + a[2]) * t + a[1]) * t + a[0];
    const REAL rho1 = (3 * a[3] * t + 2 * a[2]) * t + a[1];
    const REAL rho2 = 6 * a[3] * t + 2 * a[2];
    const REAL rho3 = 6 * a[3];
    const REAL h = ((b[3] * t + b[2]) * t + b[1]) * t + b[0];
    const REAL z1 = (3 * b[3] * t + 2 * b[2]) * t + b[1];
    const REAL z2 = 6 * b[3] * t + 2 * b[2];
    const REAL z3 = 6 * b[3];
    const REAL phi = p->angle[0] + w * t;
    REAL c, s;
    turn(phi, &c, &s);
    /* the derivatives in the rotating basis */
    const REAL x1 = rho1, y1 = rho * w;
    const REAL x2 = rho2 - w * w * rho, y2 = 2 * w * rho1;
    const REAL x3 = rho3 - 3 * w * w * rho1, y3 = 3 * w * rho2 - w * w * w * rho;
    const REAL cx = y1 * z2 - z1 * y2, cy = z1 * x2 - x1 * z2, cz = x1 * y2 - y1 * x2;
    const REAL S = x1 * x1 + y1 * y1 + z1 * z1, N = cx * cx + cy * cy + cz * cz, T = cx * x3 + cy * y3 + cz * z3;
    const REAL v = (REAL)sqrt(S), area = (REAL)sqrt(N), iv = 1 / v, ia = 1 / area;
    const REAL tx = x1 * iv, ty = y1 * iv, tz = z1 * iv, bx = cx * ia, by = cy * ia, bz = cz * ia;
    const REAL nx = by * tz - bz * ty, ny = bz * tx - bx * tz, nz = bx * ty - by * tx;
    const REAL torsion = T * ia * ia, curvature = area * iv * iv * iv;
    /* the direction cosines in world axes, and the largest of Shepperd's four rows */
    const REAL Tx = tx * c - ty * s, Ty = tx * s + ty * c;
    const REAL Nx = nx * c - ny * s, Ny = nx * s + ny * c;
    const REAL Bx = bx * c - by * s, By = bx * s + by * c;
    const REAL d0 = 1 + Tx + Ny + bz, d1 = 1 + Tx - Ny - bz, d2 = 1 - Tx + Ny - bz, d3 = 1 - Tx - Ny + bz;
    const REAL e1 = nz - By, e2 = Bx - tz, e3 = Ty - Nx, f1 = nz + By, f2 = Bx + tz, f3 = Ty + Nx;
    const int k01 = d1 > d0, k23 = d3 > d2;
    const REAL m01 = k01 ? d1 : d0, m23 = k23 ? d3 : d2;
    const int high = m23 > m01;
    const REAL big = high ? m23 : m01;
    const REAL q0 = high ? (k23 ? e3 : e2) : (k01 ? e1 : d0);
    const REAL q1 = high ? (k23 ? f2 : f3) : (k01 ? d1 : e1);
    const REAL q2 = high ? (k23 ? f1 : d2) : (k01 ? f3 : e2);
    const REAL q3 = high ? (k23 ? d3 : f1) : (k01 ? f2 : e3);
    const REAL half = (REAL)0.5 / (REAL)sqrt(big), scale = q0 < 0 ? -half : half;
    return (channels){rho * c,          rho * s,          h,
                      x1 * c - y1 * s,  x1 * s + y1 * c,  z1,
                      x2 * c - y2 * s,  x2 * s + y2 * c,  z2,
                      q0 * scale,       q1 * scale,       q2 * scale, q3 * scale,
                      curvature,        torsion,          v * torsion, v * curvature};
}

void evaluate(const path *p, const REAL *restrict t, ptrdiff_t n, REAL *restrict out) {
    const path local = *p;
#pragma omp parallel for simd schedule(static)
    for (ptrdiff_t i = 0; i < n; i++) {
        const channels at = instant(&local, t[i]);
#define WRITE(k) out[k * n + i] = at.c##k;
        EACH(WRITE)
    }
}

void peaks(const path *p, const REAL *restrict t, ptrdiff_t n, REAL *restrict out) {
    const path local = *p;
#define START(k) REAL m##k = -INFINITY;
    EACH(START)
#pragma omp parallel for simd schedule(static) reduction(max : MOST)
    for (ptrdiff_t i = 0; i < n; i++) {
        const channels at = instant(&local, t[i]);
#define RAISE(k) m##k = at.c##k > m##k ? at.c##k : m##k;
        EACH(RAISE)
    }
#define STORE(k) out[k] = m##k;
    EACH(STORE)
}

void fill(ptrdiff_t n, REAL *restrict out) {
#pragma omp parallel for schedule(static)
    for (ptrdiff_t i = 0; i < CHANNELS * n; i++) out[i] = (REAL)i;
}
