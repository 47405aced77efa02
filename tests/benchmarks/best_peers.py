"""The peers over a coarse series of settings, alone and judged by our evidence: what their best is found by."""

import itertools
from collections.abc import Iterator

import numpy as np

from gmmjax.changes import DetectionConfig, EvidenceFilter, JointDetector, Scan, aligned
from gmmjax.evaluation import LabelledPair
from gmmjax.evaluation.peers import AbstractPeer, CloudToCloudDetector, M3C2Detector, VoxelDetector, has_m3c2
from gmmjax.pair import Pair, each

Found = Iterator[tuple[str, Pair[np.ndarray]]]
RADII = (3.0, 5.0)


def series() -> Iterator[tuple[str, dict[str, AbstractPeer]]]:
    """Peers whose settings differ only in what comes after their measurement; lengths in median distances."""
    yield (
        "c2c",
        {
            f"distance {distance:g}, radius {radius:g}": CloudToCloudDetector(cluster_radius=radius, distance=distance)
            for distance, radius in itertools.product((1.5, 2.0, 3.0, 4.5, 6.0, 9.0), RADII)
        },
    )
    for leaf in (3.0, 4.0, 7.0, 10.0, 15.0):
        yield (
            "voxels",
            {f"leaf {leaf:g}, radius {radius:g}": VoxelDetector(cluster_radius=radius, leaf=leaf) for radius in RADII},
        )
    if not has_m3c2():
        return
    for cylinder, normals in ((2.0, 3.0), (3.0, 5.0), (6.0, 9.0)):
        yield (
            "M3C2",
            {
                f"cylinder {cylinder:g}, registration {registration:g}": M3C2Detector(
                    cylinder=cylinder, normals=normals, registration=registration
                )
                for registration in (1.5, 3.0, 5.0)
            },
        )


def peer_labels(pair: LabelledPair, config: DetectionConfig) -> Found:
    """The labels that every setting of every peer gives, after "name: setting"; those of "name + evidence", too.

    The clouds are registered as ours are, so that what is compared is how changes are found.
    """
    scans = _registered(pair)
    judge = EvidenceFilter.of(JointDetector(config), scans).supported
    compared, judged = CloudToCloudDetector().compared(scans), {}
    for name, peers in series():
        measured = next(iter(peers.values())).measured(compared)
        for text, peer in peers.items():
            found = peer.segments(compared, measured)
            labels = Pair(found.labels_before, found.labels_after)
            yield f"{name}: {text}", labels
            # Settings that find the same are judged once.
            same = b"".join(own.tobytes() for own in labels)
            judged[same] = judged[same] if same in judged else judge(labels)
            yield f"{name} + evidence: {text}", judged[same]


def _registered(pair: LabelledPair) -> Pair[Scan]:
    found = aligned(Pair(pair.before.points, pair.after.points))
    views = Pair(pair.before.views, pair.after.views)
    if views.after is not None and found.registration.applied:
        views = Pair(views.before, views.after.moved(found.registration.transform))
    return each(Scan, found.points, views)
