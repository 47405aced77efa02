"""The record of a detection: `Changes`, all that is said of a pair and of its points."""

import dataclasses
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args, overload

import numpy as np
from jaxtyping import ArrayLike, Bool, Float, Int

from gmmjax._presenters import presenter
from gmmjax.changes.change import Change, Kind, RejectedCandidate
from gmmjax.changes.change_table import data_frame
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.plain_values import finite, text
from gmmjax.changes.registration import Registration
from gmmjax.changes.storage import (
    LABELS_FILE,
    OPTIONAL_ARRAYS,
    OPTIONAL_FIGURES,
    POINT_ARRAYS,
    REMEDY,
    SCHEMA_VERSION,
    finite_or_null,
    read_record,
    write_record,
)
from gmmjax.changes.total_volumes import VolumeTotals, volume_totals
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError, one_line, shown
from gmmjax.pair import Pair

GivenCloud = ArrayLike | PointCloud


@dataclasses.dataclass(frozen=True)
class Changes:
    """The changes between two clouds: a sequence of `Change`, most probable first.

    `len(changes)`, `changes[0]` and `for change in changes` are those of `items`; a record without changes is false.

    Labels and probabilities are for all points as the caller gave them, in their order. Means, boxes and motions are in
    the frame of the before cloud; `registration` takes the after cloud into it.

    Attributes:
        labels_before: per point of the before cloud -1, or the index into `items` of the change that it belongs to.
        labels_after: the same for the after cloud.
        probability_before: per point the probability that it belongs to a change.
        probability_after: the same for the after cloud.
        unobserved_before: per point whether the survey of the after cloud did not see its place: hidden, out of view or
            beyond its edge. Nothing is known of a change there.
        unobserved_after: per point whether the survey of the before cloud did not see its place.
        items: the changes, most probable first; `changes[label]` is the one that points with this label belong to.
        emd: earth mover's distance between the mixtures of the two clouds, mean over the restarts (unit of the clouds).
        config: the settings that were used.
        diagnostics: what was derived and measured on the way: points dropped and filtered, voxel size, components and
            status of every fit, seconds. Plain numbers, strings, lists and dictionaries.
        registration: of the after cloud to the before cloud, and how sure it is.
        rejected: what looked changed in one of the clouds and is no change, most probable first.
        distance_before: per point the signed distance to the surface of the after cloud, along the normal, by M3C2's
            definition, in the unit of the clouds: positive where the after surface lies on the outer side. NaN where
            there is nothing to compare with. None where it was not measured: in clouds that fill volumes.
        distance_after: per point of the after cloud the signed distance from the surface of the before cloud to it.
        level_of_detection_before: per point the distance from which on a difference is significant at 95 %, by the
            scatter of both surfaces there and the registration error. NaN and None as for the distance.
        level_of_detection_after: the same for the after cloud.
        significance_before: per point the absolute distance in standard errors: beyond the level of detection it is
            more than 1.96. NaN and None as for the distance.
        significance_after: the same for the after cloud.
        warnings: what the user was warned of during the detection.
        unit: of the coordinates, such as "m"; None where it is not known.
        crs: coordinate reference system that the file of the before cloud states, in which the results are: as
            "EPSG:25832" or else as WKT; None where it is not known.
        clouds: both clouds as they were given to `detect_changes`, by reference: what `report`, `plot` and notebooks
            show. They are not saved; None after `load`.
    """

    labels_before: Int[np.ndarray, " n0"]
    labels_after: Int[np.ndarray, " n1"]
    probability_before: Float[np.ndarray, " n0"]
    probability_after: Float[np.ndarray, " n1"]
    unobserved_before: Bool[np.ndarray, " n0"]
    unobserved_after: Bool[np.ndarray, " n1"]
    items: tuple[Change, ...]
    emd: float
    config: DetectionConfig
    diagnostics: Mapping[str, Any]
    registration: Registration = dataclasses.field(default_factory=Registration.none)
    rejected: tuple[RejectedCandidate, ...] = ()
    distance_before: Float[np.ndarray, " n0"] | None = None
    distance_after: Float[np.ndarray, " n1"] | None = None
    level_of_detection_before: Float[np.ndarray, " n0"] | None = None
    level_of_detection_after: Float[np.ndarray, " n1"] | None = None
    significance_before: Float[np.ndarray, " n0"] | None = None
    significance_after: Float[np.ndarray, " n1"] | None = None
    warnings: tuple[str, ...] = ()
    unit: str | None = None
    crs: str | None = None
    clouds: Pair[GivenCloud] | None = dataclasses.field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {kind}" for kind, count in self.object_counts().items() if count)
        points = f"{len(self.labels_before):,} and {len(self.labels_after):,} points"
        return f"<Changes: {counts or 'no change'}; {points}>"

    def _repr_html_(self) -> str:
        return str(presenter("notebook")(self))

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Change]:
        return iter(self.items)

    @overload
    def __getitem__(self, label: int) -> Change: ...

    @overload
    def __getitem__(self, label: slice) -> tuple[Change, ...]: ...

    def __getitem__(self, label: int | slice) -> Change | tuple[Change, ...]:
        return self.items[label]

    def object_counts(self) -> dict[str, int]:
        """Count the objects that appeared, disappeared and moved; one that moved, which is two changes, counts once."""
        counts = {kind: sum(change.kind == kind for change in self.items) for kind in get_args(Kind)}
        paired = sum(change.kind == "moved" and change.partner is not None for change in self.items)
        return {**counts, "moved": counts["moved"] - paired // 2}

    def point_values(self, side: str) -> dict[str, np.ndarray]:
        """Values of each point of one cloud, by name, as files of points have them: numbers of at most 32 bits.

        `label` (int32), `kind` (uint8: 0 unchanged, else one more than the place in `Kind`), `probability` (float32),
        `unobserved` (bool), and the figures that were measured (float32, in the unit of the clouds).

        Args:
            side: "before" or "after".
        """
        labels = getattr(self, f"labels_{side}")
        kinds = np.array([0, *(get_args(Kind).index(change.kind) + 1 for change in self.items)], np.uint8)
        values = {
            "label": labels.astype(np.int32),
            "kind": kinds[labels + 1],
            "probability": getattr(self, f"probability_{side}").astype(np.float32),
            "unobserved": getattr(self, f"unobserved_{side}"),
        }
        figures = {name: getattr(self, f"{name}_{side}") for name in OPTIONAL_FIGURES}
        return values | {name: own.astype(np.float32) for name, own in figures.items() if own is not None}

    def recognised_stations(self) -> Pair[Float[np.ndarray, "_ 3"]]:
        """Positions of the scanner in each cloud, in its own frame, that were recognised and not given.

        Returns:
            The positions [s, 3] in both clouds, in their unit. A cloud has none if its views were given, if it shows no
            stations, or if the method does not ask for them.
        """
        return Pair(_stations_in(self.diagnostics.get("before")), _stations_in(self.diagnostics.get("after")))

    def volume_totals(self) -> VolumeTotals | None:
        """The volume that was gained and lost in all, with its uncertainty; None where no change has a volume."""
        if all(change.volume is None for change in self.items):
            return None
        return volume_totals(self.items)

    def to_dataframe(self) -> Any:
        """The changes as a `pandas.DataFrame`, a row each, with their labels as the index.

        The columns are the fields of `gmmjax.changes.ChangeColumns`, which has their units; `frame.attrs["unit"]` is
        the unit of the clouds. A moved object has two rows, which name each other as `partner`.

        Raises:
            InputError: pandas is not installed (the extra `pandas`).
        """
        return data_frame(self)

    def report(
        self, path: str | os.PathLike[str], before: GivenCloud | None = None, after: GivenCloud | None = None
    ) -> Path:
        """Writes the report, one HTML file that needs nothing else, as `gmmjax detect` does.

        Args:
            path: of the file; one that is there is replaced, and its folder is made where needed.
            before: the before cloud that the changes were found in; None: that of `clouds`.
            after: the same for the after cloud, as it was given to the detection.

        Returns:
            The path.

        Raises:
            InputError: clouds that are not known, or are not those of the changes; a file that cannot be written.
        """
        return Path(presenter("report")(self, path, before, after))

    def plot(self, before: GivenCloud | None = None, after: GivenCloud | None = None, *, axes: Any = None) -> Any:
        """Draws both clouds, and the changes from above and from the side, with matplotlib.

        `gmmjax.plotting` has each of these pictures by itself.

        Args:
            before: as of `report`.
            after: as of `report`.
            axes: four axes of matplotlib to draw into; None: those of a new figure.

        Returns:
            The axes [2, 2].

        Raises:
            InputError: clouds that are not known, or are not those of the changes.
        """
        return presenter("plot")(self, before, after, axes=axes)

    def to_dict(self) -> dict[str, Any]:
        """The changes without the per-point arrays, as plain numbers, strings, lists and dictionaries (for JSON).

        Diagnostics that are not finite are None, such as a residual where no two points could be compared.
        """
        totals = self.volume_totals()
        return {
            "schema_version": SCHEMA_VERSION,
            "changes": [change.to_dict() for change in self.items],
            "rejected": [candidate.to_dict() for candidate in self.rejected],
            "volumes": None if totals is None else totals.to_dict(),
            "emd": self.emd,
            "registration": self.registration.to_dict(),
            "points_before": len(self.labels_before),
            "points_after": len(self.labels_after),
            "config": self.config.to_dict(),
            "diagnostics": finite_or_null(self.diagnostics),
            "warnings": list(self.warnings),
            "unit": self.unit,
            "crs": self.crs,
            "labels_file": LABELS_FILE,
        }

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Writes `changes.json` and `labels.npz` into a folder, which is made where needed; returns the folder.

        Raises:
            InputError: the folder cannot be made or written.
        """
        arrays = {name: getattr(self, name) for name in (*POINT_ARRAYS, *OPTIONAL_ARRAYS)}
        measured = {name: values for name, values in arrays.items() if values is not None}
        return write_record(folder, self.to_dict(), measured)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "Changes":
        """Reads what `save` wrote: the folder, or its `changes.json`.

        Raises:
            InputError: files that are missing, damaged, or of another schema version.
        """
        content, arrays = read_record(folder)
        try:
            items = tuple(Change.from_dict(change) for change in content["changes"])
            _check_indices(items, arrays)
            _check_counts(content, arrays)
            return cls(
                **dict[str, Any](arrays),
                items=items,
                emd=float(finite(content["emd"])),
                config=DetectionConfig.from_dict(dict(content["config"])),
                diagnostics=dict(content["diagnostics"]),
                registration=Registration.from_dict(content["registration"]),
                rejected=tuple(RejectedCandidate.from_dict(candidate) for candidate in content.get("rejected", ())),
                warnings=tuple(text(warning) for warning in content.get("warnings", ())),
                unit=None if content.get("unit") is None else text(content["unit"]),
                crs=None if content.get("crs") is None else text(content["crs"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{folder}: is not a complete record of changes ({type(error).__name__}: {one_line(error)}); {REMEDY}"
            ) from error


def _stations_in(diagnostics: Any) -> Float[np.ndarray, "s 3"]:
    stations = diagnostics.get("recognised_stations", []) if isinstance(diagnostics, Mapping) else []
    return np.asarray(stations, float).reshape(-1, 3)


def _check_counts(content: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Check that the labels are those of these changes, and not of another result."""
    for time in ("before", "after"):
        count, declared = len(arrays[f"labels_{time}"]), content[f"points_{time}"]
        if count != declared:
            raise ValueError(f"labels_{time} of {count} points, changes of {shown(declared)}")


def _check_indices(items: Sequence[Change], arrays: Mapping[str, np.ndarray]) -> None:
    """Check that labels and partners are indices of changes."""
    for name in ("labels_before", "labels_after"):
        if arrays[name].size and not (arrays[name].min() >= -1 and arrays[name].max() < len(items)):
            raise ValueError(f"{name} run from {arrays[name].min()} to {arrays[name].max()}, of {len(items)} changes")
    if any(change.partner is not None and change.partner >= len(items) for change in items):
        raise ValueError(f"a change has a partner beyond the {len(items)} changes")
    if any(change.volume_counted_in is not None and change.volume_counted_in >= len(items) for change in items):
        raise ValueError(f"the volume of a change is counted in one beyond the {len(items)} changes")
