"""Pairs of clouds whose changes are known, from folders or from memory."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.clouds import READERS, PointCloud, SensorViews, load_arrays, read_cloud, read_views, require_file
from gmmjax.errors import InputError

VIEWS_ENDINGS = (".json", ".npz")


@dataclasses.dataclass(frozen=True, eq=False)
class LabelledCloud:
    """One cloud of a pair, with the truth.

    Attributes:
        points: coordinates, finite, in any unit.
        truth: per point -1 unchanged, else the id of its change; the same id in both clouds is one object that moved.
        unseen: per point whether the other survey could not see its place; None: not known.
        views: where the sensor stood; None: not known.
        not_counted: ids of changes that nobody can be asked to find, such as of objects that the other survey could not
            see.
        things: per point the number of what it belongs to: a Gaussian, an object, a wall; negative for points that
            belong to none. None: not known. The true negatives of `gmmjax.thesis` are counted in them.
    """

    points: Float[np.ndarray, "n 3"]
    truth: Int[np.ndarray, " n"]
    unseen: Bool[np.ndarray, " n"] | None = None
    views: SensorViews | None = None
    not_counted: frozenset[int] = frozenset()
    things: Int[np.ndarray, " n"] | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class LabelledPair:
    """Two clouds whose changes are known.

    Attributes:
        name: of the pair.
        before: the cloud at the first time.
        after: the cloud at the later time, in the same unit and about the same frame.
    """

    name: str
    before: LabelledCloud
    after: LabelledCloud

    @property
    def unchanged(self) -> bool:
        """True where nothing changed."""
        return bool((self.before.truth < 0).all() and (self.after.truth < 0).all())

    def without_views(self) -> "LabelledPair":
        """The pair where nobody knows where the sensor stood."""
        before, after = (dataclasses.replace(cloud, views=None) for cloud in (self.before, self.after))
        return dataclasses.replace(self, before=before, after=after)


@dataclasses.dataclass(frozen=True)
class PairSource:
    """A pair that is read or simulated when it is needed.

    Attributes:
        name: of the pair.
        group: what is summed up together: a kind of scene.
        condition: of the pair in its group, one row of the tables.
        load: gives the pair.
    """

    name: str
    group: str
    condition: str
    load: Callable[[], LabelledPair]

    @property
    def label(self) -> str:
        """The condition and the name, or the name alone where it is its own condition."""
        return self.name if self.name == self.condition else f"{self.condition}, {self.name}"

    def without_views(self) -> "PairSource":
        """The source of the pair where nobody knows where the sensor stood."""
        return dataclasses.replace(self, load=lambda: self.load().without_views())


def find_pairs(folder: Path) -> list[PairSource]:
    """The pairs in the folders of a folder, in the order of their names.

    Each has `before.*` and `after.*` in any format that `read_cloud` takes, `truth_before.npy` and `truth_after.npy`;
    see `read_pair`. Folders without any of these are passed over.

    Args:
        folder: that holds the pairs' folders.

    Returns:
        A source for each pair, read when it is needed; the group is the folder's name, the condition the pair's.

    Raises:
        InputError: no such folder, no pair in it, or a pair that lacks a file.
    """
    pairs = pair_folders(folder)
    for path in pairs:
        for side in ("before", "after"):
            cloud_file(path, side)
            _required(path / f"truth_{side}.npy")
    return [
        PairSource(path.name, folder.resolve().name, path.name, functools.partial(read_pair, path)) for path in pairs
    ]


def pair_folders(folder: Path) -> list[Path]:
    """The folders in a folder that hold a pair or a part of one, in the order of their names.

    Raises:
        InputError: no such folder, or no pair in it.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the folder that holds the pairs' folders")
    pairs = [path for path in sorted(folder.iterdir()) if path.is_dir() and _holds_part_of_a_pair(path)]
    if not pairs:
        hint = (
            "it is a pair itself: give the folder above" if _holds_part_of_a_pair(folder) else "each pair is a folder"
        )
        raise InputError(
            f"{folder}: holds no pairs; {hint} with before.ply, after.ply (or another format), truth_before.npy and "
            "truth_after.npy"
        )
    return pairs


def read_pair(folder: Path) -> LabelledPair:
    """The pair in a folder.

    `before.*` and `after.*` are the clouds. `truth_before.npy` and `truth_after.npy` hold an integer for every row of
    them: -1 unchanged, else the id of the change. Where there are `unseen_before.npy` and `unseen_after.npy`, a bool
    for every row says whether the other survey could not see the place; where there are `views_before.json` and
    `views_after.json` (or .npz), they say where the sensor stood. `not_counted_before.npy` and `not_counted_after.npy`
    may hold the ids of changes that nobody can be asked to find there.

    Args:
        folder: of the pair.

    Raises:
        InputError: files that are missing, cannot be read, or do not fit each other.
    """
    return LabelledPair(folder.name, _read_cloud(folder, "before"), _read_cloud(folder, "after"))


def _read_cloud(folder: Path, side: str) -> LabelledCloud:
    file = cloud_file(folder, side)
    cloud = read_cloud(file)
    truth = _read_rows(_required(folder / f"truth_{side}.npy"), cloud, file, "iu")
    unseen_file = folder / f"unseen_{side}.npy"
    unseen = _read_rows(unseen_file, cloud, file, "b") if unseen_file.is_file() else None
    views = pair_views(folder, side)
    not_counted = _read_ids(folder / f"not_counted_{side}.npy")
    return LabelledCloud(
        cloud.points, truth.astype(np.int64), unseen, cloud.views if views is None else views, not_counted
    )


def _read_ids(path: Path) -> frozenset[int]:
    """The ids of changes in a file; none where there is no file."""
    if not path.is_file():
        return frozenset()
    ids = _load(path)
    if not isinstance(ids, np.ndarray) or ids.ndim != 1 or ids.dtype.kind not in "iu":
        raise InputError(f"{path}: must hold the ids of changes as whole numbers [C]; write it with numpy.save")
    return frozenset(int(number) for number in ids)


def _read_rows(path: Path, cloud: PointCloud, source: Path, kinds: str) -> np.ndarray:
    """One value for each point of the cloud; the file has one for each row of the cloud's file."""
    values = _load(path)
    rows = len(cloud) + cloud.rows_dropped
    if not isinstance(values, np.ndarray) or values.shape != (rows,) or values.dtype.kind not in kinds:
        wanted = "whole numbers (-1 or the id of a change)" if "i" in kinds else "true or false"
        found = f"{values.dtype} {list(values.shape)}" if isinstance(values, np.ndarray) else "an archive"
        raise InputError(f"{path}: must hold {wanted} for each of the {rows} rows of {source.name}, not {found}")
    return values[cloud.rows]


def _load(path: Path) -> np.ndarray | dict[str, np.ndarray]:
    return load_arrays(require_file(path))


def cloud_file(folder: Path, side: str) -> Path:
    """The cloud of one side in a pair's folder.

    Raises:
        InputError: none, or several.
    """
    files = _cloud_files(folder, side)
    if not files:
        raise InputError(f"{folder}: has no {side}.ply (or {side}.* of another format); a pair needs two clouds")
    if len(files) > 1:
        names = ", ".join(path.name for path in files)
        raise InputError(f"{folder}: has several clouds {names}; leave the one that is meant")
    return files[0]


def views_file(folder: Path, side: str) -> Path | None:
    """The views of one side in a pair's folder: `before_views` or `views_before`, .json or .npz; None without one.

    Raises:
        InputError: several.
    """
    names = (f"{side}_views", f"views_{side}")
    files = [path for path in sorted(folder.iterdir()) if path.stem in names and path.suffix in VIEWS_ENDINGS]
    if len(files) > 1:
        raise InputError(f"{folder}: has several views {', '.join(path.name for path in files)}; leave one of them")
    return files[0] if files else None


def pair_views(folder: Path, side: str) -> SensorViews | None:
    """Views of the sensor from the views file of one side in a pair's folder; None without one.

    Raises:
        InputError: a file that cannot be read, or several.
    """
    file = views_file(folder, side)
    return None if file is None else read_views(file)


def _cloud_files(folder: Path, side: str) -> Sequence[Path]:
    return sorted(path for path in folder.glob(f"{side}.*") if path.suffix.lower() in READERS)


def _holds_part_of_a_pair(folder: Path) -> bool:
    return any(_cloud_files(folder, side) or (folder / f"truth_{side}.npy").is_file() for side in ("before", "after"))


def _required(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: is missing; it must hold -1 or the id of the change for each row of the cloud")
    return path
