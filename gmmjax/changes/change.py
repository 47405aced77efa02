"""The records of a detection: `Change` for an object, `RejectedCandidate` for what is none, `Changes` for a pair."""

import dataclasses
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args, overload

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.changes.change_table import data_frame
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.explanation import Explanation
from gmmjax.changes.plain_values import finite, probability, text, whole
from gmmjax.changes.presentation import GivenCloud, notebook_html, plotted, write_report
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
from gmmjax.errors import InputError, one_line, shown
from gmmjax.geometry import OrientedBox
from gmmjax.pair import Pair

Kind = Literal["appeared", "disappeared", "moved"]
Reason = Literal["unchanged", "not observed"]
VolumeMethod = Literal["surface", "hull"]
GainOrLoss = Literal["gain", "loss"]


@dataclasses.dataclass(frozen=True)
class Box:
    """An oriented box around the points of a change.

    Attributes:
        centre: centre, in the unit of the clouds.
        extent: full edge lengths along the box's own axes, longest first.
        rotation: those axes as the columns of a rotation matrix.
    """

    centre: Float[np.ndarray, "3"]
    extent: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]

    @classmethod
    def around(cls, points: Float[np.ndarray, "n 3"]) -> "Box":
        """The box along the principal axes of the points that just holds them all."""
        origin = points.mean(axis=0)
        axes = np.linalg.svd(np.cov((points - origin).T, bias=True), hermitian=True)[0]
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        inside = (points - origin) @ axes
        lower, upper = inside.min(axis=0), inside.max(axis=0)
        return cls.longest_first(OrientedBox(origin + axes @ ((lower + upper) / 2), upper - lower, axes))

    @classmethod
    def longest_first(cls, box: OrientedBox) -> "Box":
        """The same box with its edges in the order of their lengths."""
        order = np.argsort(-box.extent, kind="stable")
        rotation = box.rotation[:, order]
        rotation[:, 2] *= np.sign(np.linalg.det(rotation))
        return cls(box.centre, box.extent[order], rotation)

    def to_dict(self) -> dict[str, Any]:
        """The box as plain lists."""
        return {"centre": self.centre.tolist(), "extent": self.extent.tolist(), "rotation": self.rotation.tolist()}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "Box":
        """The box that `to_dict` made plain.

        Raises:
            KeyError, TypeError, ValueError: it is no such dictionary.
        """
        shapes = {"centre": (3,), "extent": (3,), "rotation": (3, 3)}
        return cls(*(finite(content[name], shape) for name, shape in shapes.items()))

    def corners(self) -> Float[np.ndarray, "8 3"]:
        """The eight corners: bit i of the index says on which side of axis i."""
        signs = np.array([[(corner >> axis & 1) - 0.5 for axis in range(3)] for corner in range(8)])
        return self.centre + (signs * self.extent) @ self.rotation.T


@dataclasses.dataclass(frozen=True)
class Change:
    """One object that changed.

    Attributes:
        kind: "appeared" (its points are in the after cloud), "disappeared" (in the before cloud), or "moved": it is one
            of two changes, one in each cloud, that are the same object.
        probability: that it is a change, averaged over the restarts.
        significance: by how many standard deviations its points exceed what the other cloud has in its place, given the
            counting noise and the registration error.
        point_count: how many points of the clouds belong to it.
        mean: mean of its Gaussian, in the unit of the clouds.
        covariance: covariance of its Gaussian.
        box: around its points.
        partner: for a moved object, the index of the change that it was or became; else None.
        transform: for a moved object, the rigid motion [4, 4] of the object alone, from before to after; else None.
        explanation: the facts that decided, of a change of several pieces those of its largest one. None where none
            were measured: in clouds that fill volumes, without evidence, and by the methods that compare mixtures. The
            confidence in the registration is not in it.
        moved_probability: for a moved object, the probability that the partner is the same object; else None, and where
            it was not computed.
        area: of the surface that changed, or of a closed object that of its outline on what it stands on; in the square
            of the unit of the clouds. None where it was not measured.
        volume: in the cube of the unit of the clouds; not negative. None where it was not measured, or is that of
            another change.
        volume_error: half-width of the 95 % interval of the volume. It is of one object: in the volume between two
            surfaces also that of places that one of the surveys did not see, of a closed object that of sides that were
            not seen.
        volume_registration_error: the part of `volume_error`, half-width likewise, that is due to registration. It is
            common to all points of the change and does not average out; sums of volumes add it up linearly.
        volume_method: "surface", between the surfaces of both scans, its thin rim included, for what lies on a surface
            or was taken from it; "hull", of the convex hull down to what it stands on, for a closed object.
        gain_or_loss: whether there is more ("gain") or less ("loss") now in the place of the change; a moved object is
            lost in one place and gained in the other. None where no volume was measured.
        volume_counted_in: the index of the change that has the volume, where this one is its other surface: of erosion
            both the old and the new surface may have changed. Else None.
    """

    kind: Kind
    probability: float
    significance: float
    point_count: int
    mean: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    box: Box
    partner: int | None = None
    transform: Float[np.ndarray, "4 4"] | None = None
    explanation: Explanation | None = None
    moved_probability: float | None = None
    area: float | None = None
    volume: float | None = None
    volume_error: float | None = None
    volume_registration_error: float | None = None
    volume_method: VolumeMethod | None = None
    gain_or_loss: GainOrLoss | None = None
    volume_counted_in: int | None = None

    def __repr__(self) -> str:
        return f"<Change: {self.kind}, {_in_short(self)}>"

    def to_dict(self) -> dict[str, Any]:
        """The change as plain numbers, strings, lists and dictionaries."""
        return {
            "kind": self.kind,
            "probability": self.probability,
            "significance": self.significance,
            "point_count": self.point_count,
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "box": self.box.to_dict(),
            "partner": self.partner,
            "transform": None if self.transform is None else self.transform.tolist(),
            "explanation": None if self.explanation is None else self.explanation.to_dict(),
            "moved_probability": self.moved_probability,
            "area": self.area,
            "volume": self.volume,
            "volume_error": self.volume_error,
            "volume_registration_error": self.volume_registration_error,
            "volume_method": self.volume_method,
            "gain_or_loss": self.gain_or_loss,
            "volume_counted_in": self.volume_counted_in,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "Change":
        """The change that `to_dict` made plain.

        Raises:
            KeyError, TypeError, ValueError: it is no such dictionary.
        """
        partner, transform = content["partner"], content["transform"]
        # Earlier records have none of these.
        explanation, moved_probability = content.get("explanation"), content.get("moved_probability")
        measures = {name: content.get(name) for name in ("area", "volume", "volume_error", "volume_registration_error")}
        method, effect, counted_in = (
            content.get(name) for name in ("volume_method", "gain_or_loss", "volume_counted_in")
        )
        return cls(
            kind=_one_of(content["kind"], get_args(Kind), "kind"),
            probability=float(finite(content["probability"])),
            significance=float(finite(content["significance"])),
            point_count=whole(content["point_count"]),
            mean=finite(content["mean"], (3,)),
            covariance=finite(content["covariance"], (3, 3)),
            box=Box.from_dict(content["box"]),
            partner=None if partner is None else whole(partner),
            transform=None if transform is None else finite(transform, (4, 4)),
            explanation=None if explanation is None else Explanation.from_dict(explanation),
            moved_probability=None if moved_probability is None else probability(moved_probability),
            **{name: None if value is None else float(finite(value)) for name, value in measures.items()},
            volume_method=None if method is None else _one_of(method, get_args(VolumeMethod), "volume_method"),
            gain_or_loss=None if effect is None else _one_of(effect, get_args(GainOrLoss), "gain_or_loss"),
            volume_counted_in=None if counted_in is None else whole(counted_in),
        )


@dataclasses.dataclass(frozen=True)
class RejectedCandidate:
    """What looked changed in one cloud, and is none of the changes.

    Attributes:
        kind: of the change that it would be: "appeared" (its points are in the after cloud) or "disappeared".
        reason: "unchanged" (noise, registration error or density) or "not observed" by the other survey, whichever is
            likelier.
        probability: that it is a change nevertheless.
        point_count: how many points of the cloud belong to it.
        mean: of its points, in the unit of the clouds.
        box: around its points.
        explanation: the facts that decided.
    """

    kind: Kind
    reason: Reason
    probability: float
    point_count: int
    mean: Float[np.ndarray, "3"]
    box: Box
    explanation: Explanation

    def __repr__(self) -> str:
        return f"<RejectedCandidate: {self.kind}, {self.reason}, {_in_short(self)}>"

    def to_dict(self) -> dict[str, Any]:
        """The candidate as plain numbers, strings, lists and dictionaries."""
        return {
            "kind": self.kind,
            "reason": self.reason,
            "probability": self.probability,
            "point_count": self.point_count,
            "mean": self.mean.tolist(),
            "box": self.box.to_dict(),
            "explanation": self.explanation.to_dict(),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "RejectedCandidate":
        """The candidate that `to_dict` made plain.

        Raises:
            KeyError, TypeError, ValueError: it is no such dictionary.
        """
        return cls(
            kind=_one_of(content["kind"], ("appeared", "disappeared"), "kind"),
            reason=_one_of(content["reason"], get_args(Reason), "reason"),
            probability=probability(content["probability"]),
            point_count=whole(content["point_count"]),
            mean=finite(content["mean"], (3,)),
            box=Box.from_dict(content["box"]),
            explanation=Explanation.from_dict(content["explanation"]),
        )


@dataclasses.dataclass(frozen=True)
class Changes:
    """What changed between two clouds: a sequence of `Change`, most probable first.

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
    clouds: Pair[GivenCloud] | None = dataclasses.field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {kind}" for kind, count in self.object_counts().items() if count)
        points = f"{len(self.labels_before):,} and {len(self.labels_after):,} points"
        return f"<Changes: {counts or 'no change'}; {points}>"

    def _repr_html_(self) -> str:
        return notebook_html(self)

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
        """How many objects appeared, disappeared and moved; one that moved, which is two changes, counts once."""
        counts = {kind: sum(change.kind == kind for change in self.items) for kind in get_args(Kind)}
        paired = sum(change.kind == "moved" and change.partner is not None for change in self.items)
        return {**counts, "moved": counts["moved"] - paired // 2}

    def point_values(self, side: str) -> dict[str, np.ndarray]:
        """What is said of each point of one cloud, by name, as files of points have it: numbers of at most 32 bits.

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
        return write_report(self, path, before, after)

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
            InputError: matplotlib is not installed (the extra `plot`); clouds that are not known, or are not those of
                the changes.
        """
        return plotted(self, before, after, axes)

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
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{folder}: is not a complete record of changes ({type(error).__name__}: {one_line(error)}); {REMEDY}"
            ) from error


def _in_short(found: Change | RejectedCandidate) -> str:
    centre = ", ".join(f"{value:.4g}" for value in found.mean)
    return f"probability {found.probability:.2f}, {found.point_count:,} points at ({centre})"


def _one_of(value: Any, choices: Sequence[str], name: str) -> Any:
    if value not in choices:
        raise ValueError(f"{name} {shown(value)} is none of {', '.join(choices)}")
    return value


def _check_counts(content: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Whether the labels are of these changes, and not of another result."""
    for time in ("before", "after"):
        count, declared = len(arrays[f"labels_{time}"]), content[f"points_{time}"]
        if count != declared:
            raise ValueError(f"labels_{time} of {count} points, changes of {shown(declared)}")


def _check_indices(items: Sequence[Change], arrays: Mapping[str, np.ndarray]) -> None:
    """Whether labels and partners are indices of changes."""
    for name in ("labels_before", "labels_after"):
        if arrays[name].size and not (arrays[name].min() >= -1 and arrays[name].max() < len(items)):
            raise ValueError(f"{name} run from {arrays[name].min()} to {arrays[name].max()}, of {len(items)} changes")
    if any(change.partner is not None and change.partner >= len(items) for change in items):
        raise ValueError(f"a change has a partner beyond the {len(items)} changes")
    if any(change.volume_counted_in is not None and change.volume_counted_in >= len(items) for change in items):
        raise ValueError(f"the volume of a change is counted in one beyond the {len(items)} changes")
