"""The peers over a coarse series of settings, without our evidence and with it: what their best setting is found by."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from gmmjax.changes import Scan, aligned
from gmmjax.evaluation import LabelledPair, Scores, score_labelled_pair
from gmmjax.evaluation.peers import (
    AbstractPeer,
    CloudToCloudDetector,
    M3C2Detector,
    VoxelDetector,
    has_m3c2,
)
from gmmjax.pair import Pair, each

Judge: TypeAlias = Callable[[Pair[np.ndarray]], Pair[np.ndarray]]
"""From the segments of both clouds to what the evidence leaves of them."""


class Series(NamedTuple):
    """A peer with some settings that differ only in what comes after its measurement.

    Attributes:
        name: of the peer.
        peers: what is set, and the detector.
    """

    name: str
    peers: Mapping[str, AbstractPeer]


def series() -> Iterator[Series]:
    """The settings that the best one is looked for in; lengths in reaches, the clusters' radius in spacings."""
    radii = (3.0, 5.0)
    of_c2c = itertools.product((1.5, 2.0, 3.0, 4.5, 6.0, 9.0), radii)
    yield Series(
        "c2c",
        {
            f"distance {distance:g}, radius {radius:g}": CloudToCloudDetector(cluster_radius=radius, distance=distance)
            for distance, radius in of_c2c
        },
    )
    for leaf in (3.0, 4.0, 7.0, 10.0, 15.0):
        yield Series(
            "voxels",
            {f"leaf {leaf:g}, radius {radius:g}": VoxelDetector(cluster_radius=radius, leaf=leaf) for radius in radii},
        )
    if not has_m3c2():
        return
    for cylinder, normals in ((2.0, 3.0), (3.0, 5.0), (6.0, 9.0)):
        yield Series(
            "m3c2",
            {
                f"cylinder {cylinder:g}, normals {normals:g}, registration {registration:g}": M3C2Detector(
                    cylinder=cylinder, normals=normals, registration=registration
                )
                for registration in (1.5, 3.0, 5.0)
            },
        )


def registered(pair: LabelledPair) -> Pair[Scan]:
    """The scans in one frame, as ours are: the after cloud and its views in that of the before cloud."""
    found = aligned(Pair(pair.before.points, pair.after.points))
    views = Pair(pair.before.views, pair.after.views)
    if views.after is not None and found.registration.applied:
        views = Pair(views.before, views.after.moved(found.registration.transform))
    return each(Scan, found.points, views)


def peer_scores(
    pair: LabelledPair, scans: Pair[Scan], judges: Mapping[str, Judge]
) -> Iterator[tuple[str, str, Scores]]:
    """The scores of every setting of every peer, as it is and judged by the evidence.

    Args:
        pair: with the truth.
        scans: of the pair, registered.
        judges: by what follows "+" in the name of a peer whose segments they judge.

    Yields:
        Name, setting and scores.
    """
    judged: dict[tuple[str, bytes], Pair[np.ndarray]] = {}
    for name, text, labels in _found(scans):
        yield name, text, score_labelled_pair(pair, *labels)
        same = b"".join(own.tobytes() for own in labels)
        for suffix, judge in judges.items():
            # Settings that find the same are judged once.
            if (suffix, same) not in judged:
                judged[suffix, same] = judge(labels)
            yield f"{name}+{suffix}", text, score_labelled_pair(pair, *judged[suffix, same])


def _found(scans: Pair[Scan]) -> Iterator[tuple[str, str, Pair[np.ndarray]]]:
    """The segments of every setting; what several settings measure is measured once."""
    compared = CloudToCloudDetector().compared(scans)
    for name, peers in series():
        measured = next(iter(peers.values())).measured(compared)
        for text, peer in peers.items():
            found = peer.segments(compared, measured)
            yield name, text, Pair(found.labels_before, found.labels_after)
