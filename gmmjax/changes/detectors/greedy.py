"""Changes by Algorithm 1: the Gaussians whose removal brings the mixtures closest together (thesis 2.2.4)."""

import dataclasses
from typing import ClassVar

from gmmjax.changes.detectors.separate import AbstractSeparateDetector
from gmmjax.comparison import Method


@dataclasses.dataclass(frozen=True)
class GreedyDetector(AbstractSeparateDetector):
    """The thesis's detector: every pair of restarts by Algorithm 1."""

    method: ClassVar[Method] = "greedy"
