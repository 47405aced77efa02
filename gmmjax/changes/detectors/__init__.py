"""The detectors: the joint mixture, and the thesis's two.

A new one is a module here, and its name and class in `gmmjax/changes/config.py`.
"""

import pkgutil
from collections.abc import Mapping

from gmmjax.changes.config import DETECTOR_CLASSES
from gmmjax.changes.detectors.aligned_scans import AlignedScans as AlignedScans
from gmmjax.changes.detectors.aligned_scans import Measured as Measured
from gmmjax.changes.detectors.detector import AbstractChangeDetector as AbstractChangeDetector
from gmmjax.changes.detectors.detector import AbstractDetector as AbstractDetector
from gmmjax.changes.detectors.detector import Detection as Detection
from gmmjax.changes.detectors.detector import Scan as Scan
from gmmjax.changes.detectors.joint import JointDetector as JointDetector
from gmmjax.changes.detectors.recognised_views import with_recognised_views as with_recognised_views
from gmmjax.changes.detectors.restart_detector import AbstractRestartDetector as AbstractRestartDetector
from gmmjax.changes.detectors.separate import GreedyDetector as GreedyDetector
from gmmjax.changes.detectors.separate import TransportDetector as TransportDetector

DETECTORS: Mapping[str, type[AbstractChangeDetector]] = {
    method: pkgutil.resolve_name(place) for method, place in DETECTOR_CLASSES.items()
}
