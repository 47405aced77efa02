"""The unit and the coordinate reference system that two clouds have in common."""

from typing import Any

from gmmjax.changes.config import DetectionConfig
from gmmjax.clouds import CloudFile, PointCloud, SurveyFiles
from gmmjax.errors import InputError
from gmmjax.pair import Pair


def common_unit(clouds: Pair[Any], config: DetectionConfig) -> str | None:
    """The unit of both clouds: the setting, else what both files state; no coordinate is ever converted.

    Args:
        clouds: coordinates, or a cloud, a file or a survey with the unit and the reference system that its files state.
        config: with the unit that the user gave.

    Returns:
        The unit; None where it is not known.

    Raises:
        InputError: the files state two units, and the user gave none; or two reference systems.
    """
    units, systems = clouds.map(lambda cloud: _stated(cloud, "unit")), stated_systems(clouds)
    if config.unit is None and None not in (*units,) and units.before != units.after:
        raise InputError(
            f"before is in {units.before} and after in {units.after}, as their files state; convert one of them, or "
            "give the unit of both (unit=..., --unit) where a file is wrong"
        )
    if None not in (*systems,) and systems.before != systems.after:
        raise InputError(
            f"before is in {systems.before} and after in {systems.after}, as their files state: coordinates of two "
            "reference systems cannot be compared; reproject one of them"
        )
    return config.unit or (units.before if units.before == units.after else None)


def stated_systems(clouds: Pair[Any]) -> Pair[str | None]:
    """The coordinate reference system that the file of each cloud states; None: it states none.

    Args:
        clouds: coordinates, or a cloud, a file or a survey.
    """
    return clouds.map(lambda cloud: _stated(cloud, "crs"))


def in_one_system(clouds: Pair[Any]) -> bool:
    """Whether the files of both clouds state the same coordinate reference system.

    Args:
        clouds: coordinates, or a cloud, a file or a survey.
    """
    systems = stated_systems(clouds)
    return systems.before is not None and systems.before == systems.after


def _stated(cloud: Any, name: str) -> str | None:
    return getattr(cloud, name) if isinstance(cloud, PointCloud | CloudFile | SurveyFiles) else None
