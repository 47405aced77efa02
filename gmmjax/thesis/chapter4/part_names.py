"""The names of the parts of the chapter."""

from typing import Literal, get_args

PartName = Literal["grid", "clustering", "filtering", "gaussians", "surveys"]
# In the order of the chapter.
PARTS: tuple[PartName, ...] = get_args(PartName)
