"""The settings of change detection: one frozen record with documented defaults."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal, get_args

from gmmjax.errors import InputError, check_choice

Method = Literal["greedy", "transport"]
METHODS: tuple[Method, ...] = get_args(Method)
Kinds = Literal["both", "appeared", "disappeared"]


@dataclasses.dataclass(frozen=True)
class DetectionConfig:
    """How changes are detected. Lengths are in the unit of the clouds; None means derived from the data.

    Attributes:
        method: "greedy" removes the Gaussians that the earth mover's distance wants gone (the thesis's Algorithm 1);
            "transport" leaves unmatched what partial transport cannot match (finds changes of both kinds together).
        kinds: which kinds of change to look for.
        restarts: random restarts of each cloud's fit; every pair of restarts votes on the changes.
        seed: of the random starts. The same seed gives the same result on the same machine.
        max_components: Gaussians that each fit starts from. None: 25, or a tenth of the points where that is less.
        crop: box that is looked at: x, y and z of its lower and then of its upper corner. Points outside are never
            changed. None: all.
        max_points: voxels that each cloud is reduced to at the most before the fit. All points get labels all the same.
        voxel_size: edge of the voxels. None: the smallest that leaves at most `max_points` in either cloud; clouds with
            fewer points are not reduced.
        outlier_neighbours: neighbours that the outlier filter looks at; 0 switches it off.
        outlier_ratio: a point is an outlier, and kept out of the fit, when its mean distance to those neighbours is
            more than this many standard deviations above the cloud's mean.
        noise_floor: standard deviation of the sensor's noise, added to every Gaussian. None: a thousandth of the
            cloud's spread, 1 mm for a scan of 2 m. The scatter within a voxel is added to it.
        threshold: probability from which a point or a Gaussian counts as changed.
        penalty: of partial transport, for each unit of mass left unmatched: mass is matched over at most twice this
            distance (Bures-Wasserstein). None: 0.4 of the median standard deviation of the Gaussians.
    """

    method: Method = "greedy"
    kinds: Kinds = "both"
    restarts: int = 8
    seed: int = 0
    max_components: int | None = None
    crop: tuple[float, float, float, float, float, float] | None = None
    max_points: int = 16384
    voxel_size: float | None = None
    outlier_neighbours: int = 20
    outlier_ratio: float = 3.0
    noise_floor: float | None = None
    threshold: float = 0.5
    penalty: float | None = None

    def __post_init__(self) -> None:
        """Checks every setting.

        Raises:
            InputError: a setting out of its range, by name.
        """
        check_choice("method", self.method, METHODS)
        check_choice("kinds", self.kinds, get_args(Kinds))
        for name, least in (("restarts", 1), ("seed", 0), ("max_points", 100), ("outlier_neighbours", 0)):
            _check_least(name, getattr(self, name), least, int)
        if self.max_components is not None:
            _check_least("max_components", self.max_components, 1, int)
        if self.crop is not None:
            object.__setattr__(self, "crop", _checked_crop(self.crop))
        for name in ("voxel_size", "noise_floor", "penalty", "outlier_ratio"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int | float) and 0 < value < float("inf")):
                raise InputError(f"{name}={value!r} must be a positive number")
        if not (isinstance(self.threshold, int | float) and 0 < self.threshold < 1):
            raise InputError(f"threshold={self.threshold!r} must lie between 0 and 1")

    def to_dict(self) -> dict[str, Any]:
        """The settings by name; those that are None, derived from the data, are left out."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value is not None}

    @classmethod
    def from_dict(cls, settings: dict[str, Any]) -> "DetectionConfig":
        """The config with these settings; the others have their defaults.

        Raises:
            InputError: an unknown name, with the known ones, or a value out of its range.
        """
        known = {field.name for field in dataclasses.fields(cls)}
        unknown = sorted(set(settings) - known)
        if unknown:
            raise InputError(f"unknown setting {', '.join(unknown)}; known are {', '.join(sorted(known))}")
        # TOML and JSON know lists only.
        values: dict[str, Any] = {}
        for name, value in settings.items():
            values[name] = tuple(value) if isinstance(value, list) else value
        return cls(**values)


def _checked_crop(crop: Sequence[Any]) -> tuple[float, ...]:
    numbers = tuple(crop)
    if len(numbers) != 6 or not all(isinstance(number, int | float) for number in numbers):
        raise InputError(f"crop={crop!r} must be six numbers: x, y, z of the lower and then of the upper corner")
    if not all(lower < upper for lower, upper in zip(numbers[:3], numbers[3:], strict=True)):
        raise InputError(f"crop={crop!r}: the lower corner must be below the upper one on every axis")
    return tuple(float(number) for number in numbers)


def _check_least(name: str, value: object, least: int, kind: type) -> None:
    if not isinstance(value, kind) or isinstance(value, bool) or value < least:  # type: ignore[operator]
        raise InputError(f"{name}={value!r} must be a whole number of at least {least}")
