"""Rooms of 3 to 6 m about the origin, and how depth cameras and scanners on tripods survey them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families.arrangements import Arrangement, box, chance
from gmmjax.scenes.families.depth_frames import drawn_camera, poses_about, put_up_again, surveyed_by
from gmmjax.scenes.laser_scanner import Beam, TripodScanner
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene


def room(random: np.random.Generator, size: Float[np.ndarray, "3"], without: str = "") -> list[Solid]:
    """Floor and walls, of one in two with a ceiling.

    Args:
        random: of the ceiling.
        size: inner lengths along x and y, and the height, metres.
        without: "back" leaves out the wall at the largest y.
    """
    wide, deep, tall = size
    solids = [box((0.0, 0.0, -0.05), (wide + 8.0, deep + 8.0, 0.1))]
    solids += [box((side * (wide / 2 + 0.05), 0.0, tall / 2), (0.1, deep + 0.2, tall)) for side in (-1, 1)]
    solids.append(box((0.0, -deep / 2 - 0.05, tall / 2), (wide, 0.1, tall)))
    if without != "back":
        solids.append(box((0.0, deep / 2 + 0.05, tall / 2), (wide, 0.1, tall)))
    if chance(random, 0.5):
        solids.append(box((0.0, 0.0, tall + 0.05), (wide, deep, 0.1)))
    return solids


def surveyed_room(
    random: np.random.Generator, arrangement: Arrangement, size: Float[np.ndarray, "3"], aim: Float[np.ndarray, "3"]
) -> SurveyedScene:
    """The room as one to three frames of a depth camera see it, or a scanner on a tripod from one or two stations.

    Args:
        random: of the sensor and where it stands.
        arrangement: what stands in the room.
        size: inner lengths along x and y, and the height, metres.
        aim: what a depth camera looks at.
    """
    survey = _frames if chance(random, 0.6) else _stations
    recordings, frame, hidden_by = survey(random, arrangement, size, aim)
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=hidden_by)


def _frames(
    random: np.random.Generator, arrangement: Arrangement, size: np.ndarray, aim: np.ndarray
) -> tuple[Pair[Recording], Frame, float]:
    views = int(random.integers(1, 4))
    camera = drawn_camera(random, random.uniform(12_000, 36_000) / views, random.uniform(3.5, 6.0), edge=0.08)
    # Towards the middle of the room, so that the cameras stand in it.
    inward = np.array([0.0, -0.2 * size[1]]) - aim[:2]
    azimuth = float(np.arctan2(inward[1], inward[0])) + random.uniform(-0.4, 0.4)
    apart = random.uniform(0.15, 0.4) * (np.arange(views) - (views - 1) / 2)
    distance = random.uniform(1.3, max(1.5, min(3.2, 0.7 * size[1])))
    poses = poses_about(random, aim, azimuth, distance, random.uniform(0.1, 0.6), list(apart))
    margin = np.array([*(size[:2] / 2 - 0.2), size[2] - 0.2])
    for pose in poses:
        pose[:3, 3] = np.clip(pose[:3, 3], [-margin[0], -margin[1], 0.3], margin)
    still = chance(random, 0.4)
    stands = Pair(poses, poses if still else put_up_again(random, poses, 0.03))
    recordings = each(lambda solids, own: surveyed_by(random, camera, solids, own), arrangement.solids, stands)
    frame = Frame.drawn(random, shift=0.003 if still else 0.02, degrees=0.2 if still else 1.0)
    # The noise at 3 m.
    return recordings, frame, 0.03 + 2 * 9 * camera.noise


def _stations(
    random: np.random.Generator, arrangement: Arrangement, size: np.ndarray, aim: np.ndarray
) -> tuple[Pair[Recording], Frame, float]:
    beam = Beam(
        noise=np.exp(random.uniform(np.log(0.001), np.log(0.006))),
        max_range=30.0,
        mixed=random.uniform(0.0, 0.3),
        lost=random.uniform(0.0, 0.05),
    )
    stations = int(random.integers(1, 3))
    scanner = TripodScanner(
        beam,
        rays=int(random.uniform(22_000, 39_000) / stations),
        horizontal=360.0 if chance(random, 0.5) else random.uniform(190.0, 270.0),
        lowest=random.uniform(-65, -45),
        highest=random.uniform(30, 90),
    )
    places = random.uniform(-0.25, 0.25, (stations, 2)) * size[:2] + [0.0, -0.1 * size[1]]
    again = places if chance(random, 0.3) else places + random.uniform(-0.4, 0.4, (stations, 2))
    height = random.uniform(1.1, 1.7)
    recordings = each(
        lambda solids, own: scanner.recording(solids, level_poses(random, own, height, aim), random),
        arrangement.solids,
        Pair(places, again),
    )
    return recordings, Frame.drawn(random, shift=0.01, degrees=0.2), 0.03


def level_poses(
    random: np.random.Generator,
    places: Float[np.ndarray, "v 2"],
    height: float | Sequence[float],
    aim: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "v 4 4"]:
    """Poses of a scanner that stands level and looks about where something is.

    Args:
        random: of the azimuths, which are up to 0.4 off.
        places: x and y of the stations, metres.
        height: of all, or of each; in the world, metres.
        aim: what the middle of the field of view is turned to, metres.
    """
    positions = np.column_stack([places, np.broadcast_to(height, len(places))])
    towards = aim[:2] - places
    azimuths = np.arctan2(towards[:, 1], towards[:, 0]) + random.uniform(-0.4, 0.4, len(places))
    ahead = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(places))], axis=1)
    return np.stack([looking_at(place, place + axis) for place, axis in zip(positions, ahead, strict=True)])
