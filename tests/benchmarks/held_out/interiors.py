"""What rooms are made of, and where things stand in them."""

from collections.abc import Sequence

import numpy as np

from tests.benchmarks.held_out.casting import Body, Thing
from tests.benchmarks.held_out.meshes import (
    bin_of,
    box,
    chair,
    cone,
    cylinder,
    ellipsoid,
    footprint,
    joined,
    open_box,
    placed,
    plant,
    shelf,
    shifted,
    suitcase,
    table,
)
from tests.benchmarks.held_out.surveys import Stage


class Ground:
    """A rectangle on which things stand side by side."""

    def __init__(self, centre: Sequence[float], width: float, depth: float):
        self.centre, self.half = np.asarray(centre, float), np.array([width, depth]) / 2
        self._taken: list[tuple[np.ndarray, float]] = []

    def take(self, radius: float, random: np.random.Generator) -> np.ndarray:
        """A free place [3] for something of this radius: of 80 the one farthest from all others."""
        reach = np.maximum(self.half - radius, 0.0)
        tries = self.centre[:2] + random.uniform(-reach, reach, (80, 2))
        room = [min((float(np.hypot(*(at - own))) - size for own, size in self._taken), default=9.0) for at in tries]
        free = np.flatnonzero(np.array(room) > radius + 0.03)
        best = int(free[0]) if len(free) else int(np.argmax(room))
        return self.occupy(tries[best], radius)

    def occupy(self, at: Sequence[float] | np.ndarray, radius: float) -> np.ndarray:
        """Nothing else is put there."""
        self._taken.append((np.asarray(at, float)[:2], radius))
        return np.array([*np.asarray(at, float)[:2], self.centre[2]])


def portable(random: np.random.Generator, size: float = 1.0) -> np.ndarray:
    """Something that is carried about, some 0.2 to 0.5 m times `size`."""
    u = random.uniform
    kinds = (
        lambda: box(u(0.2, 0.45), u(0.2, 0.4), u(0.18, 0.4)),
        lambda: suitcase(u(0.3, 0.45), u(0.15, 0.22), u(0.35, 0.5)),
        lambda: ellipsoid(*[u(0.22, 0.35)] * 3),
        lambda: bin_of(u(0.12, 0.18), u(0.25, 0.4)),
        lambda: ellipsoid(u(0.35, 0.5), u(0.2, 0.3), u(0.25, 0.4)),
        lambda: plant(u(0.15, 0.2), u(0.4, 0.6)),
        lambda: open_box(u(0.3, 0.45), u(0.25, 0.4), u(0.15, 0.3)),
        lambda: cylinder(u(0.1, 0.17), u(0.25, 0.45)),
        lambda: cone(u(0.12, 0.16), u(0.35, 0.5)),
    )
    return size * kinds[int(random.integers(len(kinds)))]()


def shell(width: float, depth: float, height: float, *, ceiling: bool, doorway: float = 0.0) -> list[np.ndarray]:
    """Floor, walls and ceiling of a room about the origin; with a doorway of this width in the wall at +y."""
    x, y, wall = width / 2, depth / 2, 0.1
    parts = [box(width + 0.2, depth + 0.2, wall, (0, 0, -wall))]
    parts += [box(wall, depth, height, (s * (x + wall / 2), 0, 0)) for s in (-1, 1)]
    parts.append(box(width, wall, height, (0, -y - wall / 2, 0)))
    if doorway:
        side = (width - doorway) / 2
        at = [-(doorway + side) / 2, (doorway + side) / 2]
        parts += [box(side, wall, height, (each, y + wall / 2, 0)) for each in at]
        parts.append(box(doorway, wall, height - 2.0, (0, y + wall / 2, 2.0)))
    else:
        parts.append(box(width, wall, height, (0, y + wall / 2, 0)))
    if ceiling:
        parts.append(box(width + 0.2, depth + 0.2, wall, (0, 0, height)))
    return parts


def furnish(stage: Stage, floor: Ground, random: np.random.Generator, *, pieces: int) -> list[Ground]:
    """Puts furniture on a floor and along its walls; gives the table tops."""
    u, tops = random.uniform, []
    x, y = floor.half
    for _ in range(pieces):
        kind = int(random.integers(5))
        if kind == 0:
            width, depth, height = u(0.8, 1.3), u(0.6, 0.8), u(0.6, 0.76)
            at = floor.take(0.5 * float(np.hypot(width, depth)), random)
            stage.stays(placed(table(width, depth, height), at))
            tops.append(Ground((at[0], at[1], height), width, depth))
        elif kind == 1:
            width, depth = u(0.6, 1.0), u(0.25, 0.35)
            at = floor.occupy((max(x - 0.6, 0) * u(-1, 1), y - depth / 2), width / 2)
            stage.stays(placed(shelf(width, depth, u(0.9, 1.8), int(random.integers(3, 6))), at))
        elif kind == 2:
            at = floor.take(0.33, random)
            stage.stays(placed(chair(), at, u(0, 360)))
        elif kind == 3:
            width, depth = u(1.2, 1.7), u(0.7, 0.8)
            at = floor.occupy((x - depth / 2, max(y - 0.9, 0) * u(-1, 1)), width / 2)
            seat = joined(box(depth, width, 0.42), box(0.2, width, 0.75, (depth / 2 - 0.1, 0, 0)))
            cushion = shifted(ellipsoid(0.2, 0.45, 0.4), (0.05, u(-0.3, 0.3), 0.42))
            stage.stays(shifted(seat, at), shifted(cushion, at))
        else:
            at = floor.take(0.25, random)
            stage.stays(placed(portable(random), at, u(0, 360)))
    picture = box(u(0.4, 0.9), 0.03, u(0.3, 0.6))
    stage.stays(shifted(picture, (u(-x / 2, x / 2), -y + 0.02, u(1.1, 1.4))))
    radiator = box(0.1, u(0.6, 1.0), 0.5)
    stage.stays(shifted(radiator, (-x + 0.08, u(-y / 2, y / 2), 0.12)))
    return tops


def rearrange(stage: Stage, grounds: Sequence[Ground], random: np.random.Generator, *, size: float = 1.0) -> None:
    """One to four portable things come, go and move; in an unchanged scene they stay."""

    def somewhere(thing: np.ndarray) -> np.ndarray:
        ground = grounds[int(random.integers(len(grounds)))]
        if min(ground.half) < footprint(thing):
            ground = grounds[0]
        return placed(thing, ground.take(footprint(thing), random), random.uniform(0, 360))

    appear, vanish, move = (int(number) for number in random.integers(0, (3, 3, 2)))
    for kind in ("come",) * max(appear, 1 - vanish - move) + ("go",) * vanish + ("move",) * move:
        thing = portable(random, size)
        if kind == "come":
            stage.comes(somewhere(thing))
        elif kind == "go":
            stage.goes(somewhere(thing))
        else:
            stage.moves(somewhere(thing), somewhere(thing))


def outside(bodies: Sequence[Body], at: np.ndarray, margin: float = 0.1) -> bool:
    """Whether a place is in the bounding box of no mesh."""
    corners = [body.triangles.reshape(-1, 3) for body in bodies if isinstance(body, Thing)]
    return not any((at > own.min(axis=0) - margin).all() and (at < own.max(axis=0) + margin).all() for own in corners)
