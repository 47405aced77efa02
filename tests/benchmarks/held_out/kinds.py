"""The kinds of held-out scenes, as sources of labelled pairs."""

import functools
import itertools
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np

from gmmjax.errors import check_choice
from gmmjax.evaluation import LabelledCloud, PairSource
from tests.benchmarks.held_out import halls, indoors, slopes
from tests.benchmarks.held_out.surveys import HeldOutPair, Staged, labelled

Poses = Literal["given", "unknown"]
CHANGED, UNCHANGED = "changed", "unchanged"
ROOMS: Mapping[str, Callable[[np.random.Generator, bool], Staged]] = {
    "room": indoors.room,
    "hard_room": functools.partial(indoors.room, lost=0.25),
    "single_frame": indoors.single_frame,
    "misregistered_room": indoors.misregistered_room,
    "station": indoors.station,
    "corridor": indoors.corridor,
    "two_sensors": indoors.two_sensors,
    "half_overlap": indoors.half_overlap,
    "turned_chair": indoors.turned_chair,
    "box_by_3_cm": functools.partial(indoors.shifted_box, metres=0.03),
    "box_by_10_cm": functools.partial(indoors.shifted_box, metres=0.10),
    "laid_table": indoors.laid_table,
    "opened_door": indoors.opened_door,
    "pulled_drawer": indoors.pulled_drawer,
}
# Scenes of surveyors, of any number of points.
SURVEYED: Mapping[str, Callable[[np.random.Generator, bool, int], Staged]] = {"hall": halls.hall, "slope": slopes.slope}
KINDS = (*ROOMS, *SURVEYED)


def held_out_sources(
    kinds: Sequence[str], seeds: Sequence[int], poses: Sequence[Poses], points: int = 400_000
) -> list[PairSource]:
    """Scenes that changed and scenes that did not, of every kind and seed.

    Args:
        kinds: of `KINDS`.
        seeds: a scene of either condition for each.
        poses: whether the detectors are given the sensors' poses; the points are the same.
        points: about so many a side, of `SURVEYED` kinds.

    Returns:
        Sources whose group is the kind with the poses, whose condition is "changed" or "unchanged".

    Raises:
        InputError: an unknown kind.
    """
    for kind in kinds:
        check_choice("kind", kind, KINDS)
    every = itertools.product(kinds, poses, (CHANGED, UNCHANGED), seeds)
    return [
        PairSource(
            f"{kind} {seed}",
            f"{kind}, poses {known}",
            condition,
            functools.partial(held_out_pair, kind, seed, condition == CHANGED, known, points),
        )
        for kind, known, condition, seed in every
    ]


def held_out_pair(kind: str, seed: int, changed: bool, poses: Poses = "given", points: int = 400_000) -> HeldOutPair:
    """One scene, drawn from the seed; where nobody can be asked to find any of its changes, another is drawn."""
    for attempt in itertools.count():
        random = np.random.default_rng([zlib.crc32(kind.encode()), seed, changed, *([attempt] if attempt else [])])
        staged = SURVEYED[kind](random, changed, points) if kind in SURVEYED else ROOMS[kind](random, changed)
        pair = labelled(f"{kind} {seed}", staged, random, given=poses == "given")
        if not changed or _findable(pair.before) or _findable(pair.after):
            break
    return pair


def _findable(cloud: LabelledCloud) -> bool:
    return bool(set(np.unique(cloud.truth)) - {-1} - cloud.not_counted)
