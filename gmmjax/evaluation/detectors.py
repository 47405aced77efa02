"""Every detector that can be scored, ours and the peers, by its name."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Literal, NamedTuple, cast, get_args

import numpy as np
from jaxtyping import Int

from gmmjax.changes import Changes, DetectionConfig, detect_changes
from gmmjax.changes.config import Method
from gmmjax.errors import check_choice
from gmmjax.evaluation.evidence import without_unobserved
from gmmjax.evaluation.labelled_pair import LabelledPair
from gmmjax.evaluation.peers import PEERS, Candidates, has_m3c2, peer_labels

# After the name of a detector: its segments are put to the evidence test of "joint", which has it built in and can
# leave it out.
WITH_EVIDENCE, WITHOUT_EVIDENCE = "+evidence", "-no-evidence"
Name = Literal[
    "joint",
    "joint-no-evidence",
    "greedy",
    "greedy+evidence",
    "transport",
    "transport+evidence",
    "c2c",
    "c2c+evidence",
    "voxels",
    "voxels+evidence",
    "m3c2",
    "m3c2+evidence",
]
NAMES: tuple[Name, ...] = get_args(Name)


class Detection(NamedTuple):
    """What a detector found in a pair.

    Attributes:
        labels_before: per point -1 or the number of a change.
        labels_after: the same for the after cloud.
        moved: changes of the before and of the after cloud that are reported as one object.
        changes: the full record, of our detectors.
    """

    labels_before: Int[np.ndarray, " n0"]
    labels_after: Int[np.ndarray, " n1"]
    moved: tuple[tuple[int, int], ...] = ()
    changes: Changes | None = None


Detector = Callable[[LabelledPair], Detection]


def detector(name: str, config: DetectionConfig = DetectionConfig()) -> Detector:
    """The detector of a name.

    Args:
        name: one of `NAMES`.
        config: settings of ours, but for the method; the peers have none.

    Raises:
        InputError: an unknown name.
    """
    check_choice("method", name, NAMES)
    if name.endswith(WITHOUT_EVIDENCE):
        config = dataclasses.replace(config, evidence=False)
    bare = name.removesuffix(WITH_EVIDENCE).removesuffix(WITHOUT_EVIDENCE)
    if bare in PEERS:
        found: Detector = functools.partial(_peer, PEERS[bare])
    else:
        found = functools.partial(_ours, cast(Method, bare), config)
    return functools.partial(_with_evidence, found) if name.endswith(WITH_EVIDENCE) else found


def available(*, evidence: bool = True) -> tuple[Name, ...]:
    """The names of the detectors that can run here, those of M3C2 with py4dgeo only.

    Args:
        evidence: also those that differ by the evidence test, which does nothing for clouds that fill volumes.
    """
    runnable = (name for name in NAMES if has_m3c2() or not name.startswith("m3c2"))
    return tuple(name for name in runnable if evidence or not name.endswith((WITH_EVIDENCE, WITHOUT_EVIDENCE)))


def _ours(method: Method, config: DetectionConfig, pair: LabelledPair) -> Detection:
    before, after = pair.before, pair.after
    changes = detect_changes(
        before.points,
        after.points,
        method=method,
        config=config,
        views_before=before.views,
        views_after=after.views,
    )
    return Detection(changes.labels_before, changes.labels_after, _moved(changes), changes)


def _moved(changes: Changes) -> tuple[tuple[int, int], ...]:
    """The moved changes of the before cloud, each with its partner in the after cloud."""
    moved = [index for index, change in enumerate(changes.items) if change.kind == "moved"]
    gone = [index for index in moved if (changes.labels_before == index).any()]
    return tuple((index, partner) for index in gone if (partner := changes.items[index].partner) is not None)


def _peer(candidates: Candidates, pair: LabelledPair) -> Detection:
    return Detection(*peer_labels(candidates, pair.before.points, pair.after.points))


def _with_evidence(found: Detector, pair: LabelledPair) -> Detection:
    detection = found(pair)
    return Detection(*without_unobserved(pair, detection.labels_before, detection.labels_after))
