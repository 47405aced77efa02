"""Result for one object: `Change`, or `RejectedCandidate` for what looked like one."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from gmmjax.changes.explanation import Explanation
from gmmjax.changes.plain_values import finite, probability, whole
from gmmjax.errors import shown
from gmmjax.geometry import OrientedBox

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
        """Sort the edges of a box by their lengths, the longest first."""
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


_VOLUME = ("volume", "volume_error", "volume_registration_error")
_MEASURES = ("area", *_VOLUME, *(f"opposite_{name}" for name in _VOLUME))


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
        volume_error: half-width of the 95 % interval of the volume between two surfaces. None for that of a hull:
            nothing tells how much of it an object fills.
        volume_registration_error: the part of `volume_error`, half-width likewise, that is due to registration. It is
            common to all points of the change and does not average out; sums of volumes add it up linearly.
        volume_method: "surface", between the surfaces of both scans, its thin edge included, for what lies on a surface
            or was taken from it; "hull", of the convex hull down to what it stands on, for a closed object.
        gain_or_loss: whether there is more ("gain") or less ("loss") now in the place of the change; a moved object is
            lost in one place and gained in the other. None where no volume was measured, and of a surface that was
            displaced where nothing tells from which side it was seen.
        volume_counted_in: the index of the change that has the volume, where this one is its other surface: of erosion
            both the old and the new surface may have changed. Else None.
        opposite_volume: where a part of the change was gained and the rest was lost, as of stockpiles that touch, the
            smaller one of both volumes, which is not in `volume`; not negative. Else None.
        opposite_volume_error: half-width of its 95 % interval.
        opposite_volume_registration_error: the part of it that is due to registration.
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
    opposite_volume: float | None = None
    opposite_volume_error: float | None = None
    opposite_volume_registration_error: float | None = None

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
            "opposite_volume": self.opposite_volume,
            "opposite_volume_error": self.opposite_volume_error,
            "opposite_volume_registration_error": self.opposite_volume_registration_error,
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
        measures = {name: content.get(name) for name in _MEASURES}
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
    """A candidate of one cloud that is none of the changes.

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


def _in_short(found: Change | RejectedCandidate) -> str:
    centre = ", ".join(f"{value:.4g}" for value in found.mean)
    return f"probability {found.probability:.2f}, {found.point_count:,} points at ({centre})"


def _one_of(value: Any, choices: Sequence[str], name: str) -> Any:
    if value not in choices:
        raise ValueError(f"{name} {shown(value)} is none of {', '.join(choices)}")
    return value
