"""Changes by partial transport: the Gaussians' points that it leaves unmatched."""

import dataclasses
from typing import ClassVar

from gmmjax.changes.detectors.separate import AbstractSeparateDetector
from gmmjax.comparison import Method


@dataclasses.dataclass(frozen=True)
class TransportDetector(AbstractSeparateDetector):
    """Every pair of restarts by partial transport of point counts."""

    method: ClassVar[Method] = "transport"
