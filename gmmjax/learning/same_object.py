"""Learns the probability that two matched objects are one, from simulated scenes in which things moved.

`python -m gmmjax.learning.same_object` writes the parameter file of the package, the same one every time.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from jaxtyping import Float64
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from gmmjax.changes import (
    FARTHEST,
    MOVED_THRESHOLD,
    LogisticWeights,
    MatchFacts,
    PairHypothesis,
    SameObjectModel,
    Situation,
    match_of,
    pair_hypotheses,
    place_hypotheses,
)
from gmmjax.clouds import atomic_write
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.learning.moved_scenes import KINDS_OF_SCENES, FoundScene, SceneSettings, found_scene
from gmmjax.learning.scene_workers import over_workers
from gmmjax.scenes import FAMILIES

# Of each fact whether more of it speaks for one object (1), against it (-1), or either (0): what the overlap and the
# differences mean is known, so that noise in the examples cannot turn it round.
SIGNS = MatchFacts(
    covered=1,
    explained=1,
    contradicted=-1,
    observability=1,
    thickness=0,
    distance=-1,
)


# Of the scenes of each kind, the share that is simulated of each family: few of their things move.
OF_FAMILIES = 0.5
# Of the weights, in observations: keeps those of facts that tell nothing near zero.
RIDGE = 1.0
# Scenes of each kind that are made for this. Fewer: the weights differ from sample to sample.
SCENES = 120
# Weight of an example of two objects in different places: fewer things move, and more come and go, than in the scenes
# that are learned from. Empirical. 1: a pair is as probable as there.
OTHERS = 2.0
# Spacings by which a transform may misplace an object's points and still be right.
RIGHT = 4.0
# By how much less a wrong transform of the right object may fit than the true one, as a fraction of its points: what
# looks the same after a rotation is recognised all the same.
AS_GOOD = 0.1


class Example(NamedTuple):
    """One match that was compared.

    Attributes:
        situation: of the match.
        facts: of the match.
        one_object: whether the two are one object.
        kind: of the scene.
    """

    situation: Situation
    facts: MatchFacts
    one_object: bool
    kind: str = ""


def examples_of(kind: str, found: FoundScene) -> Iterator[Example]:
    """All matches that are compared in one scene of this kind."""
    changes = found.changes
    given = changes.items, changes.labels, changes.pair.surfaces, changes.registration_error
    for place in place_hypotheses(*given):
        number = found.truth_of_members(place.motion.members)
        right = number >= 0 and _misplaced(found, number, place.motion.match.transform) < RIGHT
        yield Example("in place", place.facts, right, kind)
    truths = [found.truth_of(index) for index in range(len(changes.items))]
    for (i, j), pair in pair_hypotheses(*given).items():
        same = truths[i] == truths[j] and truths[i] in found.scene.motions
        # The right object with a wrong transform is no example of either, unless that fits as well as the true one.
        if not same or _as_good(found, truths[i], pair):
            yield Example(pair.situation, pair.facts, same, kind)


def _as_good(found: FoundScene, number: int, pair: PairHypothesis) -> bool:
    """True where a transform brings a thing to where it is, or fits what was seen of it as well as the true one."""
    if _misplaced(found, number, pair.transform) < RIGHT:
        return True
    fits, true = (match_of(pair.compared, own).fit for own in (pair.transform, found.motion(number)))
    return fits >= true - AS_GOOD


def _misplaced(found: FoundScene, number: int, transform: Float64[np.ndarray, "4 4"]) -> float:
    """Error of an object's transform, in spacings; for a symmetric object that of the points that were seen."""
    if number not in found.scene.motions:
        return np.inf
    spacing = max(surface.nearest_distance for surface in found.changes.pair.surfaces)
    whole = found.shape(number)
    goal, placed = transformed(whole, found.motion(number)), transformed(whole, transform)
    apart = [cKDTree(one).query(other)[0] for one, other in ((goal, placed), (placed, goal))]
    return max(float(np.quantile(distances, 0.9)) for distances in apart) / spacing


def examples(first_seed: int, scenes: int, workers: int = 1) -> list[Example]:
    """Those of all scenes from a seed on.

    Args:
        first_seed: of the first scene of each kind.
        scenes: number of scenes of each kind that is made for this.
        workers: number of processes; the result does not depend on it.
    """
    counts = {kind: int(scenes * (OF_FAMILIES if kind in FAMILIES else 1)) for kind in KINDS_OF_SCENES}
    jobs = [(kind, first_seed + index) for kind, count in counts.items() for index in range(count)]
    return [example for own in over_workers(examples_of_scene, jobs, workers) for example in own]


def examples_of_scene(job: tuple[str, int], settings: SceneSettings = SceneSettings()) -> list[Example]:
    """The examples of the scene of a kind and a seed."""
    kind, seed = job
    found = found_scene(kind, seed, settings)
    return [] if found is None else list(examples_of(kind, found))


def learned(given: Sequence[Example], others: float = OTHERS) -> SameObjectModel:
    """A logistic model for each situation, by penalised maximum likelihood, with the known signs of the weights.

    Args:
        given: the examples.
        others: weight of an example of two objects in different places.

    Raises:
        InputError: too few examples of a situation.
    """
    models = SameObjectModel()
    for situation in get_args(Situation):
        own = [example for example in given if example.situation == situation]
        if len({example.one_object for example in own}) < 2:
            raise InputError(f"the scenes have no two kinds of examples {situation!r}; learn from more scenes")
        models[situation] = _fitted(own, 1.0 if situation == "in place" else others)
    return models


def _fitted(given: Sequence[Example], others: float) -> LogisticWeights:
    """The logistic model of some examples, with a weight of those of two objects."""
    facts = np.array([example.facts for example in given])
    truth = np.array([example.one_object for example in given], float)
    means, scales = facts.mean(axis=0), np.maximum(facts.std(axis=0), 1e-3)
    weights = np.where(truth > 0, 1.0, others)
    rows = np.clip((facts - means) / scales, -FARTHEST, FARTHEST)
    bounds = [(None, None), *((0 if sign > 0 else None, 0 if sign < 0 else None) for sign in SIGNS)]
    start, examples = np.zeros(len(SIGNS) + 1), (rows, truth, weights)
    best = minimize(_loss, start, examples, jac=True, method="L-BFGS-B", bounds=bounds).x
    # Six digits, so that the file does not depend on the last bits of the machine's arithmetic.
    means, scales, best = (np.array([float(f"{value:.6g}") for value in own]) for own in (means, scales, best))
    return LogisticWeights(means, scales, best[1:], float(best[0]))


def _loss(parameters: np.ndarray, rows: np.ndarray, truth: np.ndarray, weights: np.ndarray) -> tuple[float, np.ndarray]:
    """The penalised negative log likelihood, and its gradient."""
    log_odds = parameters[0] + rows @ parameters[1:]
    likelihood = weights @ (truth * log_odds - np.logaddexp(0, log_odds))
    value = RIDGE / 2 * parameters[1:] @ parameters[1:] - likelihood
    error = weights * (1 / (1 + np.exp(-log_odds)) - truth)
    return float(value), np.concatenate([[error.sum()], rows.T @ error + RIDGE * parameters[1:]])


def left_out_log_odds(given: Sequence[Example], others: float = OTHERS) -> Float64[np.ndarray, " e"]:
    """The log odds of every example by what is learned from all other kinds of scenes.

    Args:
        given: the examples.
        others: as of `learned`.
    """
    models = {
        kind: learned([example for example in given if example.kind != kind], others)
        for kind in {example.kind for example in given}
    }
    return np.array([models[example.kind][example.situation].log_odds(example.facts) for example in given])


def summary(given: Sequence[Example], log_odds: Float64[np.ndarray, " e"], threshold: float) -> Iterator[str]:
    """For each situation how many objects are recognised, and how many of the reported pairs are wrong.

    Args:
        given: the examples.
        log_odds: of each that it is one object.
        threshold: probability from which on a pair is reported.
    """
    yield "| what is known of the motion | matches | one object | recognised | wrongly recognised | Brier score |"
    yield "|---|---|---|---|---|---|"
    for situation in get_args(Situation):
        own = np.array([example.situation == situation for example in given])
        truth = np.array([example.one_object for example in given])[own]
        probability = 1 / (1 + np.exp(-log_odds[own]))
        reported = probability >= threshold
        brier = float(((probability - truth) ** 2).mean()) if len(truth) else 0.0
        yield (
            f"| {situation} | {len(truth)} | {truth.sum()} | {(reported & truth).sum()} | {(reported & ~truth).sum()} "
            f"| {brier:.3f} |"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Writes the parameter file, and prints how well each kind of scene is judged by what the others teach."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path, help="the parameter file")
    parser.add_argument("--scenes", type=int, default=SCENES, help="of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first scene")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    given = parser.parse_args(arguments)
    found = examples(given.seed, given.scenes, given.workers)
    with atomic_write(given.output) as file:
        file.write(learned(found).to_json().encode())
    print(*summary(found, left_out_log_odds(found), MOVED_THRESHOLD), sep="\n")


if __name__ == "__main__":
    main()
