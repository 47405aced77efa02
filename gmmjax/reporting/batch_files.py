"""What a batch run writes: the files of each pair, the summary of all, and the page to look at them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from gmmjax.batch import ChangeRow, FoundPair, PairRow, RunFolder, write_tables
from gmmjax.clouds import atomic_write
from gmmjax.errors import InputError
from gmmjax.reporting.batch_index import batch_index_html
from gmmjax.reporting.result_folder import write_result_files
from gmmjax.reporting.thumbnails import write_thumbnails

INDEX_FILE = "index.html"


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


def save_report(folder: Path, found: FoundPair) -> None:
    """Writes what `detect` writes, and thumbnails.

    Args:
        folder: to write to.
        found: what was found in a pair.

    Raises:
        InputError, OSError: a file cannot be written.
    """
    changes, clouds = found.consensus.changes, found.loaded.clouds
    write_result_files(folder, clouds.before, clouds.after, changes)
    write_thumbnails(folder, clouds, changes)


def summary_of(folder: RunFolder, names: Sequence[str]) -> Summary:
    """The rows of a run, from what lies in its folder.

    Args:
        folder: of the run.
        names: of all its pairs.
    """
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
    """Writes the tables and the page of a run, as far as it has got.

    Args:
        folder: of the run.
        names: of all its pairs.

    Raises:
        InputError: a file cannot be written.
    """
    summary = summary_of(folder, names)
    write_tables(folder.path, summary.pairs, summary.changes)
    page = batch_index_html(folder.path.name, summary.pairs, summary.changes, missing=summary.missing)
    path = folder.path / INDEX_FILE
    try:
        with atomic_write(path) as file:
            file.write(page.encode())
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); free some space") from error
    return summary
