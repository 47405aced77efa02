"""The peers at their best: for each kind of scene the setting, of a coarse series, that suits it best."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gmmjax.changes import DetectionConfig, JointDetector, Scan, aligned
from gmmjax.evaluation import LabelledPair, PairSource, Scores, score_labelled_pair
from gmmjax.evaluation.peers import (
    AbstractPeer,
    CloudToCloudDetector,
    M3C2Detector,
    VoxelDetector,
    has_m3c2,
)
from gmmjax.pair import Pair, each
from tests.benchmarks.held_out.kinds import CHANGED
from tests.benchmarks.held_out.table import Line


class Setting(NamedTuple):
    """A peer with a setting.

    Attributes:
        name: of the peer.
        peer: the detector.
        text: what is set.
    """

    name: str
    peer: AbstractPeer
    text: str


def settings() -> Iterator[Setting]:
    """The series that the best one is looked for in; lengths in reaches, the clusters' radius in spacings."""
    for distance, radius in itertools.product((2.0, 3.0, 4.5, 6.0, 9.0), (3.0, 5.0)):
        peer = CloudToCloudDetector(cluster_radius=radius, distance=distance)
        yield Setting("c2c", peer, f"distance {distance:g}, radius {radius:g}")
    for leaf, radius in itertools.product((4.0, 7.0, 10.0, 15.0), (3.0, 5.0)):
        yield Setting("voxels", VoxelDetector(cluster_radius=radius, leaf=leaf), f"leaf {leaf:g}, radius {radius:g}")
    if not has_m3c2():
        return
    for (cylinder, normals), registration in itertools.product(((2.0, 3.0), (3.0, 5.0), (6.0, 9.0)), (1.5, 5.0)):
        peer = M3C2Detector(cylinder=cylinder, normals=normals, registration=registration)
        yield Setting("m3c2", peer, f"cylinder {cylinder:g}, normals {normals:g}, registration {registration:g}")


def best_peers(sources: Sequence[PairSource]) -> tuple[list[Line], list[str]]:
    """Each peer, with our evidence and without it, at the setting that is best on these very pairs.

    The clouds are registered as ours are, so that what is compared is how changes are found.

    Args:
        sources: pairs of one group.

    Returns:
        A line for each peer, and what failed: those pairs are left out.
    """
    lines: dict[tuple[str, str], Line] = {}
    failures = []
    for source in sources:
        try:
            scored = list(_scored(source.load()))
        # Whatever is wrong with this pair, there are the others.
        except Exception as error:
            failures.append(f"{source.label}, peers: {type(error).__name__}: {error}")
            continue
        for name, text, scores in scored:
            line = lines.get((name, text)) or Line(source.group, f"{name}: {text}", Scores(), Scores())
            field = "changed" if source.condition == CHANGED else "unchanged"
            lines[name, text] = dataclasses.replace(line, **{field: getattr(line, field) + scores})
    names = dict.fromkeys(name for name, _ in lines)
    of_name = ([line for (own, _), line in lines.items() if own == name] for name in names)
    return [max(own, key=lambda line: line.goodness) for own in of_name], failures


def _scored(pair: LabelledPair) -> Iterator[tuple[str, str, Scores]]:
    """The scores of all settings, without evidence and with it."""
    scans = _registered(pair)
    evident = JointDetector(DetectionConfig(registration="never")).evidence_on(scans)
    judged: dict[bytes, Pair[np.ndarray]] = {}
    for setting in settings():
        found = setting.peer.detect(scans)
        labels = Pair(found.labels_before, found.labels_after)
        yield setting.name, setting.text, score_labelled_pair(pair, *labels)
        key = b"".join(own.tobytes() for own in labels)
        # Settings that find the same are judged once.
        if key not in judged:
            judged[key] = evident(labels)
        yield f"{setting.name}+evidence", setting.text, score_labelled_pair(pair, *judged[key])


def _registered(pair: LabelledPair) -> Pair[Scan]:
    found = aligned(Pair(pair.before.points, pair.after.points))
    views = Pair(pair.before.views, pair.after.views)
    if views.after is not None and found.registration.applied:
        views = Pair(views.before, views.after.moved(found.registration.transform))
    return each(Scan, found.points, views)
