"""The record of a registration."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import transformed


@dataclasses.dataclass(frozen=True)
class Registration:
    """The registration of the after cloud to the before cloud. All results are in the frame of the before cloud.

    Lengths are in the unit of the clouds. What was not measured is None.

    Attributes:
        transform: rigid transform [4, 4] that takes the after cloud, as given, into the frame of the before cloud; the
            identity where none was needed or none was asked for.
        applied: whether the after cloud was transformed.
        displacement: distance by which the transform moves the centre of the after cloud.
        residual: registration error that is left: of scans the robust standard deviation of the offsets between the
            surfaces; of volumetric clouds the standard error of the displacement.
        residual_before: the same without the transform; of volumetric clouds the displacement.
        overlap: fraction of the points that have a counterpart in the other cloud, in the cloud where it is less; of
            volumetric clouds the fraction of the mass whose components agree on the displacement, or, where the given
            frame was judged by that, of the points that are mixed as in two samples of one density.
        confidence: probability that the clouds are registered, by which the probabilities of all changes are
            multiplied.
    """

    transform: Float[np.ndarray, "4 4"]
    applied: bool
    displacement: float = 0.0
    residual: float | None = None
    residual_before: float | None = None
    overlap: float | None = None
    confidence: float = 1.0

    @classmethod
    def measured(
        cls,
        transform: Float[np.ndarray, "4 4"],
        centre: Float[np.ndarray, "1 3"],
        *,
        applied: bool,
        residual: float,
        residual_before: float,
        overlap: float,
        confidence: float = 1.0,
    ) -> "Registration":
        """The record of a transform; a residual that is not finite, for want of any overlap, is not known.

        Args:
            transform: rigid transform [4, 4].
            centre: of the after cloud as it was given.
            applied: whether it is applied.
            residual: as the attribute.
            residual_before: as the attribute.
            overlap: as the attribute.
            confidence: as the attribute.
        """
        return cls(
            transform=transform,
            applied=applied,
            displacement=float(np.linalg.norm(transformed(centre, transform) - centre)),
            residual=residual if np.isfinite(residual) else None,
            residual_before=residual_before if np.isfinite(residual_before) else None,
            overlap=overlap,
            confidence=confidence,
        )

    @classmethod
    def none(cls) -> "Registration":
        """The record where no registration was looked for."""
        return cls(np.eye(4), applied=False)

    @property
    def in_doubt(self) -> bool:
        """True where the user is warned of it: a confidence below 0.9."""
        return self.confidence < 0.9

    def apply(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points of the after cloud in the frame of the before cloud."""
        return transformed(points, self.transform) if self.applied else points

    @property
    def rotation_degrees(self) -> float:
        """Angle of the transform's rotation."""
        return float(np.degrees(Rotation.from_matrix(self.transform[:3, :3]).magnitude()))

    def to_dict(self) -> dict[str, Any]:
        """The record as plain values; what is not finite is None."""
        numbers = {
            "rotation_degrees": self.rotation_degrees,
            "displacement": self.displacement,
            "residual": self.residual,
            "residual_before": self.residual_before,
            "overlap": self.overlap,
            "confidence": self.confidence,
        }
        finite = {name: None if value is None or not np.isfinite(value) else value for name, value in numbers.items()}
        return {"applied": self.applied, "transform": self.transform.tolist(), **finite}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "Registration":
        """The record that `to_dict` made plain."""
        names = ("displacement", "residual", "residual_before", "overlap", "confidence")
        values = {name: None if content[name] is None else float(content[name]) for name in names}
        transform = np.array(content["transform"], float)
        if transform.shape != (4, 4):
            raise ValueError("the transform of the registration is not a matrix [4, 4]")
        return cls(transform, bool(content["applied"]), **values)  # type: ignore[arg-type]
