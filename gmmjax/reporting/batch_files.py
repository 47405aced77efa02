"""Files of a batch run: those of each pair, the summary of all, and the page to look at them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from gmmjax.batch import (
    OBJECT_COLUMNS,
    ChangeRow,
    Comparison,
    FoundPair,
    ObjectHistory,
    PairRow,
    RunFolder,
    compared_epochs,
    object_histories,
    object_rows,
    write_file,
    write_table,
)
from gmmjax.changes import Changes
from gmmjax.clouds import read_cloud
from gmmjax.pair import Pair
from gmmjax.reporting.batch_index import batch_index_html
from gmmjax.reporting.pictures import write_thumbnails
from gmmjax.reporting.result_folder import write_result_files
from gmmjax.reporting.timeline_page import timeline_html

INDEX_FILE = "index.html"
TIMELINE_FILE = "timeline.html"


@dataclasses.dataclass(frozen=True)
class Summary:
    """A run as far as it has got.

    Attributes:
        pairs: the rows of the pairs that are done or failed, in their order in the manifest.
        changes: the rows of all changes.
        missing: names of the pairs that are neither done nor failed.
    """

    pairs: tuple[PairRow, ...]
    changes: tuple[ChangeRow, ...]
    missing: tuple[str, ...]

    @property
    def failed(self) -> tuple[PairRow, ...]:
        """The rows of the pairs that failed."""
        return tuple(row for row in self.pairs if row.status == "failed")

    @property
    def done(self) -> tuple[PairRow, ...]:
        """The rows of the pairs that are done."""
        return tuple(row for row in self.pairs if row.status == "done")


def save_report(folder: Path, found: FoundPair, *, transform_after: bool = False) -> None:
    """Write what `detect` writes, and thumbnails.

    Args:
        folder: to write to.
        found: what was found in a pair.
        transform_after: as of `write_result`.

    Raises:
        InputError, OSError: a file cannot be written.
    """
    changes, clouds = found.consensus.changes, found.clouds
    write_result_files(folder, clouds.before, clouds.after, changes, transform_after=transform_after)
    write_thumbnails(folder, clouds, changes)


def save_transformed_report(folder: Path, found: FoundPair) -> None:
    """Write what `save_report` writes, with the after scan in the frame of the before scan."""
    save_report(folder, found, transform_after=True)


def summary_of(folder: RunFolder, names: Sequence[str]) -> Summary:
    """Gather the rows of a run with these pairs, from what lies in its folder."""
    pairs: list[PairRow] = []
    changes: list[ChangeRow] = []
    missing = []
    for name in names:
        failed, record = folder.failed(name), folder.result(name)
        if failed is not None:
            pairs.append(failed)
        elif record is not None:
            pairs.append(record.pair)
            changes.extend(record.changes)
        else:
            missing.append(name)
    return Summary(tuple(pairs), tuple(changes), tuple(missing))


def write_summary(folder: RunFolder, names: Sequence[str]) -> Summary:
    """Write the tables and the page of a run, as far as it has got.

    Args:
        folder: of the run.
        names: of all its pairs.

    Raises:
        InputError: a file cannot be written.
    """
    summary = summary_of(folder, names)
    for name, kind, rows in (("pairs", PairRow, summary.pairs), ("changes", ChangeRow, summary.changes)):
        columns = [field.name for field in dataclasses.fields(kind)]
        write_table(folder.path / f"{name}.csv", columns, map(vars, rows))
    page = batch_index_html(folder.path.name, summary.pairs, summary.changes, missing=summary.missing)
    write_file(folder.path / INDEX_FILE, page.encode())
    return summary


def write_history(folder: RunFolder) -> list[ObjectHistory]:
    """Write the table and the page of the objects of a series, as far as it has got.

    Args:
        folder: of the run.

    Raises:
        InputError: it is no series, a scan is not there any more, or a file cannot be written.
    """
    record = folder.run_record()
    pairs = compared_epochs(folder)
    assert record is not None
    comparisons = [_comparison(folder, epochs, name) for epochs, name in pairs.items()]
    histories = object_histories(record.epochs, comparisons)
    write_table(folder.path / "objects.csv", OBJECT_COLUMNS, object_rows(histories))
    page = timeline_html(folder.path.name, record.epochs, histories, pairs)
    write_file(folder.path / TIMELINE_FILE, page.encode())
    return histories


def _comparison(folder: RunFolder, epochs: tuple[int, int], name: str) -> Comparison:
    result = folder.result(name)
    assert result is not None and result.pair.before is not None and result.pair.after is not None
    clouds = Pair(read_cloud(result.pair.before), read_cloud(result.pair.after))
    return Comparison.of(*epochs, Changes.load(folder.pair(name)), clouds)
