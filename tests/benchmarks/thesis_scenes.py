"""F1 of `compare` on the thesis's artificial scenes (4.6.1), by one restart and averaged over many.

`python -m tests.benchmarks.thesis_scenes` prints a Markdown table: of segments / of points. A point is changed where
its probability is above 1/2. A segment is the changed points of one component of the first restart's mixture, where
more than half of the component's points changed.
"""

import argparse
import dataclasses
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from gmmjax import use_compilation_cache
from gmmjax.comparison import ComparedPair, Method, compare_many
from gmmjax.evaluation import LabelledPair, Scores, gaussian_sources, score_labelled_pair
from gmmjax.mixtures import GaussianMixture
from tests.benchmarks.harness import put

METHODS: tuple[Method, ...] = ("greedy", "transport", "joint")
# One kind of change occurs, or both do.
KINDS = {"one": ("(+1)*", "(+2)*", "(-1)*", "(-2)*"), "both": ("(-1 +1)*",)}


class Compared(NamedTuple):
    """The scores of scenes of one kind, added: of every restart by itself, and of the averages over them."""

    single: tuple[Scores, ...]
    averaged: Scores


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=5000)
    parser.add_argument("--restarts", type=int, default=16)
    parser.add_argument("--points", type=int, default=1000, help="of each Gaussian")
    parser.add_argument("--page", type=Path, help="Markdown file with a place for the table")
    arguments = parser.parse_args()
    use_compilation_cache()
    columns = ("method", "changes", "scenes", "one restart, mean", "one restart, worst", "averaged")
    rows = ["| " + " | ".join(columns) + " |", "|---" * len(columns) + "|"]
    for kind, patterns in KINDS.items():
        seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
        pairs = scenes(patterns, seeds, arguments.points)
        for method in METHODS:
            found = compared(pairs, method, arguments.restarts)
            # Segments / points.
            shares = np.array([(own.f1, own.point_f1) for own in found.single])
            cells = [shares.mean(axis=0), shares.min(axis=0), (found.averaged.f1, found.averaged.point_f1)]
            texts = [f"{of_segments:.3f} / {of_points:.3f}" for of_segments, of_points in cells]
            rows.append("| " + " | ".join([method, kind, str(len(pairs)), *texts]) + " |")
    put(arguments.page, "thesis scenes by compare", "\n".join(rows))


def scenes(patterns: Sequence[str], seeds: Sequence[int], points: int) -> list[LabelledPair]:
    """The scenes of the thesis whose condition fits one of the patterns."""
    sources = gaussian_sources(seeds, ["thesis"], points=points)
    return [own.load() for own in sources if any(fnmatchcase(own.condition, pattern) for pattern in patterns)]


def compared(pairs: Sequence[LabelledPair], method: Method, restarts: int) -> Compared:
    """The scores of a method."""
    clouds = [(pair.before.points, pair.after.points) for pair in pairs]
    single, averaged = [Scores()] * restarts, Scores()
    for found in compare_many(clouds, key=jax.random.key(0), restarts=restarts, method=method):
        pair = pairs[found.pair]
        averaged += scored(pair, found, found.mean.probability_before, found.mean.probability_after, 0)
        for nth in range(restarts):
            each = found.restarts.probability_before[nth], found.restarts.probability_after[nth]
            single[nth] += scored(pair, found, *each, nth)
    return Compared(tuple(single), averaged)


def scored(pair: LabelledPair, found: ComparedPair, before: np.ndarray, after: np.ndarray, restart: int) -> Scores:
    """The scores by these probabilities, with the segments of this restart's mixtures."""
    mixtures = found.restarts.mixture_before, found.restarts.mixture_after
    own = [jax.tree.map(lambda leaf: leaf[restart], mixture) for mixture in mixtures]
    labels = segments(own[0], pair.before.points, before), segments(own[1], pair.after.points, after)
    scores = score_labelled_pair(pair, *labels)
    # Points are counted whether they are in a segment or not.
    points = score_labelled_pair(pair, (before > 0.5) - 1, (after > 0.5) - 1)
    counts = {name: getattr(points, name) for name in ("true_points", "labelled_points", "changed_points")}
    return dataclasses.replace(scores, **counts)


def segments(mixture: GaussianMixture, points: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Per point the component that it most probably is of, -1 where nothing changed."""
    component, changed = mixture.responsibilities(points).argmax(axis=1), probability > 0.5
    own = np.bincount(component, minlength=len(mixture.weights))
    mostly = 2 * np.bincount(component[changed], minlength=len(mixture.weights)) > own
    return np.where(changed & mostly[component], component, -1)


if __name__ == "__main__":
    main()
