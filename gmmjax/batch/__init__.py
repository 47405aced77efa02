"""Many pairs of scans: runs that survive interruptions, over processes or a cluster."""

from gmmjax.batch.detect_many import BatchResult as BatchResult
from gmmjax.batch.detect_many import detect_many as detect_many
from gmmjax.batch.manifest import pairs_in_folders as pairs_in_folders
from gmmjax.batch.manifest import read_manifest as read_manifest
from gmmjax.batch.pair_record import PairRecord as PairRecord
from gmmjax.batch.pools import AbstractPool as AbstractPool
from gmmjax.batch.rows import ChangeRow as ChangeRow
from gmmjax.batch.rows import PairRow as PairRow
from gmmjax.batch.rows import PairStatus as PairStatus
from gmmjax.batch.run_folder import RUN_FILE as RUN_FILE
from gmmjax.batch.run_folder import RunFolder as RunFolder
from gmmjax.batch.run_folder import RunRecord as RunRecord
from gmmjax.batch.run_folder import Shard as Shard
from gmmjax.batch.run_folder import run_folder as run_folder
from gmmjax.batch.scan_pair import BatchPair as BatchPair
from gmmjax.batch.scan_pair import LoadedPair as LoadedPair
from gmmjax.batch.tables import write_table as write_table
from gmmjax.batch.tables import write_tables as write_tables
from gmmjax.batch.worker import FoundPair as FoundPair
from gmmjax.batch.worker import Save as Save
from gmmjax.batch.worker import save_changes as save_changes
