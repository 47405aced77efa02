"""From two clouds to changes: the stages of detection, the detectors, the records."""

from gmmjax.changes.change import Box as Box
from gmmjax.changes.change import Change as Change
from gmmjax.changes.change import Changes as Changes
from gmmjax.changes.config import METHODS as METHODS
from gmmjax.changes.config import DetectionConfig as DetectionConfig
from gmmjax.changes.detect import detect_changes as detect_changes
from gmmjax.changes.detectors import DETECTORS as DETECTORS
from gmmjax.changes.detectors import AbstractChangeDetector as AbstractChangeDetector
from gmmjax.changes.detectors import AbstractDetector as AbstractDetector
from gmmjax.changes.detectors import Detection as Detection
from gmmjax.changes.detectors import GreedyDetector as GreedyDetector
from gmmjax.changes.detectors import JointDetector as JointDetector
from gmmjax.changes.detectors import Scan as Scan
from gmmjax.changes.detectors import TransportDetector as TransportDetector
from gmmjax.changes.detectors.greedy_removal import Removals as Removals
from gmmjax.changes.detectors.greedy_removal import remove_changed as remove_changed
from gmmjax.changes.detectors.unmatched_mass import Unmatched as Unmatched
from gmmjax.changes.detectors.unmatched_mass import unmatched_shares as unmatched_shares
