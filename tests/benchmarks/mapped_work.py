"""The fits, posteriors and transport of many small pairs, mapped in several ways: what `batch_mapping` compares.

All pairs of a case have the same shapes. They are read from a file, so that a process of any contender has the same.
"""

import functools
import os
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gmmjax import detect_changes
from gmmjax.changes.align.alignment import aligned
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.fit.joint_fit import JointFits, point_excess
from gmmjax.changes.fit.joint_problem import JointFitSettings, joint_problem
from gmmjax.clouds import canonical_order
from gmmjax.comparison import of_cloud
from gmmjax.comparison.joint_mixture import JointMixture, density_ratio, point_posterior
from gmmjax.comparison.joint_mixture_model import SourcedPoints, fit_joint_mixture_from_seeds
from gmmjax.mixtures import GaussianMixture, Prior, Standardisation, WeightedPoints, map_on_cores
from gmmjax.mixtures.parallel import stacked
from gmmjax.mixtures.weighted_points import bucket
from gmmjax.native import SWITCH
from gmmjax.pair import Pair
from gmmjax.scenes import random_scene
from gmmjax.transport import earth_movers_distance
from tests.benchmarks.interleaved import Elsewhere

GAUSSIANS = 5
PRECISION = "float64"
EM = JointFitSettings().em


class Problems(NamedTuple):
    """What is fitted, with a leading axis of pairs; the clouds are padded alike, in the frame of the fit.

    Attributes:
        scans: the before and the after cloud as they are given, for whole detections.
        points: of both clouds of each pair.
        clouds: the points of the before and of the after cloud, for the posteriors; as a tree of JAX's.
        prior: of each pair.
        components: that annihilation starts from.
        keys: data of the random keys [pairs, restarts, 2].
    """

    scans: tuple[np.ndarray, np.ndarray]
    points: SourcedPoints
    clouds: tuple[np.ndarray, np.ndarray]
    prior: Prior
    components: np.ndarray
    keys: np.ndarray


class Fitted(NamedTuple):
    """Mixtures [pairs, restarts, ...] with their density ratios, and how EM ended.

    Attributes:
        joint: the mixtures.
        ratio: density ratio of each.
        message_length: of each.
        steps: EM steps of each.
    """

    joint: JointMixture
    ratio: np.ndarray
    message_length: np.ndarray
    steps: np.ndarray


# What one job of a queue takes: the problem of one pair and its fits, None where they are what is computed.
Job = tuple[Problems, Fitted | None]


def problems_of_scenes(points: int, pairs: int, restarts: int) -> Problems:
    """Pairs of artificial scenes with about so many points a cloud, prepared as a detection prepares them."""
    return stacked([_problem(points, seed, restarts) for seed in range(pairs)])


def _problem(points: int, seed: int, restarts: int) -> Problems:
    scene = random_scene(jax.random.key(seed), start=GAUSSIANS, disappeared=1, points=points // GAUSSIANS)
    scans = scene.before, scene.after
    clouds = Pair(*scans).map(lambda cloud: cloud[canonical_order(cloud)])
    pair = aligned(clouds, seed=seed)
    problem = joint_problem(pair.working, pair.registration, DetectionConfig())
    frame = Standardisation.of(problem.points.points)
    framed = SourcedPoints(frame.enter(problem.points.points), problem.points.after)
    # Python numbers as arrays, which are stacked like the others.
    prior = jax.tree.map(np.float64, frame.enter_prior(problem.prior))
    keys = jax.random.key_data(jax.random.split(jax.random.key(seed), restarts))
    posterior_at = clouds.map(lambda cloud: _padded((cloud - frame.origin) / frame.spread))
    components = np.int32(problem.max_components)
    return Problems(scans, framed.padded(), tuple(posterior_at), prior, components, np.asarray(keys))


def _padded(points: np.ndarray) -> np.ndarray:
    return np.pad(points, ((0, bucket(len(points)) - len(points)), (0, 0)))


def save(path: Path, problems: Problems, fitted: Fitted | None) -> None:
    """Writes the leaves in their order."""
    leaves = jax.tree.leaves((problems, fitted))
    np.savez(path, **{f"leaf_{number:03}": leaf for number, leaf in enumerate(leaves)})


@functools.lru_cache(maxsize=1)
def loaded(path: Path) -> tuple[Problems, Fitted | None]:
    """What `save` wrote; a process keeps the latest."""
    with np.load(path) as arrays:
        leaves = [arrays[name] for name in sorted(arrays.files)]
    problems = jax.tree.structure(_empty_problems())
    count = problems.num_leaves
    fitted = jax.tree.unflatten(jax.tree.structure(_empty_fits()), leaves[count:]) if len(leaves) > count else None
    return jax.tree.unflatten(problems, leaves[:count]), fitted


def _empty_problems() -> Problems:
    """Of the same structure."""
    number, row, cloud = np.zeros(()), np.zeros(1), np.zeros((1, 3))
    points = SourcedPoints(WeightedPoints(cloud, row), row)
    return Problems((cloud, cloud), points, (cloud, cloud), Prior(number, number, noise_share=number), number, row)


def _empty_fits() -> Fitted:
    """Of the same structure."""
    number, row = np.zeros(()), np.zeros(1)
    mixture = GaussianMixture(row, np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros(1, bool))
    return Fitted(JointMixture(mixture, row, number, number), row, row, row)


# ---------------------------------------------------------------- what is computed for one restart of one pair


def _fit(points: SourcedPoints, prior: Prior, components: Any, key: Any, slots: int) -> Fitted:
    key = jax.random.wrap_key_data(key)
    fit = fit_joint_mixture_from_seeds(points, slots, prior, key, EM, components)
    return Fitted(fit.mixture, density_ratio(fit.mixture), fit.message_length, fit.steps)


def _posteriors(fitted: Fitted, clouds: tuple[Any, Any]) -> tuple[Any, ...]:
    times = enumerate(clouds)
    return tuple(point_posterior(fitted.joint, fitted.ratio, cloud, bool(after)) for after, cloud in times)


def _distance(fitted: Fitted) -> Any:
    return earth_movers_distance(of_cloud(fitted.joint, after=False), of_cloud(fitted.joint, after=True)).cost


# ---------------------------------------------------------------- the restarts of one pair, side by side or in turn

OneRestart = Callable[[Callable[..., Any], Any], Any]


def _side_by_side(function: Callable[..., Any], over: Any) -> Any:
    return jax.vmap(function)(over)


def _in_turn(function: Callable[..., Any], over: Any) -> Any:
    return jax.lax.map(function, over)


def fits_of_pair(problem: Problems, fitted: Fitted | None, over_restarts: OneRestart, slots: int) -> Fitted:
    """All restarts of a pair, on the same points."""
    points, prior, components = problem.points, problem.prior, problem.components
    return over_restarts(lambda key: _fit(points, prior, components, key, slots), problem.keys)


def posteriors_of_pair(problem: Problems, fitted: Fitted, over_restarts: OneRestart, slots: int) -> tuple[Any, Any]:
    """Of every point of both clouds, for each restart."""
    return over_restarts(lambda own: _posteriors(own, problem.clouds), fitted)


def distances_of_pair(problem: Problems, fitted: Fitted, over_restarts: OneRestart, slots: int) -> Any:
    """Between the two clouds' mixtures, for each restart."""
    return over_restarts(_distance, fitted)


OPERATIONS = {"fits": fits_of_pair, "posteriors": posteriors_of_pair, "transport": distances_of_pair}


@functools.cache
def _program(operation: str, way: str, slots: int) -> Callable[..., Any]:
    """Compiled once in a process: for one restart, one pair, or all pairs."""
    of_pair = OPERATIONS[operation]
    side_by_side = functools.partial(of_pair, over_restarts=_side_by_side, slots=slots)
    programs = {
        "one restart": lambda points, prior, components, key: _fit(points, prior, components, key, slots),
        "restarts in turn": functools.partial(of_pair, over_restarts=_in_turn, slots=slots),
        "restarts side by side": side_by_side,
        "all side by side": jax.vmap(side_by_side),
    }
    return jax.jit(programs[way])


# ---------------------------------------------------------------- the mappings


def one_vmap(operation: str, path: Path, slots: int) -> Any:
    """One program for all pairs and restarts."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _program(operation, "all side by side", slots)(*loaded(path)))


def one_plain_vmap(operation: str, path: Path, slots: int) -> Any:
    """The same without the compiled kernels; in a process of its own, because a process looks for them once."""
    os.environ[SWITCH] = "0"
    return one_vmap(operation, path, slots)


def queue_of_restarts(operation: str, path: Path, slots: int) -> Any:
    """A core that is done takes the next restart, of whatever pair: what `map_on_cores` does for one pair."""
    problems, _ = loaded(path)
    of_pair = problems.points, problems.prior, problems.components
    jobs = [
        (*jax.tree.map(lambda leaf, pair=pair: leaf[pair], of_pair), key)
        for pair, keys in enumerate(problems.keys)
        for key in keys
    ]
    results = map_on_cores(_program(operation, "one restart", slots), jobs, PRECISION)
    return jax.tree.map(lambda leaf: leaf.reshape(*problems.keys.shape[:2], *leaf.shape[1:]), results)


def queue_of_pairs(operation: str, path: Path, slots: int, way: str = "restarts in turn") -> Any:
    """A core that is done takes the next pair."""
    if operation == "detection":
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
            return stacked(list(threads.map(functools.partial(_of_one_pair, operation, slots), jobs_of(path))))
    return map_on_cores(_program(operation, way, slots), jobs_of(path), PRECISION)


def queue_of_vmaps(operation: str, path: Path, slots: int) -> Any:
    """A core that is done takes the next pair, whose restarts are computed side by side."""
    return queue_of_pairs(operation, path, slots, "restarts side by side")


def pair_after_pair(operation: str, path: Path, slots: int) -> Any:
    """One pair at a time, as a loop over `detect_changes` computes them."""
    return stacked([_of_one_pair(operation, slots, job) for job in jobs_of(path)])


def pair_after_pair_in_chunks(operation: str, path: Path, slots: int) -> Any:
    """Posteriors by the library's own function, which pads every cloud to whole chunks."""
    return stacked([_posteriors_in_chunks(job) for job in jobs_of(path)])


def _of_one_pair(operation: str, slots: int, job: Job) -> Any:
    problem, _ = job
    if operation == "detection":
        return _detection(problem)
    if operation == "fits":
        restarts = [(problem.points, problem.prior, problem.components, key) for key in problem.keys]
        return map_on_cores(_program(operation, "one restart", slots), restarts, PRECISION)
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _program(operation, "restarts in turn", slots)(*job))


def _detection(problem: Problems) -> tuple[np.ndarray, ...]:
    with warnings.catch_warnings():
        # Of scenes whose registration is in doubt.
        warnings.simplefilter("ignore")
        found = detect_changes(*problem.scans, restarts=len(problem.keys))
    return found.probability_before, found.probability_after


def _posteriors_in_chunks(job: Job) -> tuple[np.ndarray, ...]:
    problem, fitted = job
    of_restarts = fitted.message_length, fitted.ratio, fitted.steps, np.zeros(len(fitted.steps))
    fits = JointFits(fitted.joint, *of_restarts, Standardisation(np.zeros(3), 1.0))
    restarts = range(len(fitted.steps))
    return tuple(
        np.stack([point_excess(fits, cloud, bool(after), restart) for restart in restarts])
        for after, cloud in enumerate(problem.clouds)
    )


def one_pair(operation: str, path: Path, slots: int, number: int) -> tuple[Any, float]:
    """What a process of a queue does for one pair, and its CPU seconds."""
    started = time.process_time()
    answer = _of_one_pair(operation, slots, jax.tree.map(lambda leaf: leaf[number], loaded(path)))
    return answer, time.process_time() - started


def jobs_of(path: Path) -> list[Job]:
    """One for each pair."""
    both = loaded(path)
    return [jax.tree.map(lambda leaf, pair=pair: leaf[pair], both) for pair in range(len(both[0].keys))]


class ProcessQueue:
    """Processes of one core each that take pair after pair; a context manager."""

    def __init__(self, cores: list[int]):
        self._pools = [
            ProcessPoolExecutor(1, get_context("spawn"), initializer=os.sched_setaffinity, initargs=(0, {core}))
            for core in cores
        ]

    def __enter__(self) -> "ProcessQueue":
        return self

    def __exit__(self, *_: object) -> None:
        for pool in self._pools:
            pool.shutdown()

    def run(self, operation: str, path: Path, slots: int, pairs: int) -> Elsewhere:
        """Wall seconds seen from here, CPU seconds of the processes and of this one; the answers stacked."""
        wall, cpu = time.perf_counter(), time.process_time()
        waiting, answers = iter(range(pairs)), {}

        def feed(pool: ProcessPoolExecutor) -> None:
            for number in waiting:
                answers[number] = pool.submit(one_pair, operation, path, slots, number).result()

        with ThreadPoolExecutor(len(self._pools)) as threads:
            # To see the exceptions.
            list(threads.map(feed, self._pools))
        stack = stacked([answers[number][0] for number in range(pairs)])
        spent = sum(seconds for _, seconds in answers.values()) + time.process_time() - cpu
        return Elsewhere(time.perf_counter() - wall, spent, stack)
