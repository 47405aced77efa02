"""Apartments that a terrestrial scanner surveys from one or two places, not the same in the two surveys."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families import things
from gmmjax.scenes.families.interior import Interior, furnished_room
from gmmjax.scenes.families.scanners import TripodSurveys
from gmmjax.scenes.families.staging import Turnover, staged
from gmmjax.scenes.families.things import between, chance
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.surveyed_scene import SurveyedScene

_THINGS = things.one_of(
    *(things.bag, things.bag, things.ball, things.bin_, things.box, things.box, things.chair, things.chair),
    *(things.clutter, things.drum, things.lamp, things.plant, things.screen, things.stack, things.suitcase),
    *(things.tripod, things.vessel),
)
_SURVEYS = TripodSurveys((100_000, 400_000), (25_000, 100_000), 10_000, hidden_by=0.04, misregistration=(0.05, 0.4))


def apartments(random: np.random.Generator) -> SurveyedScene:
    """Two to four rooms joined by doors, scanned from one or two places each time: large shadows, partial overlap."""
    columns, rows = ((2, 1), (3, 1), (2, 2))[int(random.integers(3))]
    cell = random.uniform([3.0, 3.0, 2.4], [5.0, 4.5, 3.0])
    cells = [(column, row) for column in range(columns) for row in range(rows)]
    middles = (cell[:2] * [column - (columns - 1) / 2, row - (rows - 1) / 2] for column, row in cells)
    interiors = [furnished_room(random, cell - [0.3, 0.3, 0.0], middle=middle, walls=False) for middle in middles]
    scanned, places = _stations(random, interiors)
    fixed = [*_walls(random, cell, columns, rows), *(solid for room in interiors for solid in room.solids)]
    # What changes in a room that nobody scanned teaches nothing.
    supports = [*(room.floor for room in scanned), *(top for room in scanned for top in room.tops)]
    solids = staged(random, fixed, supports, _THINGS, int(random.integers(3, 9)), Turnover(appeared=4, disappeared=4))
    return _SURVEYS.scene_from(random, solids, places)


def _stations(
    random: np.random.Generator, rooms: list[Interior]
) -> tuple[list[Interior], Pair[list[Float[np.ndarray, "2"]]]]:
    """The rooms that are scanned, and where: both surveys scan one of them, and either now and then one of its own."""
    common = int(random.integers(len(rooms)))
    chosen = Pair(*([common, *random.integers(len(rooms), size=int(random.integers(0, 2)))] for _ in range(2)))
    places = chosen.map(lambda side: [_free_place(random, rooms[int(room)]) for room in side])
    return [rooms[int(room)] for side in chosen for room in side], places


def _free_place(random: np.random.Generator, room: Interior) -> np.ndarray:
    """Reserve a place on a floor where a tripod fits."""
    reach = np.array(room.floor.size) / 2 - 0.4
    spot = np.zeros(2)
    for _ in range(50):
        spot = random.uniform(-reach, reach)
        if room.floor.free(spot, 0.3):
            break
    room.floor.taken.append((spot, 0.45))
    return np.asarray(room.floor.middle[:2, 3] + spot)


def _walls(random: np.random.Generator, cell: np.ndarray, columns: int, rows: int) -> list[Solid]:
    """Floor, mostly a ceiling, outer walls, and walls between the cells, each with a door."""
    x, y, z = cell * [columns / 2, rows / 2, 1]
    solids = [between((-x - 0.1, -y - 0.1, -0.1), (x + 0.1, y + 0.1, 0.0))]
    if chance(random, 0.8):
        solids.append(between((-x, -y, z), (x, y, z + 0.1)))
    solids += [between((s * x - 0.1, -y - 0.1, 0), (s * x + 0.1, y + 0.1, z)) for s in (-1, 1)]
    solids += [between((-x - 0.1, s * y - 0.1, 0), (x + 0.1, s * y + 0.1, z)) for s in (-1, 1)]
    inner = [(column, row, 1) for column in range(1, columns) for row in range(rows)]
    inner += [(column, row, 0) for row in range(1, rows) for column in range(columns)]
    for column, row, axis in inner:
        corner = np.array([column * cell[0] - x, row * cell[1] - y, 0.0])
        solids += _wall_with_door(random, corner, axis, float(cell[axis]), float(z))
    return solids


def _wall_with_door(
    random: np.random.Generator, corner: np.ndarray, axis: int, length: float, high: float
) -> list[Solid]:
    """A wall from a corner along an axis, with an opening of a door's width or of half the wall's, and its lintel."""
    wide = random.choice([random.uniform(0.75, 1.0), random.uniform(1.0, 0.5 * length)])
    first = random.uniform(0.2, length - wide - 0.2)
    lintel = min(random.uniform(1.9, 2.2), high - 0.05)
    along, across = np.eye(3)[[axis, 1 - axis]] * [[1.0], [0.06]]
    pieces = []
    for start, end, low in ((0.0, first, 0.0), (first, first + wide, lintel), (first + wide, length, 0.0)):
        lowest, highest = corner + start * along - across, corner + end * along + across
        pieces.append(between([*lowest[:2], low], [*highest[:2], high]))
    return pieces
