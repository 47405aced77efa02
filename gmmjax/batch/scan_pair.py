"""A pair of scans in a batch run: where its clouds are, and how its changes are detected."""

import dataclasses
import os
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeAlias

from jaxtyping import ArrayLike

from gmmjax.changes import NAMES, DetectionConfig
from gmmjax.clouds import PointCloud, SensorViews, read_cloud, read_views
from gmmjax.errors import InputError, shown, warn
from gmmjax.pair import Pair

CloudSource: TypeAlias = str | os.PathLike[str] | PointCloud | ArrayLike
ViewsSource: TypeAlias = str | os.PathLike[str] | SensorViews
# Bytes of a name, in UTF-8: file systems take 255, and a suffix must fit.
LONGEST_NAME = 150


@dataclasses.dataclass(frozen=True, eq=False)
class BatchPair:
    """Two scans of one place.

    Attributes:
        name: of the pair; no other pair of the run has it. Its results are in a folder of this name.
        before: the cloud at the first time: a file, a `PointCloud`, or coordinates [n, 3].
        after: the cloud at the later time, in the same unit and about the same frame.
        views_before: where the sensor stood in the first survey: a file, or `SensorViews`. None: what the cloud's file
            says, or not known.
        views_after: the same for the later survey.
        config: settings of this pair; None: those of the run.

    Raises:
        InputError: a name that cannot be that of a folder.
    """

    name: str
    before: CloudSource
    after: CloudSource
    views_before: ViewsSource | None = None
    views_after: ViewsSource | None = None
    config: DetectionConfig | None = None

    def __post_init__(self) -> None:
        check_name(self.name)

    @property
    def clouds(self) -> Pair[CloudSource]:
        """Paths of both clouds."""
        return Pair(self.before, self.after)

    @property
    def views(self) -> Pair[ViewsSource | None]:
        """Paths of the views of both."""
        return Pair(self.views_before, self.views_after)

    def files(self) -> dict[str, Path]:
        """The files that it is made of, by what they are to it."""
        sources = {**_by_side("", self.clouds), **_by_side("views_", self.views)}
        return {role: Path(source) for role, source in sources.items() if isinstance(source, str | os.PathLike)}

    def in_memory(self) -> dict[str, PointCloud | SensorViews]:
        """The clouds and views that were given themselves, by what they are to it.

        Raises:
            InputError: an array that is no cloud.
        """
        files = self.files()
        clouds = {role: _cloud_of(source) for role, source in _by_side("", self.clouds).items() if role not in files}
        views = {role: own for role, own in _by_side("views_", self.views).items() if isinstance(own, SensorViews)}
        return {**clouds, **views}

    def read(self) -> tuple[Pair[PointCloud], Pair[SensorViews | None]]:
        """Both clouds, and the views of their sensors; None: what the cloud itself says.

        Raises:
            InputError: a file that cannot be read, or an array that is no cloud.

        Warns:
            InputWarning: rows of an array that are not finite.
        """
        clouds = self.clouds.map(_cloud_of)
        for name, given, cloud in zip(NAMES, self.clouds, clouds, strict=True):
            if cloud.rows_dropped and cloud.source is None and given is not cloud:
                warn(f"{cloud.rows_dropped:,} rows of the {name} cloud had no finite position and were left out")
        return clouds, self.views.map(_views_of)


def check_name(name: object, owner: str = "name") -> None:
    """Checks that a name can be that of a folder, and of nothing outside of the run's own.

    Args:
        name: of a pair.
        owner: what the name is of, at the start of the message.

    Raises:
        InputError: it is empty or too long, has a slash or a control character, or starts with a dot or a space.
    """
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"{owner}={shown(name)} must be a text that is not empty")
    if "/" in name or "\\" in name or not name.isprintable():
        raise InputError(f"{owner}={shown(name)} must not have slashes or control characters: a folder gets this name")
    if name[0] in ". " or name[-1] in ". ":
        raise InputError(f"{owner}={shown(name)} must not start or end with a dot or a space: a folder gets this name")
    if len(name.encode("utf-8", "replace")) > LONGEST_NAME:
        raise InputError(f"{owner}={shown(name)} has more than {LONGEST_NAME} bytes; choose a shorter one")


def check_distinct(names: Iterable[str], owner: str) -> None:
    """Checks that no two pairs have one name, also where upper and lower case are one, as on some file systems.

    Raises:
        InputError: names that are there twice; it lists the first ones.
    """
    counts = Counter(name.casefold() for name in names)
    twice = [name for name, count in counts.items() if count > 1]
    if twice:
        listed = ", ".join(shown(name) for name in twice[:3]) + (", ..." if len(twice) > 3 else "")
        raise InputError(f"{owner}: names that are there more than once: {listed}; give each pair its own")


def _by_side(prefix: str, pair: Pair[Any]) -> dict[str, Any]:
    return {f"{prefix}{name}": source for name, source in zip(NAMES, pair, strict=True)}


def _cloud_of(source: CloudSource) -> PointCloud:
    if isinstance(source, PointCloud):
        return source
    return read_cloud(source) if isinstance(source, str | os.PathLike) else PointCloud.from_rows(source)


def _views_of(source: ViewsSource | None) -> SensorViews | None:
    return read_views(source) if isinstance(source, str | os.PathLike) else source
