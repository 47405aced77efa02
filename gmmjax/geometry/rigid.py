"""Rigid transforms as matrices [4, 4]: made, applied, and fitted to pairs of points."""

import numpy as np
from jaxtyping import Float, Float64


def rigid_transform(
    rotation: Float[np.ndarray, "*n 3 3"] | None = None, translation: Float[np.ndarray, "*n 3"] | None = None
) -> Float64[np.ndarray, "*n 4 4"]:
    """The transform that rotates about the origin and then translates, or an array of such transforms.

    Args:
        rotation: rotation matrix; None: no rotation.
        translation: in the unit of the points; None: no translation.
    """
    count = rotation.shape[:-2] if rotation is not None else () if translation is None else translation.shape[:-1]
    transform = np.tile(np.eye(4), (*count, 1, 1))
    if rotation is not None:
        transform[..., :3, :3] = rotation
    if translation is not None:
        transform[..., :3, 3] = translation
    return transform


def rotation_about(
    rotation: Float[np.ndarray, "3 3"], centre: Float[np.ndarray, " 3"], destination: Float[np.ndarray, " 3"]
) -> Float64[np.ndarray, "4 4"]:
    """The transform that rotates about a centre and brings the centre to its destination."""
    return rigid_transform(rotation, destination - rotation @ centre)


def transformed(
    points: Float64[np.ndarray, "n 3"], transform: Float64[np.ndarray, "4 4"]
) -> Float64[np.ndarray, "n 3"]:
    """The points after a rigid transform."""
    return rotated(points, transform) + transform[:3, 3]


def rotated(vectors: Float64[np.ndarray, "n 3"], transform: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, "n 3"]:
    """The vectors after the rotation of a rigid transform."""
    # Not by BLAS: for three columns its threads cost more than they save.
    return np.asarray(np.einsum("ij,nj->ni", transform[:3, :3], vectors))


def least_squares_transform(
    source: Float64[np.ndarray, "n 3"], target: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "4 4"]:
    """The rigid transform of the source points with the least squared distances to the target points (Kabsch 1976)."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    rotation = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
    return rotation_about(rotation, source_mean, target_mean)
