"""Points on a lattice in the order of an octree (Morton, 1966), and the octree as bytes."""

import numpy as np
from jaxtyping import Int, UInt8, UInt64

# Of an octree whose lattice has 65,536 steps along each axis: codes of 48 bits, and coordinates that 16 bits hold.
DEEPEST = 16


def morton_codes(steps: Int[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
    """Interleave the bits of coordinates on the lattice, 0 to 65,535: bit 0 of x, y and z, then bit 1, and so on."""
    codes = np.zeros(len(steps), np.uint64)
    for axis in range(3):
        codes |= _spread(steps[:, axis].astype(np.uint64)) << np.uint64(axis)
    return codes


def parting_levels(codes: UInt64[np.ndarray, " n"], depth: int = DEEPEST) -> Int[np.ndarray, " n"]:
    """Find the level of the octree from which on each point is in another cell than the point before it.

    As many points part at a level or above as it has occupied cells. Codes ascend; the first point has 0, one with the
    same code as the point before `depth + 1`.
    """
    differing = codes[1:] ^ codes[:-1]
    # 48 bits are exact in float64, whose exponent is their number.
    bits = np.frexp(differing.astype(np.float64))[1]
    levels = np.where(bits > 0, depth - (bits - 1) // 3, depth + 1)
    return np.concatenate([np.zeros(min(len(codes), 1), levels.dtype), levels])


def octree_bytes(codes: UInt64[np.ndarray, " n"], depth: int) -> UInt8[np.ndarray, " m"]:
    """Encode the octree breadth first: a byte for each node, whose bit i says whether there is a child i.

    Codes, with 3 bits for each level, are of different points and ascend.
    """
    if depth == 0:
        return np.empty(0, np.uint8)
    levels = parting_levels(codes, depth)
    occupancy = [np.empty(0, np.uint8)]
    for level in range(1, depth + 1):
        first = np.flatnonzero(levels <= level)
        children = codes[first] >> np.uint64(3 * (depth - level))
        child = np.uint8(1) << (children & np.uint64(7)).astype(np.uint8)
        occupancy.append(np.bitwise_or.reduceat(child, np.flatnonzero(levels[first] <= level - 1)))
    return np.concatenate(occupancy)


def _spread(values: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """Put two zeros between each of 16 bits and the next."""
    for shift, mask in (
        (16, 0x00FF0000FF0000FF),
        (8, 0xF00F00F00F00F00F),
        (4, 0x30C30C30C30C30C3),
        (2, 0x9249249249249249),
    ):
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values
