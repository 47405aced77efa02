"""Many pairs of scans: runs that survive interruptions, over processes or a cluster."""

from gmmjax.batch.comparison import Comparison as Comparison
from gmmjax.batch.comparison import ComparisonSettings as ComparisonSettings
from gmmjax.batch.comparison import Coverage as Coverage
from gmmjax.batch.history import EventKind as EventKind
from gmmjax.batch.history import ObjectEvent as ObjectEvent
from gmmjax.batch.history import ObjectHistory as ObjectHistory
from gmmjax.batch.history import epoch_trees as epoch_trees
from gmmjax.batch.history import object_histories as object_histories
from gmmjax.batch.history import object_rows as object_rows
from gmmjax.batch.linking import HistorySettings as HistorySettings
from gmmjax.batch.rows import ChangeRow as ChangeRow
from gmmjax.batch.rows import ObjectRow as ObjectRow
from gmmjax.batch.rows import PairRow as PairRow
from gmmjax.batch.rows import PairStatus as PairStatus
from gmmjax.batch.tracks import EpochTree as EpochTree
