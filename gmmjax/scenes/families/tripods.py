"""Surveys by a terrestrial scanner: where it stands, how it measures, and the scene that it makes of solids."""

import dataclasses

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families.density import drawn_density
from gmmjax.scenes.laser_scanner import Beam, TripodScanner
from gmmjax.scenes.pose_errors import PoseErrors
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import upright
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


@dataclasses.dataclass(frozen=True)
class TripodSurveys:
    """How two surveys from tripods are drawn.

    Attributes:
        rays: between how many a survey has, from all of its stations together. The more there are, the more of them end
            in the air at depth edges; fused in voxels, each such point weighs as much as a surface's.
        most: between how many points the denser cloud has, where it has so many.
        least: points that the other one keeps.
        hidden_by: a place is hidden when something on its ray is nearer by more than this, metres.
        highest: between which elevations the highest rays are, degrees.
        fused: share of the clouds that are fused in voxels; the others keep points drawn at random.
        shift: largest shift of the misregistration, metres.
        degrees: largest angle of the misregistration.
    """

    rays: tuple[int, int]
    most: tuple[int, int]
    least: int
    hidden_by: float
    highest: tuple[float, float] = (60.0, 90.0)
    fused: float = 0.7
    shift: float = 0.1
    degrees: float = 0.4


def scene_from_tripods(
    random: np.random.Generator,
    solids: Pair[list[Solid]],
    places: Pair[list[Float[np.ndarray, "2"]]],
    surveys: TripodSurveys,
) -> SurveyedScene:
    """The scene that two surveys from tripods make of solids.

    Args:
        random: of everything.
        solids: at the time of either survey.
        places: of the tripods on the floor, metres.
        surveys: how they are drawn.
    """
    poses = stations(random, places)
    scanners = drawn_scanners(random, surveys.rays, surveys.highest)
    recordings = scanned(random, solids, poses, scanners)
    reduced = drawn_density(random, recordings, most=surveys.most, least=surveys.least, fused=surveys.fused)
    frame = Frame.drawn(random, shift=surveys.shift, degrees=surveys.degrees)
    return surveyed_scene(solids, reduced, frame, hidden_by=surveys.hidden_by)


def drawn_scanners(
    random: np.random.Generator, rays: tuple[int, int], highest: tuple[float, float] = (60.0, 90.0)
) -> Pair[TripodScanner]:
    """The scanners of two surveys: one make, or two.

    Args:
        random: of everything.
        rays: between how many a survey has, from all of its stations together.
        highest: between which elevations the highest rays are, degrees.
    """
    full = random.random() < 0.75

    def one() -> TripodScanner:
        beam = Beam(
            noise=float(np.exp(random.uniform(np.log(0.0005), np.log(0.012)))),
            growth=random.uniform(0.0, 0.0004),
            least_range=random.uniform(0.3, 0.8),
            max_range=random.uniform(20, 80),
            mixed=random.uniform(0.0, 0.5),
            lost=random.uniform(0.0, 0.05),
        )
        horizontal = 360.0 if full else random.uniform(200, 300)
        count = int(np.exp(random.uniform(*np.log(rays))))
        return TripodScanner(beam, count, horizontal, random.uniform(-65, -40), random.uniform(*highest))

    first = one()
    return Pair(first, one() if random.random() < 0.4 else first)


def stations(
    random: np.random.Generator, places: Pair[list[Float[np.ndarray, "2"]]]
) -> Pair[Float[np.ndarray, "v 4 4"]]:
    """Level poses over places on the floor: all look the same way within half a right angle, for sectors to overlap."""
    height, heading = random.uniform(1.2, 2.0), random.uniform(0, 2 * np.pi)
    return places.map(
        lambda side: np.stack(
            [
                upright(np.array([*place, height + random.normal(0, 0.05)]), heading + random.uniform(-0.8, 0.8))
                for place in side
            ]
        )
    )


def scanned(
    random: np.random.Generator,
    solids: Pair[list[Solid]],
    poses: Pair[Float[np.ndarray, "v 4 4"]],
    scanners: Pair[TripodScanner],
) -> Pair[Recording]:
    """The surveys; each station is registered to the others with a small error, its rays are its share of all."""
    return each(
        lambda own, there, scanner: dataclasses.replace(scanner, rays=scanner.rays // len(there)).recording(
            own, there, random, PoseErrors(random.uniform(0.0, 0.006), random.uniform(0.0, 0.04))
        ),
        solids,
        poses,
        scanners,
    )
