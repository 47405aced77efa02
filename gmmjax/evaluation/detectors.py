"""Every detector that can be scored, ours and the peers, by its name."""

import dataclasses
from collections.abc import Callable
from typing import cast

from gmmjax.changes import (
    DETECTORS,
    AbstractDetector,
    DetectionConfig,
    EvidenceFilter,
    JointDetector,
    Progress,
    Scan,
    silent,
)
from gmmjax.changes import Detection as Detection
from gmmjax.comparison import Method
from gmmjax.errors import check_choice
from gmmjax.evaluation.detector_names import NAMES, WITH_EVIDENCE, WITHOUT_EVIDENCE, Name
from gmmjax.evaluation.labelled_pair import LabelledPair
from gmmjax.evaluation.peers import PEERS, coordinates, has_m3c2
from gmmjax.pair import Pair, each

Detector = Callable[[LabelledPair], Detection]
"""From a pair to what is found in it."""


@dataclasses.dataclass(frozen=True)
class EvidenceDetector(AbstractDetector):
    """A detector without those of its segments that the classifier of "joint" rejects, by the facts of its candidates.

    The clouds are taken as they are, without registration. Clouds that fill volumes hide nothing: all segments stay.

    Attributes:
        detector: without the test.
    """

    detector: AbstractDetector

    def detect(self, scans: Pair[Scan], report: Progress = silent) -> Detection:
        """Detect changes where the other survey looked."""
        found = self.detector.detect(scans, report)
        views = scans.map(lambda scan: scan.views)
        joint = JointDetector(DetectionConfig(registration="never", kinds="both"))
        labels = Pair(found.labels_before, found.labels_after)
        evidence = EvidenceFilter.of(joint, each(Scan, coordinates(scans), views))
        return Detection(*evidence.supported(labels))


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
    found = PEERS[bare] if bare in PEERS else _ours(bare, config)
    return on_pairs(EvidenceDetector(found) if name.endswith(WITH_EVIDENCE) else found)


def on_pairs(detector: AbstractDetector) -> Detector:
    """The detector as a function of a labelled pair, whose truth it does not look at."""
    return lambda pair: detector.detect(
        Pair(Scan(pair.before.points, pair.before.views), Scan(pair.after.points, pair.after.views))
    )


def available(*, evidence: bool = True) -> tuple[Name, ...]:
    """The names of the detectors that can run here, those of M3C2 with py4dgeo only.

    Args:
        evidence: also those that differ by the evidence test, which does nothing for clouds that fill volumes.
    """
    runnable = (name for name in NAMES if has_m3c2() or not name.startswith("m3c2"))
    return tuple(name for name in runnable if evidence or not name.endswith((WITH_EVIDENCE, WITHOUT_EVIDENCE)))


def _ours(method: str, config: DetectionConfig) -> AbstractDetector:
    return DETECTORS[method](dataclasses.replace(config, method=cast(Method, method)))
