"""Where the sensor stood, as it is said on the command line: files of views, or its positions."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from gmmjax.errors import InputError

if TYPE_CHECKING:
    from gmmjax.clouds import PointCloud, SensorViews, SurveyFiles


@dataclasses.dataclass(frozen=True)
class SensorOption:
    """The options about the sensor of one scan.

    Attributes:
        side: "before" or "after".
        files: of `--views-*`; empty: not given.
        positions: of `--sensor-*`: x, y and z of each; None: not given.
        at_origin: whether `--sensor-at-origin` is given.
    """

    side: str
    files: tuple[Path, ...]
    positions: tuple[float, ...] | None
    at_origin: bool

    def __post_init__(self) -> None:
        """Checks that the sensor is given once, before anything is read.

        Raises:
            InputError: it is given twice, or a position is incomplete.
        """
        given = {
            f"--views-{self.side}": bool(self.files),
            f"--sensor-{self.side}": self.positions is not None,
            "--sensor-at-origin": self.at_origin,
        }
        names = [name for name, is_given in given.items() if is_given]
        if len(names) > 1:
            raise InputError(f"{' and '.join(names)} both say where the sensor of the {self.side} scan was; give one")
        count = 3 if self.positions is None else len(self.positions)
        if count == 0 or count % 3:
            raise InputError(
                f"--sensor-{self.side}: {count} numbers are no positions; give X Y Z, and three more for each further "
                "position"
            )

    def check_scans(self, scans: int) -> None:
        """Checks that there is a position for each scan of a survey of several; one scan may have several positions.

        Raises:
            InputError: there are more or fewer positions than scans.
        """
        positions = None if self.positions is None else len(self.positions) // 3
        if scans > 1 and positions not in (None, scans):
            raise InputError(
                f"--sensor-{self.side}: {positions} position{'s' * (positions != 1)} for {scans} scans; give X Y Z for "
                "each of them, in their order"
            )

    def views(self, cloud: "PointCloud | SurveyFiles") -> "SensorViews | None":
        """The views of the scan; None where the option says nothing.

        Args:
            cloud: the scan or the survey, in whose frame and unit the positions are; files are read in chunks.

        Raises:
            InputError: a file or positions that cannot be used.
        """
        from gmmjax.clouds import PointCloud, SensorViews, read_views

        if self.files:
            return SensorViews.merged([read_views(file) for file in self.files])
        numbers = (0.0, 0.0, 0.0) if self.at_origin else self.positions
        if numbers is None:
            return None
        positions = [numbers[start : start + 3] for start in range(0, len(numbers), 3)]
        try:
            if isinstance(cloud, PointCloud):
                return SensorViews.from_positions(cloud.points, positions)
            return SensorViews.from_parts(lambda: (chunk.points for chunk in cloud.chunks()), positions)
        except InputError as error:
            name = "at-origin" if self.at_origin else self.side
            source = cloud.source if isinstance(cloud, PointCloud) else cloud.title
            raise InputError(f"--sensor-{name}: {source}: {error}") from error
