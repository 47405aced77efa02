"""The changes of a pair as the rows of a table, and as a data frame of pandas."""

import dataclasses
import typing
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.errors import InputError
from gmmjax.geometry import transformed

if TYPE_CHECKING:
    from gmmjax.changes.change import Change
    from gmmjax.changes.record import Changes


class ObjectMotion(NamedTuple):
    """The motion of an object that moved.

    Attributes:
        distance: that its centre moved by, in the unit of the clouds.
        degrees: angle that it turned by; None where its motion is not known.
    """

    distance: float
    degrees: float | None


@dataclasses.dataclass(frozen=True)
class ChangeColumns:
    """A change as one row of a table. Lengths are in the unit of the clouds, in the frame of the before cloud.

    Attributes:
        change: its index, which is also the label of its points.
        kind: "appeared", "disappeared" or "moved"; a moved object has two rows, one in each cloud.
        probability: that it is a change.
        moved_probability: of a moved object, that its partner is the same object; None where it was not computed.
        significance: by how many standard deviations its points exceed what the other cloud has there.
        point_count: points that belong to it.
        partner: of a moved object the index of the change that it was or became; else None.
        centre_x: centre of its box.
        centre_y: likewise.
        centre_z: likewise.
        extent_1: longest edge of its box.
        extent_2: the next one.
        extent_3: the shortest one.
        area: of the surface that changed, or of the outline of an object, in the square of the unit; None where it was
            not measured.
        gain_or_loss: "gain" where there is more now, "loss" where there is less; None where that is not known.
        volume: in the cube of the unit, not negative; None where it was not measured, or is counted in another change.
        volume_error: half-width of its 95 % interval.
        volume_registration_error: the part of it that registration has, which is common to all changes.
        volume_method: "surface", between the surfaces of both scans, or "hull", of the convex hull.
        volume_counted_in: the change that has the volume of this one, of which it is the other surface; else None.
        opposite_volume: of a change that was gained in one part and lost in the other, the smaller volume of both,
            which is not in `volume`; else None.
        opposite_volume_error: half-width of its 95 % interval.
        displacement: of a moved object, how far the centre of its box moved; None where its motion is not known.
        rotation_degrees: of a moved object, the angle that it turned by; None likewise.
    """

    change: int
    kind: str
    probability: float
    moved_probability: float | None
    significance: float
    point_count: int
    partner: int | None
    centre_x: float
    centre_y: float
    centre_z: float
    extent_1: float
    extent_2: float
    extent_3: float
    area: float | None
    gain_or_loss: str | None
    volume: float | None
    volume_error: float | None
    volume_registration_error: float | None
    volume_method: str | None
    volume_counted_in: int | None
    opposite_volume: float | None
    opposite_volume_error: float | None
    displacement: float | None
    rotation_degrees: float | None


def change_columns(changes: "Changes") -> tuple[ChangeColumns, ...]:
    """A row for each change, in their order.

    Args:
        changes: what was found.
    """
    return tuple(_row(changes, label, change) for label, change in enumerate(changes.items))


def _row(changes: "Changes", label: int, change: "Change") -> ChangeColumns:
    centre, extent = change.box.centre.tolist(), change.box.extent.tolist()
    displacement, rotation_degrees = _motion(changes, label, change)
    return ChangeColumns(
        change=label,
        kind=change.kind,
        probability=change.probability,
        moved_probability=change.moved_probability,
        significance=change.significance,
        point_count=change.point_count,
        partner=change.partner,
        centre_x=centre[0],
        centre_y=centre[1],
        centre_z=centre[2],
        extent_1=extent[0],
        extent_2=extent[1],
        extent_3=extent[2],
        area=change.area,
        gain_or_loss=change.gain_or_loss,
        volume=change.volume,
        volume_error=change.volume_error,
        volume_registration_error=change.volume_registration_error,
        volume_method=change.volume_method,
        volume_counted_in=change.volume_counted_in,
        opposite_volume=change.opposite_volume,
        opposite_volume_error=change.opposite_volume_error,
        displacement=displacement,
        rotation_degrees=rotation_degrees,
    )


def object_motion(changes: "Changes", labels: tuple[int, int]) -> ObjectMotion:
    """Measure how far a moved object moved, and by what angle it was rotated.

    Args:
        changes: what was found.
        labels: of the object in the before and in the after scan.
    """
    was, became = (changes.items[label] for label in labels)
    if was.transform is None:
        return ObjectMotion(float(np.linalg.norm(became.box.centre - was.box.centre)), None)
    # The centre of the box: the mean of the points is that of the side that was seen.
    there = transformed(was.box.centre[None], was.transform)[0]
    rotation = Rotation.from_matrix(was.transform[:3, :3])
    return ObjectMotion(float(np.linalg.norm(there - was.box.centre)), float(np.degrees(rotation.magnitude())))


def _motion(changes: "Changes", label: int, change: "Change") -> tuple[float | None, float | None]:
    """The motion of the object, which both of its changes have."""
    if change.transform is None or change.partner is None:
        return None, None
    labels = (label, change.partner) if (changes.labels_before == label).any() else (change.partner, label)
    return object_motion(changes, labels)


def data_frame(changes: "Changes") -> Any:
    """`change_columns` as a `pandas.DataFrame`; see `Changes.to_dataframe`.

    Args:
        changes: what was found.

    Raises:
        InputError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise InputError("to_dataframe needs pandas, which is not installed: pip install 'gmmjax[pandas]'") from error
    rows, hints = change_columns(changes), typing.get_type_hints(ChangeColumns)
    columns = {
        name: pandas.array([getattr(row, name) for row in rows], dtype=_pandas_type(hint))
        for name, hint in hints.items()
    }
    frame = pandas.DataFrame(columns).set_index("change")
    frame.attrs.update(unit=changes.unit, crs=changes.crs)
    return frame


def _pandas_type(hint: Any) -> str:
    """Whole numbers that may be missing stay whole numbers; other numbers that are missing are NaN."""
    if hint == int | None:
        return "Int64"
    if hint == str | None:
        return "string"
    return {int: "int64", str: "string"}.get(hint, "float64")
