"""The floor of an EM sweep: one fused loop over blocks of points, float32, compiled by numba.

What a sweep cannot do without: for each point and component ten products for the log density, one exponential, and ten
products for the sums. The blocks stay in the first-level cache, and every inner loop runs over points, so that the
compiler can use the vector unit; the exponential is a polynomial for the same reason.
"""

import numba
import numpy as np

BLOCK = 256
FEATURES = 10


@numba.njit(fastmath=True, error_model="numpy", boundscheck=False)
def log_joint(f, p, row, highest):
    """One component's log density at the points of a block, and the highest so far."""
    p0, p1, p2, p3, p4, p5, p6, p7, p8, p9 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9]
    for i in range(BLOCK):
        value = p0 * f[i] + p1 * f[BLOCK + i] + p2 * f[2 * BLOCK + i] + p3 * f[3 * BLOCK + i] + p4 * f[4 * BLOCK + i]
        value += p5 * f[5 * BLOCK + i] + p6 * f[6 * BLOCK + i] + p7 * f[7 * BLOCK + i]
        value += p8 * f[8 * BLOCK + i] + p9 * f[9 * BLOCK + i]
        row[i] = value
        highest[i] = max(highest[i], value)


@numba.njit(fastmath=True, error_model="numpy", boundscheck=False)
def exponential(row, highest, density, bits, powers):
    """exp(row - highest) in place, added to the density: 2^whole from its bits, times the series of the rest."""
    for i in range(BLOCK):
        x = max((row[i] - highest[i]) * np.float32(1.4426950), np.float32(-126))
        whole = np.int32(x)
        r = (x - np.float32(whole)) * np.float32(0.6931472)
        series = np.float32(1 / 120) + r * np.float32(1 / 720)
        series = np.float32(1 / 6) + r * (np.float32(1 / 24) + r * series)
        row[i] = np.float32(1) + r * (np.float32(1) + r * (np.float32(0.5) + r * series))
        bits[i] = (whole + np.int32(127)) << np.int32(23)
    for i in range(BLOCK):
        row[i] *= powers[i]
        density[i] += row[i]


@numba.njit(fastmath=True, error_model="numpy", boundscheck=False)
def add_sums(f, row, share, sums):
    """Adds one component's responsibility-weighted sums of the features."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = s9 = np.float32(0)
    for i in range(BLOCK):
        r = row[i] * share[i]
        s0 += r * f[i]
        s1 += r * f[BLOCK + i]
        s2 += r * f[2 * BLOCK + i]
        s3 += r * f[3 * BLOCK + i]
        s4 += r * f[4 * BLOCK + i]
        s5 += r * f[5 * BLOCK + i]
        s6 += r * f[6 * BLOCK + i]
        s7 += r * f[7 * BLOCK + i]
        s8 += r * f[8 * BLOCK + i]
        s9 += r * f[9 * BLOCK + i]
    for j, s in enumerate((s0, s1, s2, s3, s4, s5, s6, s7, s8, s9)):
        sums[j] += s


@numba.njit(fastmath=True, error_model="numpy", boundscheck=False)
def log_of_product(density):
    """The sum of the logarithms, one logarithm for sixteen densities, which lie between 1 and K."""
    products = np.ones(BLOCK // 16, np.float32)
    for part in range(16):
        for i in range(BLOCK // 16):
            products[i] *= density[part * (BLOCK // 16) + i]
    total = np.float32(0)
    for i in range(BLOCK // 16):
        total += np.log(products[i])
    return total


@numba.njit(fastmath=True, error_model="numpy", boundscheck=False)
def sweep(blocks, parameters):
    """Responsibility-weighted sums [k, 10] of the features [blocks, 10 * BLOCK], and the log likelihood."""
    count = len(parameters)
    sums = np.zeros((count, FEATURES), np.float32)
    joint = np.empty((count, BLOCK), np.float32)
    bits = np.empty(BLOCK, np.int32)
    highest, density = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    likelihood = np.float32(0)
    for block in range(len(blocks)):
        features = blocks[block]  # Iterating over the array itself would hide from numba that a row is contiguous.
        highest[:] = np.float32(-1e30)
        density[:] = np.float32(0)
        for k in range(count):
            log_joint(features, parameters[k], joint[k], highest)
        for k in range(count):
            exponential(joint[k], highest, density, bits, bits.view(np.float32))
        likelihood += highest.sum() + log_of_product(density)
        for i in range(BLOCK):
            density[i] = np.float32(1) / density[i]
        for k in range(count):
            add_sums(features, joint[k], density, sums[k])
    return sums, likelihood


def problem(points, components):
    """The features of the points, a whole number of blocks, and parameters of Gaussians at some of the points."""
    points = points[: len(points) // BLOCK * BLOCK]
    x, y, z = points.T
    features = np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])
    means = points[np.random.default_rng(0).choice(len(points), components, replace=False)]
    precision = 10 / points.var(axis=0).mean()
    parameters = np.zeros((components, FEATURES))
    parameters[:, 0] = -precision / 2 * (means**2).sum(axis=1)
    parameters[:, 1:4] = precision * means
    parameters[:, 4:7] = -precision / 2
    blocks = features.reshape(FEATURES, -1, BLOCK).transpose(1, 0, 2).reshape(-1, FEATURES * BLOCK)
    return blocks.astype(np.float32), parameters.astype(np.float32)


def sweeps(points, components, number):
    """So many sweeps; returns their number. A sweep's result does not feed the next: the time is the same."""
    blocks, parameters = problem(points, components)
    for _ in range(number):
        sweep(blocks, parameters)
    return number
