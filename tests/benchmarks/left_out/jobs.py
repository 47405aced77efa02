"""The work of the command: one family with what was learned on all others, beside the peers and another checkout."""

import dataclasses
import hashlib
import itertools
import json
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from gmmjax import InputWarning
from gmmjax.changes import DetectionConfig, JointDetector, Scan
from gmmjax.clouds import atomic_write
from gmmjax.evaluation import LabelledPair, Scores, detector, score_labelled_pair
from gmmjax.learning.collection import training_sources
from gmmjax.pair import Pair
from tests.benchmarks.best_peers import Judge, peer_scores, registered
from tests.benchmarks.left_out.other_checkout import Found, found_there

POSES = ("unknown", "given")
LEARNED, OTHER = "verdict", "other checkout"
# Seeds of one family are so far apart that the laboratory's survey and condition change from each to the next.
STEP = 5

OfPair: TypeAlias = dict[str, dict[str, Scores]]
"""The scores of one pair by detector and setting."""


class Job(NamedTuple):
    """The pairs of one family, and what is run on them.

    Attributes:
        family: of the scenes.
        verdict: file of the verdict learned without it.
        changed: number of pairs in which something changed.
        unchanged: number of those in which nothing did.
        first_seed: that is tried.
        against: root of another checkout whose `detect_changes` runs on them, too.
        peers: whether the peers do.
    """

    family: str
    verdict: Path
    changed: int
    unchanged: int
    first_seed: int
    against: Path | None
    peers: bool

    def key(self) -> dict[str, Any]:
        """What the result depends on, but for the code."""
        digest = hashlib.sha256(self.verdict.read_bytes()).hexdigest()
        return {**self._asdict(), "verdict": digest, "against": self.against and str(self.against.resolve())}


@dataclasses.dataclass(frozen=True)
class FamilyResult:
    """What was found in the pairs of a family.

    Attributes:
        family: its name.
        pairs: the scores of each pair, by its name.
        failures: what is missing in them, and why: those pairs are left out.
    """

    family: str
    pairs: Mapping[str, OfPair]
    failures: Sequence[str]

    def summed(self) -> OfPair:
        """The scores of all pairs added."""
        total: OfPair = {}
        for of_pair in self.pairs.values():
            for name, settings in of_pair.items():
                own = total.setdefault(name, {})
                for text, scores in settings.items():
                    own[text] = own.get(text, Scores()) + scores
        return total


def results(jobs: Sequence[Job], folder: Path, workers: int) -> list[FamilyResult]:
    """The results of the jobs, in their order.

    Args:
        jobs: one for each family.
        folder: each result is kept there as soon as it is there; those that are there are not computed again.
        workers: processes.
    """
    missing = [job for job in jobs if kept(job, folder) is None]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = {pool.submit(result, job): job for job in missing}
        for number, future in enumerate(as_completed(running), 1):
            keep(running[future], future.result(), folder)
            print(f"{number} of {len(missing)} done: {running[future].family}", file=sys.stderr, flush=True)
    return [found for job in jobs if (found := kept(job, folder)) is not None]


def keep(job: Job, found: FamilyResult, folder: Path) -> None:
    """Writes a result, whole or not at all."""
    with atomic_write(folder / f"{job.family}.json") as file:
        file.write(json.dumps({"job": job.key(), **dataclasses.asdict(found)}).encode())


def kept(job: Job, folder: Path) -> FamilyResult | None:
    """The result that was kept of this very job; None: there is none."""
    file = folder / f"{job.family}.json"
    if not file.is_file():
        return None
    content = json.loads(file.read_text())
    if content.pop("job") != json.loads(json.dumps(job.key())):
        return None
    pairs = {
        pair: {name: {text: Scores(**own) for text, own in settings.items()} for name, settings in of_pair.items()}
        for pair, of_pair in content["pairs"].items()
    }
    return FamilyResult(content["family"], pairs, content["failures"])


def result(job: Job) -> FamilyResult:
    """Runs a job."""
    pairs, failures, scored = dict(loaded(job)), [], {}
    there = found_there(job.against, pairs) if job.against else {}
    for name, pair in pairs.items():
        try:
            scored[name] = _scores(pair, job, there.get(name))
        # Whatever is wrong with this pair, there are the others.
        except Exception as error:
            failures.append(f"{job.family}, {name}: {type(error).__name__}: {error}")
    return FamilyResult(job.family, scored, failures)


def loaded(job: Job) -> Iterator[tuple[str, LabelledPair]]:
    """The first pairs in which something changed, and the first in which nothing did, so many of each."""
    wanted = {False: job.changed, True: job.unchanged}
    for seed in itertools.count(job.first_seed, STEP):
        if not any(wanted.values()):
            return
        (source,) = training_sources(job.family, [seed])
        pair = source.load()
        if wanted[pair.unchanged]:
            wanted[pair.unchanged] -= 1
            yield f"seed {seed}", pair


def _scores(pair: LabelledPair, job: Job, there: Found | None) -> OfPair:
    if isinstance(there, str):
        raise RuntimeError(f"{job.against}: {there}")
    config = DetectionConfig(verdict=str(job.verdict))
    found: OfPair = {}
    with warnings.catch_warnings():
        # Registrations in doubt, and candidates unlike those of all other families.
        warnings.simplefilter("ignore", InputWarning)
        for poses in POSES:
            of_poses = pair if poses == "given" else _without_poses(pair)
            own = detector("joint", config)(of_poses)
            scores = score_labelled_pair(pair, own.labels_before, own.labels_after, own.moved)
            found[f"{LEARNED}, poses {poses}"] = {"": scores}
        if job.peers:
            for name, setting, scores in _of_peers(pair, config):
                found.setdefault(name, {})[setting] = scores
    for poses, labels in (there or {}).items():
        found[f"{OTHER}, poses {poses}"] = {"": score_labelled_pair(pair, *labels)}
    return found


def _of_peers(pair: LabelledPair, config: DetectionConfig) -> Iterator[tuple[str, str, Scores]]:
    """The scores of all settings of the peers: alone, and with the evidence that ours has."""
    scans = registered(pair)
    judge = JointDetector(dataclasses.replace(config, registration="never"))
    blind = scans.map(lambda scan: Scan(scan.cloud))
    judges: dict[str, Judge] = {
        f"evidence, poses {poses}": judge.evidence_on(own) for poses, own in zip(POSES, (blind, scans), strict=True)
    }
    yield from peer_scores(pair, scans, judges)


def _without_poses(pair: LabelledPair) -> LabelledPair:
    clouds = Pair(pair.before, pair.after).map(lambda cloud: dataclasses.replace(cloud, views=None))
    return LabelledPair(pair.name, *clouds)
