"""What two clouds are compared for, and by which method and solver."""

from typing import Literal

Method = Literal["joint", "greedy", "transport"]
Kinds = Literal["both", "appeared", "disappeared"]
Solver = Literal["exact", "sinkhorn"]
