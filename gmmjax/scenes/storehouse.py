"""A storehouse that a terrestrial scanner surveys twice, in colour: the pair of `gmmjax demo`."""

import dataclasses
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, UInt8

from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each
from gmmjax.scenes.families.things import between, block, pillar
from gmmjax.scenes.laser_scanner import Beam, TripodScanner
from gmmjax.scenes.ray_casting import UNLABELLED, Solid
from gmmjax.scenes.recording import PoseErrors, Recording
from gmmjax.scenes.rigid_motions import small_motion, turned, upright
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

Color: TypeAlias = tuple[int, int, int]
# A solid, whose label is the number of its change, and its colour.
_Painted: TypeAlias = tuple[Solid, Color]
# Where something stands: x and y, metres, and its rotation about the vertical, degrees.
_Place: TypeAlias = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class StorehouseSettings:
    """Settings of the storehouse's survey.

    Attributes:
        points: about how many each cloud has; those of all stations are fused in voxels to so many.
        rays: of the scanner from each station.
        stations: where the scanner stands in either survey, x and y, metres, give or take 10 cm. What is seen from no
            station of a survey is missing in its cloud.
    """

    points: int = 50_000
    rays: int = 70_000
    stations: Pair[tuple[tuple[float, float], ...]] = Pair(*2 * (((-2.9, -0.7), (0.2, -0.6), (3.2, -0.8)),))


@dataclasses.dataclass(frozen=True, eq=False)
class ColoredScene:
    """Two surveys with the truth, in colour.

    Attributes:
        scene: the surveys and the truth.
        colors: red, green and blue of every point.
    """

    scene: SurveyedScene
    colors: Pair[UInt8[np.ndarray, "n 3"]]


_CONCRETE, _WALL, _WALL_BASE, _MARKING = (142, 144, 146), (214, 210, 200), (120, 150, 160), (226, 186, 60)
_WOOD, _CARDBOARD, _CARTON = (176, 134, 86), (196, 156, 108), (168, 126, 82)
_STEEL, _ORANGE, _BLUE, _GREEN, _RED = (112, 120, 130), (214, 112, 44), (54, 98, 160), (72, 128, 88), (176, 56, 48)
_PLASTIC, _DARK = (232, 232, 226), (62, 64, 70)
# Half the inner length and width, and the height of the walls, metres.
_LENGTH, _WIDTH, _HEIGHT = 5.0, 3.5, 2.8


def storehouse(seed: int, settings: StorehouseSettings = StorehouseSettings()) -> ColoredScene:
    """A storehouse of 10 m by 7 m, open on two sides; between the surveys two things come, two go and two move.

    Args:
        seed: of the arrangement, the noise and the displacement of the after cloud.
        settings: of the survey.
    """
    random = np.random.default_rng(seed)
    painted = _arranged(random)
    poses = settings.stations.map(lambda places: _stations(random, places))
    recordings = each(lambda side, stations: _recorded(side, stations, random, settings), painted, poses)
    # The after cloud is displaced by 8 cm and 0.8 degrees.
    frame = Frame(small_motion(random, 0.08, 0.8))
    colors = each(lambda side, recording: _colors(side, recording, random), painted, recordings)
    solids = painted.map(lambda side: [solid for solid, _ in side])
    return ColoredScene(surveyed_scene(solids, each(_as_changes, painted, recordings), frame), colors)


def _stations(random: np.random.Generator, places: tuple[tuple[float, float], ...]) -> Float[np.ndarray, "v 4 4"]:
    """Poses over places in the aisle, where a surveyor puts the tripod about as the last time."""
    poses = []
    for place in places:
        position = np.array([*place, 1.7]) + random.normal(0, 0.1, 3)
        poses.append(upright(position, float(random.uniform(0, 2 * np.pi))))
    return np.stack(poses)


def _recorded(
    side: Sequence[_Painted],
    stations: Float[np.ndarray, "v 4 4"],
    random: np.random.Generator,
    settings: StorehouseSettings,
) -> Recording:
    """Record one side; the labels are the indices of the solids."""
    solids = [dataclasses.replace(solid, label=index) for index, (solid, _) in enumerate(side)]
    scanner = TripodScanner(Beam(noise=0.003, max_range=25.0), settings.rays, lowest=-65.0, highest=60.0)
    return scanner.recording(solids, stations, random, PoseErrors(0.002, 0.01)).fused_to(settings.points)


def _as_changes(side: Sequence[_Painted], recording: Recording) -> Recording:
    """The recording with the numbers of the changes as labels."""
    numbers = np.array([*(solid.label for solid, _ in side), UNLABELLED])
    return dataclasses.replace(recording, labels=numbers[recording.labels])


def _colors(side: Sequence[_Painted], recording: Recording, random: np.random.Generator) -> UInt8[np.ndarray, "n 3"]:
    """The colours of the solids in the light of a hall: from above, and a little from one side."""
    # The last is that of what a ray mixed of two solids.
    paint = np.array([*(color for _, color in side), _STEEL], float)
    normals = LocalSurface.of(recording.points).normals
    lamp = np.abs(normals @ np.array([0.25, 0.45, 0.86]))
    shade = (0.55 + 0.45 * lamp) * (1 + 0.06 * random.standard_normal(len(normals)))
    return np.clip(paint[recording.labels] * shade[:, None], 0, 255).astype(np.uint8)


def _arranged(random: np.random.Generator) -> Pair[list[_Painted]]:
    """The storehouse at both times."""
    # Of each thing that changes: what it is, and where it stands before and after.
    changes: list[tuple[list[_Painted], _Place | None, _Place | None]] = [
        (_pallet((1.2, 0.8), 0.75, _CARDBOARD), None, (0.4, 1.1, 8.0)),
        (_carton((0.45, 0.35, 0.3), _CARTON), None, (-3.2, 0.3, 25.0)),
        (_drum(_BLUE), (3.9, 1.2, 0.0), None),
        (_crates((0.6, 0.5, 0.45)), (-0.9, -2.4, 15.0), None),
        (_trolley(), (1.7, -2.2, 0.0), (2.9, -2.5, 35.0)),
        (_carton((0.75, 0.55, 0.6), _PLASTIC), (-4.2, 1.2, 0.0), (-2.6, 1.3, 20.0)),
    ]
    staying: list[tuple[list[_Painted], _Place]] = [
        (_pallet((1.2, 0.8), 1.1, _CARTON), (-1.2, 1.3, -4.0)),
        (_pallet((1.2, 0.8), 0.0, _WOOD), (2.2, 1.2, 90.0)),
        (_pallet((1.2, 1.0), 0.5, _GREEN), (-3.6, -1.6, 80.0)),
        (_drum(_BLUE), (4.3, 0.5, 0.0)),
        (_drum(_RED), (4.4, -0.3, 0.0)),
        (_machine(), (0.3, -2.6, 180.0)),
        (_carton((0.5, 0.4, 0.4), _CARDBOARD), (4.2, -1.7, 30.0)),
    ]
    before, after = _building(), _building()
    for thing, place in staying:
        standing = _placed(thing, place, random)
        before += standing
        after += standing
    for number, (thing, here, there) in enumerate(changes):
        numbered = [(dataclasses.replace(solid, label=number), color) for solid, color in thing]
        before += _placed(numbered, here, random) if here else []
        after += _placed(numbered, there, random) if there else []
    return Pair(before, after)


def _placed(thing: Sequence[_Painted], place: _Place, random: np.random.Generator) -> list[_Painted]:
    """The thing within some centimetres of its place."""
    x, y = random.normal(place[:2], 0.05)
    return _at(thing, turned(float(np.radians(place[2])), (x, y, 0.0)))


def _at(thing: Sequence[_Painted], pose: np.ndarray) -> list[_Painted]:
    return [(solid.moved(pose), color) for solid, color in thing]


def _building() -> list[_Painted]:
    """Floor with markings, two walls with a painted base, pillars, and racks along the longer wall."""
    x, y, z = _LENGTH, _WIDTH, _HEIGHT
    parts = [
        (between((-x, -y, -0.2), (x, y, 0.0)), _CONCRETE),
        (between((-x, y, 0), (x, y + 0.2, z)), _WALL),
        (between((-x - 0.2, -y, 0), (-x, y, z)), _WALL),
        # Paint is 2 mm thick here: less than the noise of the scanner.
        (between((-x, y - 0.002, 0), (x, y, 1.0)), _WALL_BASE),
        (between((-x, -y, 0), (-x + 0.002, y, 1.0)), _WALL_BASE),
        (between((-x + 0.4, 0.02, 0), (x, 0.14, 0.002)), _MARKING),
        (between((-x + 0.4, -1.74, 0), (x, -1.62, 0.002)), _MARKING),
    ]
    parts += [(block((0.3, 0.3, z), (along, -y + 0.25, 0)), _STEEL) for along in (-4.6, 4.6)]
    parts += [(between((-x, y - 0.35, 2.2), (x, y - 0.2, 2.35)), _PLASTIC)]
    for middle in (-3.1, 2.6):
        parts += _at(_rack(), turned(0.0, (middle, 2.95, 0)))
    return parts


def _rack() -> list[_Painted]:
    """A rack of three levels with cartons."""
    wide, deep, levels = 2.6, 0.8, (0.15, 0.85, 1.55)
    parts = [(block((wide, deep, 0.05), (0, 0, level)), _ORANGE) for level in levels]
    parts += [(block((0.08, 0.08, 2.0), (sx * wide / 2, sy * deep / 2, 0)), _BLUE) for sx in (-1, 1) for sy in (-1, 1)]
    sizes = [(0.6, 0.55, 0.45), (0.45, 0.6, 0.3), (0.7, 0.5, 0.5), (0.35, 0.4, 0.35)]
    tints = [_CARDBOARD, _CARTON, _GREEN, _PLASTIC, _CARDBOARD]
    for row, level in enumerate(levels):
        for column, along in enumerate((-0.9, -0.2, 0.55)):
            index = 3 * row + column
            size = sizes[index % len(sizes)]
            parts.append((block(size, (along, -0.02 * index, level + 0.05)), tints[index % len(tints)]))
    return parts


def _pallet(size: tuple[float, float], load: float, color: Color) -> list[_Painted]:
    """A pallet with a load of this height, metres, or empty."""
    wide, deep = size
    slats = [(block((wide, deep / 9, 0.14), (0, (row - 2) * deep / 4.5, 0)), _WOOD) for row in range(5)]
    return [*slats, (block((wide * 0.95, deep * 0.95, load), (0, 0, 0.14)), color)] if load else slats


def _carton(size: tuple[float, float, float], color: Color) -> list[_Painted]:
    return [(block(size), color)]


def _crates(size: tuple[float, float, float]) -> list[_Painted]:
    """A crate on a crate."""
    upper = block(np.array(size) * 0.8, (0.04, 0.02, size[2]))
    return [(block(size), _RED), (upper, _WOOD)]


def _drum(color: Color) -> list[_Painted]:
    return [(pillar(0.58, 0.88), color), (pillar(0.08, 0.04, (0.15, 0.0, 0.88)), _DARK)]


def _trolley() -> list[_Painted]:
    """A tool cabinet on wheels, with a box on it."""
    wheels = [block((0.08, 0.08, 0.12), (x * 0.36, y * 0.2, 0)) for x in (-1, 1) for y in (-1, 1)]
    return [
        (block((0.9, 0.55, 0.68), (0, 0, 0.12)), _BLUE),
        *((wheel, _DARK) for wheel in wheels),
        (block((0.45, 0.35, 0.25), (0.15, 0.05, 0.8)), _PLASTIC),
    ]


def _machine() -> list[_Painted]:
    """A compressor: a tank on feet with a motor on it."""
    body = block((1.1, 0.6, 0.7), (0, 0, 0.1))
    motor = pillar(0.4, 0.45, (-0.2, 0, 0.8))
    panel = block((0.35, 0.1, 0.4), (0.3, -0.32, 0.55))
    foot = block((1.2, 0.7, 0.1))
    return [(body, _GREEN), (motor, _STEEL), (panel, _DARK), (foot, _DARK)]
