"""Learns the probability that two matched objects are one, from simulated places that were rearranged.

`python -m gmmjax.learning.same_object` writes the parameter file of the package, the same one every time.
"""

import argparse
import json
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from gmmjax.changes import (
    KINDS,
    Change,
    LogisticWeights,
    MatchFacts,
    SameObjectModel,
    Situation,
    change_of,
    differences_between,
    pair_hypotheses,
    place_hypotheses,
)
from gmmjax.clouds import atomic_write
from gmmjax.geometry import LocalSurface, density_clusters, transformed
from gmmjax.pair import Pair
from gmmjax.scenes import Gravity, InPlace, RearrangedScene, RearrangementSettings, rearranged_scene

# Of each fact whether more of it speaks for one object (1), against it (-1), or either (0): what the overlap and the
# differences mean is known, so that noise in the examples cannot turn it round.
SIGNS = MatchFacts(
    covered_least=1,
    covered_most=1,
    explained=1,
    contradicted=-1,
    residual=-1,
    overhang_least=-1,
    overhang_most=-1,
    height_difference=-1,
    outline_difference=-1,
    tops_known=0,
    observability=1,
    width=1,
    thickness=0,
    fewest_points=0,
    distance=-1,
)


class LearningSettings(NamedTuple):
    """What is learned from.

    Attributes:
        scenes: number of places of each gravity and each motion.
        fragments: pieces of unchanged walls, floors and things, strips among them, that are reported as changes in
            either cloud: false ones, which must not be paired.
        pixels: of the camera's frames across, least and greatest: the density of the points.
        voxel: least and greatest edge of the voxels, metres.
        misregistration: translation (metres) and rotation (degrees) that remain after the registration.
        looks: share of the limits of distance and offset from which on a point looks changed.
        ridge: of the weights, in observations: keeps those of facts that tell nothing near zero.
        right: spacings by which a transform may misplace an object's points and still be right.
    """

    scenes: int = 24
    fragments: int = 2
    pixels: tuple[int, int] = (48, 90)
    voxel: tuple[float, float] = (0.008, 0.016)
    misregistration: tuple[float, float] = (0.002, 0.1)
    looks: float = 0.5
    ridge: float = 1.0
    right: float = 4.0


class Example(NamedTuple):
    """One match that was compared.

    Attributes:
        situation: of the match.
        facts: of the match.
        one_object: whether the two are one object, and the transform is its motion.
        scene: the seed.
    """

    situation: Situation
    facts: MatchFacts
    one_object: bool
    scene: int


class _Reported(NamedTuple):
    """What a perfect detector would report of a scene, and some false changes."""

    items: list[Change]
    labels: Pair[Int[np.ndarray, " _"]]
    numbers: list[int]


def examples_of(seed: int, gravity: Gravity, motion: InPlace | None, settings: LearningSettings) -> Iterator[Example]:
    """All matches that are compared in one scene.

    Args:
        seed: of the scene.
        gravity: of the scene.
        motion: within a place; None: things are put elsewhere.
        settings: what the scenes are like.
    """
    random = np.random.default_rng([seed, 1])
    across = int(random.integers(settings.pixels[0], settings.pixels[1] + 1))
    place = RearrangementSettings(
        pixels=(across, int(0.75 * across)),
        voxel=float(random.uniform(*settings.voxel)),
        misregistration=settings.misregistration,
    )
    others = {"appeared": 1, "disappeared": 1, "moved": 3} if motion is None else {"moved": 0}
    scene = rearranged_scene(seed, gravity, in_place=motion, settings=place, **others)
    surfaces = Pair(LocalSurface.of(scene.before), LocalSurface.of(scene.after))
    spacing = max(surface.nearest_distance for surface in surfaces)
    differences = differences_between(surfaces, spacing)
    noise = differences.limits.registration_error
    changed = differences.local.map(
        lambda own: (
            (own.distance > settings.looks * differences.limits.local_distance(own))
            | (own.offset > settings.looks * differences.limits.local_offset(own))
        )
    )
    reported = _reported(random, scene, surfaces, changed, spacing, settings)
    if motion is None:
        yield from _pair_examples(seed, scene, reported, surfaces, noise, settings)
    else:
        yield from _place_examples(seed, scene, reported, surfaces, noise, settings)


def _place_examples(
    seed: int,
    scene: RearrangedScene,
    reported: _Reported,
    surfaces: Pair[LocalSurface],
    noise: float,
    settings: LearningSettings,
) -> Iterator[Example]:
    spacing = max(surface.nearest_distance for surface in surfaces)
    for found in place_hypotheses(reported.items, reported.labels, surfaces, noise):
        truths = [scene.truth_before[found.motion.members.before], scene.truth_after[found.motion.members.after]]
        numbers = {int(np.bincount(truth + 1).argmax()) - 1 for truth in truths}
        right = len(numbers) == 1 and _is_motion(scene, numbers.pop(), found.motion.match.transform, spacing, settings)
        yield Example("in place", found.facts, right, seed)


def _pair_examples(
    seed: int,
    scene: RearrangedScene,
    reported: _Reported,
    surfaces: Pair[LocalSurface],
    noise: float,
    settings: LearningSettings,
) -> Iterator[Example]:
    spacing = max(surface.nearest_distance for surface in surfaces)
    for (i, j), hypothesis in pair_hypotheses(reported.items, reported.labels, surfaces, noise).items():
        number = reported.numbers[i]
        same = number >= 0 and number == reported.numbers[j]
        right = same and _is_motion(scene, number, hypothesis.transform, spacing, settings)
        # The right object with a wrong transform is no example of either.
        if same == right:
            yield Example(hypothesis.situation, hypothesis.facts, right, seed)


def _reported(
    random: np.random.Generator,
    scene: RearrangedScene,
    surfaces: Pair[LocalSurface],
    changed: Pair[Bool[np.ndarray, " _"]],
    spacing: float,
    settings: LearningSettings,
) -> _Reported:
    """The connected points of each true change that look changed, and false changes."""
    items: list[Change] = []
    numbers: list[int] = []
    labels = surfaces.map(lambda surface: np.full(len(surface), -1))
    sides = zip(surfaces, (scene.truth_before, scene.truth_after), changed, labels, strict=True)
    for (surface, truth, looks, own), kind in zip(sides, KINDS, strict=True):
        segments = [(number, np.flatnonzero((truth == number) & looks)) for number in np.unique(truth[truth >= 0])]
        segments = [(number, part) for number, all_of in segments for part in _clusters(surface, all_of, spacing)]
        segments += [(-1, _fragment(random, surface, truth, spacing)) for _ in range(settings.fragments)]
        for number, members in segments:
            members = members[own[members] < 0]
            if len(members) < 20:
                continue
            own[members] = len(items)
            items.append(change_of(surface.points[members], kind, 0.95, 10.0))
            numbers.append(int(number))
    return _Reported(items, labels, numbers)


def _clusters(surface: LocalSurface, members: Int[np.ndarray, " m"], spacing: float) -> list[Int[np.ndarray, " _"]]:
    clusters = density_clusters(surface.points[members], 5 * spacing, 8)
    return [members[clusters == number] for number in range(clusters.max(initial=-1) + 1)]


def _fragment(
    random: np.random.Generator, surface: LocalSurface, truth: Int[np.ndarray, " n"], spacing: float
) -> Int[np.ndarray, " _"]:
    """A patch or a strip of what has not changed."""
    centre = surface.points[random.integers(len(surface))]
    near = np.array(surface.tree.query_ball_point(centre, random.uniform(8, 30) * spacing), int)
    near = near[truth[near] < 0]
    if random.random() < 0.5:
        axis = random.standard_normal(3)
        near = near[np.abs((surface.points[near] - centre) @ axis) < random.uniform(2, 5) * spacing]
    return near


def _is_motion(
    scene: RearrangedScene,
    number: int,
    transform: Float64[np.ndarray, "4 4"],
    spacing: float,
    settings: LearningSettings,
) -> bool:
    """Whether a transform brings a thing to where it is; of a symmetric one any of those that do."""
    if number not in scene.motions:
        return False
    shape = scene.before[scene.truth_before == number]
    there = transformed(scene.after[scene.truth_after == number], np.linalg.inv(scene.motions[number]))
    whole = np.concatenate([shape, there])
    goal = transformed(whole, scene.motions[number])
    placed = transformed(whole, transform)
    apart = [cKDTree(one).query(other)[0] for one, other in ((goal, placed), (placed, goal))]
    return max(float(np.quantile(distances, 0.9)) for distances in apart) < settings.right * spacing


class Job(NamedTuple):
    """The arguments of `examples_of`, as one."""

    seed: int
    gravity: Gravity
    motion: InPlace | None
    settings: LearningSettings

    def run(self) -> list[Example]:
        """The examples."""
        return list(examples_of(*self))


def examples(first_seed: int, settings: LearningSettings, workers: int = 1) -> list[Example]:
    """Those of all scenes from a seed on: things elsewhere, every motion within a place, with and without a floor.

    Args:
        first_seed: of the first scene.
        settings: how many scenes, and what they are like.
        workers: number of processes; the result does not depend on it.
    """
    motions = get_args(InPlace)
    jobs = [
        Job(first_seed + index, gravity, motion, settings)
        for gravity in get_args(Gravity)
        for index in range(settings.scenes)
        for motion in (None, motions[index % len(motions)], motions[(index + 1) % len(motions)])
    ]
    if workers == 1:
        return [example for job in jobs for example in job.run()]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        return [example for own in pool.map(Job.run, jobs) for example in own]


def learned(given: Sequence[Example], settings: LearningSettings) -> SameObjectModel:
    """A logistic model for each situation, by penalised maximum likelihood, with the known signs of the weights.

    Args:
        given: the examples.
        settings: the penalty.
    """
    return SameObjectModel(
        {
            situation: _fitted([example for example in given if example.situation == situation], settings)
            for situation in get_args(Situation)
        }
    )


def _fitted(given: Sequence[Example], settings: LearningSettings) -> LogisticWeights:
    facts = np.array([example.facts for example in given])
    truth = np.array([example.one_object for example in given], float)
    means, scales = facts.mean(axis=0), np.maximum(facts.std(axis=0), 1e-3)
    farthest = SameObjectModel({}).farthest
    rows = np.clip((facts - means) / scales, -farthest, farthest)

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        log_odds = parameters[0] + rows @ parameters[1:]
        value = (
            np.logaddexp(0, log_odds).sum() - truth @ log_odds + settings.ridge / 2 * parameters[1:] @ parameters[1:]
        )
        error = 1 / (1 + np.exp(-log_odds)) - truth
        return float(value), np.concatenate([[error.sum()], rows.T @ error + settings.ridge * parameters[1:]])

    bounds = [(None, None), *((0 if sign > 0 else None, 0 if sign < 0 else None) for sign in SIGNS)]
    best = minimize(loss, np.zeros(len(SIGNS) + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    # Six digits, so that the file does not depend on the last bits of the machine's arithmetic.
    means, scales, best = (np.array([float(f"{value:.6g}") for value in own]) for own in (means, scales, best))
    return LogisticWeights(means, scales, best[1:], float(best[0]))


def summary(given: Sequence[Example], model: SameObjectModel) -> Iterator[str]:
    """For each situation how many objects are recognised, and how many of the reported pairs are wrong."""
    for situation in get_args(Situation):
        own = [example for example in given if example.situation == situation]
        truth = np.array([example.one_object for example in own], bool)
        log_odds = np.array([model.log_odds(example.facts, situation) for example in own])
        reported, probability = log_odds >= 0, 1 / (1 + np.exp(-log_odds))
        brier = float(((probability - truth) ** 2).mean()) if len(own) else 0.0
        yield (
            f"{situation}: {len(own)} matches, {truth.sum()} of one object, {(reported & truth).sum()} recognised, "
            f"{(reported & ~truth).sum()} wrong; Brier score {brier:.4f}"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Writes the parameter file, and prints how well it does on scenes that it was not learned from."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path, help="the parameter file")
    parser.add_argument("--scenes", type=int, default=LearningSettings().scenes, help="of each gravity and motion")
    parser.add_argument("--seed", type=int, default=0, help="of the first scene")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    given = parser.parse_args(arguments)
    settings = LearningSettings(scenes=given.scenes)
    model = learned(examples(given.seed, settings, given.workers), settings)
    with atomic_write(given.output) as file:
        file.write((json.dumps(model.to_dict(), indent=1, allow_nan=False) + "\n").encode())
    unseen = settings._replace(scenes=max(given.scenes // 4, 1))
    print(*summary(examples(given.seed + 10_000, unseen, given.workers), model), sep="\n")


if __name__ == "__main__":
    main()
