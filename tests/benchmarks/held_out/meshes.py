"""Triangle meshes of plain things, [t, 3, 3] in metres: standing on z = 0 unless their name says otherwise."""

from collections.abc import Sequence

import numpy as np

Place = Sequence[float] | np.ndarray


def box(width: float, depth: float, height: float, at: Place = (0, 0, 0)) -> np.ndarray:
    """A block that stands on a place."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]) * (width, depth, height)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([corners[[a, *pair]] for a, b, c, d in faces for pair in ((b, c), (c, d))])
    return triangles + np.asarray(at, float)


def revolved(profile: Sequence[tuple[float, float]], segments: int = 20) -> np.ndarray:
    """A profile of radius and height, turned about the z axis."""
    radius, height = np.array(profile, float).T
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grid = np.concatenate(
        [radius[:, None, None] * ring, np.broadcast_to(height[:, None, None], (len(height), segments + 1, 1))], axis=2
    )
    return lattice(grid)


def lattice(grid: np.ndarray) -> np.ndarray:
    """The surface through a lattice of points [r, c, 3], two triangles a cell; those without area left out."""
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    triangles = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return triangles[area > 1e-12]


def ellipsoid(width: float, depth: float, height: float, rings: int = 8, segments: int = 14) -> np.ndarray:
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    profile = [(float(np.cos(a)) / 2, float(np.sin(a) + 1) / 2) for a in angle]
    return revolved(profile, segments) * (width, depth, height)


def cylinder(radius: float, height: float, segments: int = 18) -> np.ndarray:
    return revolved([(0, 0), (radius, 0), (radius, height), (0, height)], segments)


def tube(path: np.ndarray, radius: float, segments: int = 8) -> np.ndarray:
    """A round bar along points [n, 3], none of whose pieces is along (1, 2, 3)."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, np.array([1.0, 2, 3]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(along, across)
    angle = np.linspace(0, 2 * np.pi, segments + 1)[:, None]
    ring = radius * (np.cos(angle) * across[:, None] + np.sin(angle) * other[:, None])
    return lattice(path[:, None] + ring)


def open_box(width: float, depth: float, height: float, wall: float = 0.015) -> np.ndarray:
    """Four walls and a bottom."""
    return joined(
        box(width, depth, wall),
        *(box(wall, depth, height, (s * (width - wall) / 2, 0, 0)) for s in (-1, 1)),
        *(box(width, wall, height, (0, s * (depth - wall) / 2, 0)) for s in (-1, 1)),
    )


def table(width: float, depth: float, height: float, leg: float = 0.05) -> np.ndarray:
    x, y = width / 2 - leg, depth / 2 - leg
    legs = [box(leg, leg, height, (a * x, b * y, 0)) for a in (-1, 1) for b in (-1, 1)]
    return joined(box(width, depth, 0.03, (0, 0, height - 0.03)), *legs)


def chair(seat: float = 0.45, height: float = 0.45, back: float = 0.45) -> np.ndarray:
    """Four legs, a seat, and a back on the side of negative y."""
    rest = box(seat, 0.04, back, (0, 0.02 - seat / 2, height))
    return joined(table(seat, seat, height, 0.04), rest)


def shelf(width: float, depth: float, height: float, boards: int) -> np.ndarray:
    """Two sides, a back on the side of positive y, and boards."""
    sides = [box(0.03, depth, height, (s * (width - 0.03) / 2, 0, 0)) for s in (-1, 1)]
    levels = np.linspace(0.05, height - 0.03, boards)
    planks = [box(width, depth, 0.025, (0, 0, float(level))) for level in levels]
    return joined(*sides, box(width, 0.02, height, (0, depth / 2, 0)), *planks)


def cup(radius: float, height: float) -> np.ndarray:
    """With a handle on the side of positive x."""
    inside = [(radius - 0.004, height), (0.75 * radius, 0.006), (0, 0.006)]
    wall = [(0, 0.004), (0.8 * radius, 0), (radius, height), *inside]
    angle = np.linspace(-np.pi / 2, np.pi / 2, 7)
    bend = np.stack([0.6 * radius * np.cos(angle), 0 * angle, 0.28 * height * np.sin(angle)], axis=1)
    return joined(revolved(wall), tube(bend + np.array([0.95 * radius, 0, 0.5 * height]), 0.005, 6))


def bowl(radius: float, height: float) -> np.ndarray:
    part = np.linspace(0.35, 1, 6)
    outside = [(radius * float(np.sqrt(p)), height * float(p * p)) for p in part]
    inside = [(max(r - 0.006, 0), h + 0.003) for r, h in reversed(outside)]
    return revolved([(0, 0), *outside, *inside, (0, inside[-1][1])])


def plate(radius: float) -> np.ndarray:
    return revolved([(0, 0), (0.6 * radius, 0), (radius, 0.018), (0.6 * radius, 0.006), (0, 0.006)])


def bottle(radius: float, height: float) -> np.ndarray:
    neck = 0.35 * radius
    return revolved([(0, 0), (radius, 0), (radius, 0.6 * height), (neck, 0.78 * height), (neck, height), (0, height)])


def bin_of(radius: float, height: float) -> np.ndarray:
    """A round one, open at the top."""
    inside = [(0.97 * radius, height), (0.77 * radius, 0.02), (0, 0.02)]
    return revolved([(0, 0), (0.8 * radius, 0), (radius, height), *inside])


def suitcase(width: float, depth: float, height: float) -> np.ndarray:
    bar = np.array([(-0.3 * width, 0, 0), (-0.3 * width, 0, 0.12), (0.3 * width, 0, 0.12), (0.3 * width, 0, 0)])
    return joined(box(width, depth, height), shifted(tube(bar, 0.012, 6), (0, 0, height)))


def cone(radius: float, height: float) -> np.ndarray:
    base = box(2.2 * radius, 2.2 * radius, 0.03)
    return joined(base, shifted(revolved([(radius, 0), (0.15 * radius, height), (0, height)]), (0, 0, 0.03)))


def plant(radius: float, height: float) -> np.ndarray:
    pot = bin_of(0.5 * radius, 0.3 * height)
    stem = cylinder(0.02, 0.6 * height, 8)
    crown = shifted(ellipsoid(2 * radius, 2 * radius, 0.6 * height, 6, 10), (0, 0, 0.4 * height))
    return joined(pot, stem, crown)


def joined(*parts: np.ndarray) -> np.ndarray:
    return np.concatenate(parts)


def shifted(triangles: np.ndarray, by: Place) -> np.ndarray:
    return triangles + np.asarray(by, float)


def turned(triangles: np.ndarray, degrees: float) -> np.ndarray:
    """About the z axis."""
    angle = np.radians(degrees)
    c, s = np.cos(angle), np.sin(angle)
    return triangles @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def placed(triangles: np.ndarray, position: Place, degrees: float = 0.0) -> np.ndarray:
    return shifted(turned(triangles, degrees), position)


def footprint(triangles: np.ndarray) -> float:
    """The radius of what a thing takes up about the z axis."""
    return float(np.hypot(triangles[..., 0], triangles[..., 1]).max())
