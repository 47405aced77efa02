"""Chapter 4 of the thesis: its figures and tables from data of the same kinds, beside its published numbers."""

from typing import Literal, get_args

PartName = Literal["clustering", "filtering", "gaussians", "surveys"]
# In the order of the chapter.
PARTS: tuple[PartName, ...] = get_args(PartName)
