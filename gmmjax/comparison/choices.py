"""Names of the methods and solvers of a comparison."""

from typing import Literal

Method = Literal["joint", "greedy", "transport"]
Kinds = Literal["both", "appeared", "disappeared"]
Solver = Literal["exact", "sinkhorn"]
