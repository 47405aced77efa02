"""Many pairs of scans: runs that survive interruptions, over processes or a cluster."""

from gmmjax.batch.rows import ChangeRow as ChangeRow
from gmmjax.batch.rows import PairRow as PairRow
from gmmjax.batch.rows import PairStatus as PairStatus
