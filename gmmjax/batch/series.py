"""A series: many epochs of one place, each compared with its predecessor."""

import itertools
from collections.abc import Generator, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gmmjax.batch.detect_many import BatchResult, detect_many
from gmmjax.batch.manifest import Entry, read_lines
from gmmjax.batch.run_folder import RunFolder, RunRecord
from gmmjax.batch.scan_pair import LONGEST_NAME, BatchPair, check_name
from gmmjax.changes import DetectionConfig
from gmmjax.errors import InputError, shown

REQUIRED = ("name", "cloud")


class Epoch(NamedTuple):
    """A survey of a series.

    Attributes:
        name: of the epoch, such as a date.
        cloud: the file of its cloud.
        views: where the sensor stood; None: what the cloud's file says, or not known.
        config: settings of its comparison with an earlier epoch; None: those of the run.
    """

    name: str
    cloud: Path
    views: Path | None = None
    config: DetectionConfig | None = None

    def files(self) -> dict[str, Path]:
        """The files that it is made of, by what they are to it."""
        return {"cloud": self.cloud, **({} if self.views is None else {"views": self.views})}


def read_epochs(path: Path, config: DetectionConfig = DetectionConfig()) -> list[Epoch]:
    """The epochs of a series in the order of time: CSV or TSV.

    Columns: "name" and "cloud"; where wanted "views", "config" (a TOML file), and any setting of `DetectionConfig` by
    its name. Paths are relative to the file.

    Args:
        path: of the manifest.
        config: what an epoch's own settings are in place of.

    Raises:
        InputError: as `read_manifest`; a single epoch.
    """
    epochs = read_lines(path, REQUIRED, ("views",), lambda entry: _epoch(entry, config))
    if len(epochs) < 2:
        raise InputError(f"{path}: has a single epoch; a series needs two at least")
    return epochs


def detect_series(epochs: Sequence[Epoch], *, out: Path, **options: Any) -> Generator[BatchResult, None, None]:
    """Compares each epoch of a series with the one before.

    Where an epoch cannot be compared with its predecessor, because that one cannot be read, it is compared with the
    latest one before that can be.

    Args:
        epochs: in the order of time.
        out: folder of the run.
        options: of `detect_many`.

    Yields:
        A result for each pair, as it is done.

    Raises:
        InputError, ComputationError: as `detect_many`.
    """
    names = [epoch.name for epoch in epochs]
    pairs = {pair_name(names, pair): pair for pair in itertools.pairwise(range(len(epochs)))}
    done = []
    for result in _results(epochs, pairs, pairs, out, options):
        if result.done:
            done.append(pairs[result.name])
        yield result
    if bridges := {pair_name(names, pair): pair for pair in _bridges(len(epochs), done)}:
        yield from _results(epochs, bridges, {**pairs, **bridges}, out, options)


def _results(
    epochs: Sequence[Epoch],
    pairs: Mapping[str, tuple[int, int]],
    known: Iterable[str],
    out: Path,
    options: Mapping[str, Any],
) -> Generator[BatchResult, None, None]:
    """The results of some pairs of a run that has all that are known."""
    config = options.get("config") or DetectionConfig()
    names = tuple(epoch.name for epoch in epochs)
    record = RunRecord.of(list(known), config, series="previous", epochs=names)
    chosen = [_batch_pair(name, *(epochs[index] for index in pair)) for name, pair in pairs.items()]
    yield from detect_many(chosen, out=out, record=record, **options)


def compared_epochs(folder: RunFolder) -> Mapping[tuple[int, int], str]:
    """The pairs of a series that are done: by the indices of their epochs, the earlier one first, the name.

    Each epoch is the earlier and the later one of one pair at most.

    Raises:
        InputError: a folder without a series.
    """
    record = folder.run_record()
    if record is None or record.series is None:
        raise InputError(f"{folder.path}: holds no series; give the folder of a run with --series")
    known = set(record.names)
    found: dict[int, tuple[tuple[int, int], str]] = {}
    for pair in itertools.combinations(range(len(record.epochs)), 2):
        name = pair_name(record.epochs, pair)
        if name in known and folder.failed(name) is None and folder.result(name) is not None:
            # The closest one counts: a bridge is not needed any more once its gap is closed.
            found[pair[1]] = (pair, name)
    closest = {pair[0]: (pair, name) for pair, name in sorted(found.values(), reverse=True)}
    return dict(sorted(closest.values()))


def pair_name(names: Sequence[str], pair: tuple[int, int]) -> str:
    """The name of the comparison of two epochs."""
    return f"{names[pair[0]]} to {names[pair[1]]}"


def _bridges(count: int, done: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Comparisons over epochs that cannot be read: of those whose predecessor, too, is not connected."""
    connected = {0, *(epoch for pair in done for epoch in pair)}
    later = {pair[1] for pair in done}
    bridges = []
    for epoch in range(2, count):
        earlier = max(other for other in connected if other < epoch)
        if epoch not in later and earlier < epoch - 1:
            bridges.append((earlier, epoch))
    return bridges


def _batch_pair(name: str, before: Epoch, after: Epoch) -> BatchPair:
    return BatchPair(name, before.cloud, after.cloud, before.views, after.views, after.config)


def _epoch(entry: Entry, config: DetectionConfig) -> Epoch:
    name, cloud = entry.values["name"], entry.folder / entry.values["cloud"]
    check_name(name, f"{entry.place}: name")
    if len(name.encode()) > LONGEST_NAME // 2 - len(" to "):
        raise InputError(f"{entry.place}: name={shown(name)} is too long; folders are named after two epochs")
    return Epoch(name, cloud, entry.file("views"), entry.settings(config))
