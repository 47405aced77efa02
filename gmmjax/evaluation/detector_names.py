"""The names of the detectors that can be scored."""

from typing import Literal, get_args

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
