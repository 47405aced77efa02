"""The settings of change detection: one frozen record with documented defaults."""

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from gmmjax.comparison import Kinds, Method
from gmmjax.errors import LARGEST_INTEGER, InputError, check_choice, shown

if TYPE_CHECKING:
    from gmmjax.mixtures import Prior

METHODS: tuple[Method, ...] = get_args(Method)
# The registry of detectors: the class of each method, by its place, because detectors import the config.
DETECTOR_CLASSES: Mapping[Method, str] = {
    "joint": "gmmjax.changes.detectors.joint:JointDetector",
    "greedy": "gmmjax.changes.detectors.separate:GreedyDetector",
    "transport": "gmmjax.changes.detectors.separate:TransportDetector",
}
RegistrationMode = Literal["auto", "always", "never"]

# What more restarts gain ends here (docs/results.md): on surfaces distances see what one mixture misses.
DEFAULT_RESTARTS, RESTARTS_ON_SURFACES = 8, 2
# Settings that are positive numbers, where they are set.
POSITIVE = (
    "tolerance",
    "voxel_size",
    "noise_floor",
    "penalty",
    "outlier_ratio",
    "covariance_scale",
    "degrees_of_freedom",
)
# Settings that are leaves of the mixtures' prior, by the leaf's name.
PRIOR_LEAVES: Mapping[str, str] = {
    "noise_floor": "noise_floor",
    "tolerance": "tolerance",
    "concentration": "concentration",
    "noise_share": "noise_share",
    "covariance_scale": "scale",
    "degrees_of_freedom": "degrees_of_freedom",
}
# Characters of the name of a unit.
LONGEST_UNIT = 12
# Observations that a share of stray points is worth which is not to be found from the points.
FIXED = 1e9


@dataclasses.dataclass(frozen=True)
class DetectionConfig:
    """Settings of a detection. Lengths are in the unit of the clouds; None means derived from the data.

    Attributes:
        method: "joint" fits one mixture to both clouds and looks at each component's share of either (the default);
            "greedy" removes the Gaussians of separate mixtures that the earth mover's distance wants gone (the thesis's
            Algorithm 1); "transport" leaves unmatched what partial transport between separate mixtures cannot match.
        kinds: which kinds of change to look for.
        restarts: random restarts of the fits, over which probabilities are averaged; with "greedy" and "transport"
            every pair of restarts of the two clouds votes. None: 8, or 2 for "joint" on surface scans.
        seed: seed of the random starts. The same seed gives the same result on the same machine.
        max_components: number of Gaussians that each fit starts with. None: 25, or 40 for "joint" on surface scans, or
            less where there are few points.
        crop: box that the comparison is restricted to: x, y and z of its lower and then of its upper corner. Points
            outside never count as changed. None: everything.
        registration: "auto" aligns the after cloud to the before cloud where the fit shows that it is needed, and by no
            more than the points' spacing where both files state one reference system; "always" whenever it can. Of
            "joint".
        tolerance: registration error that the mixture tolerates, standard deviation per axis. None: from the points'
            spacing and the residual of the registration. Of "joint".
        evidence: whether a change of a surface scan must lie where the other scan looked: where its views saw that
            there was nothing, or, without views, off the surfaces beside it. False reports all that one scan has and
            the other has not. Of "joint".
        recognise_stations: whether the stations of a scanner on a tripod are recognised by the density of the ground
            around them, where a scan has no views: these are its views then. z points up. Of "joint".
        verdict: file with the parameters by which a difference between scans is a change, such as `gmmjax tune` writes.
            None: those that come with the package. Of "joint".
        max_points: maximum number of voxels that each cloud is reduced to before a separate fit, and of points that one
            restart of "joint" is fitted to. All points get labels nevertheless.
        voxel_size: edge of the voxels, the same everywhere. None: the smallest that leaves at most `max_points` (50,000
            for the registration and the mixture of "joint") in either cloud; clouds with fewer points are not reduced.
            "joint" then compares scans in voxels as small as both allow at each place.
        outlier_neighbours: neighbours that the outlier filter looks at; 0 switches it off. Of separate fits; "joint"
            has a component for stray points.
        outlier_ratio: a point is an outlier, and kept out of the fit, when its mean distance to those neighbours is
            more than this many standard deviations above the cloud's mean.
        noise_floor: standard deviation of the sensor's noise, added to every Gaussian. None: a thousandth of the
            cloud's spread, 1 mm for a scan of 2 m. The scatter within a voxel is added to it.
        concentration: Dirichlet concentration of the Gaussians' weights, below 1: the further below, the more points
            a Gaussian needs to stay. None: Figueiredo and Jain's, one less half the parameters of a Gaussian.
        covariance_scale: prior standard deviation of the Gaussians, with the weight `degrees_of_freedom`. None: there
            is no such prior.
        degrees_of_freedom: weight of `covariance_scale`, as a number of points. None: 0.
        noise_share: fraction of outliers, which belong to no Gaussian. None: "joint" finds it from the points; separate
            fits, after the outlier filter, have none.
        threshold: probability from which a point or a Gaussian counts as changed.
        penalty: of partial transport, for each unit of mass left unmatched: mass is matched over at most twice this
            distance (Bures-Wasserstein). None: 0.4 of the median standard deviation of the Gaussians.
        unit: what lengths are labelled with, such as m or mm; nothing is converted. None: the unit that the files of
            both scans state, as LAS and E57 do.
    """

    method: Method = "joint"
    kinds: Kinds = "both"
    restarts: int | None = None
    seed: int = 0
    max_components: int | None = None
    crop: tuple[float, float, float, float, float, float] | None = None
    registration: RegistrationMode = "auto"
    tolerance: float | None = None
    evidence: bool = True
    recognise_stations: bool = True
    verdict: str | None = None
    max_points: int = 16384
    voxel_size: float | None = None
    outlier_neighbours: int = 20
    outlier_ratio: float = 3.0
    noise_floor: float | None = None
    concentration: float | None = None
    covariance_scale: float | None = None
    degrees_of_freedom: float | None = None
    noise_share: float | None = None
    threshold: float = 0.5
    penalty: float | None = None
    unit: str | None = None

    def __post_init__(self) -> None:
        """Checks every setting.

        Raises:
            InputError: a setting out of its range, by name.
        """
        check_choice("method", self.method, METHODS)
        check_choice("kinds", self.kinds, get_args(Kinds))
        check_choice("registration", self.registration, get_args(RegistrationMode))
        for name in ("evidence", "recognise_stations"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name}={shown(getattr(self, name))} must be True or False")
        if self.verdict is not None and not isinstance(self.verdict, str):
            raise InputError(f"verdict={shown(self.verdict)} must be the path of a file")
        for name, least in (("seed", 0), ("max_points", 100), ("outlier_neighbours", 0)):
            _check_least(name, getattr(self, name), least)
        for name in ("restarts", "max_components"):
            if getattr(self, name) is not None:
                _check_least(name, getattr(self, name), 1)
        if self.unit is not None:
            _check_unit(self.unit)
        if self.crop is not None:
            object.__setattr__(self, "crop", _checked_crop(self.crop))
        for name in POSITIVE:
            value = getattr(self, name)
            if value is not None and not (_is_real(value) and value > 0):
                raise InputError(f"{name}={shown(value)} must be a positive number")
        if self.concentration is not None and not (_is_real(self.concentration) and self.concentration < 1):
            raise InputError(f"concentration={shown(self.concentration)} must be a number below 1")
        if self.noise_share is not None and not (_is_real(self.noise_share) and 0 <= self.noise_share < 1):
            raise InputError(f"noise_share={shown(self.noise_share)} must be at least 0 and below 1")
        if (self.covariance_scale is None) != (self.degrees_of_freedom is None):
            raise InputError("covariance_scale and degrees_of_freedom go together: set both or neither")
        if not (_is_real(self.threshold) and 0 < self.threshold < 1):
            raise InputError(f"threshold={shown(self.threshold)} must lie between 0 and 1")

    def over(self, prior: "Prior") -> "Prior":
        """The prior of a fit, with what these settings say of it in place of what was derived from the data.

        Args:
            prior: in the unit of the clouds.
        """
        settings = {name: getattr(self, name) for name in PRIOR_LEAVES}
        return with_settings(prior, {name: value for name, value in settings.items() if value is not None})

    def number_of_restarts(self, *, on_surfaces: bool = False) -> int:
        """The restarts that were asked for, or the default.

        Args:
            on_surfaces: of the joint mixture of surface scans.
        """
        return self.restarts or (RESTARTS_ON_SURFACES if on_surfaces else DEFAULT_RESTARTS)

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
            listed = ", ".join(str(name)[:60] for name in unknown[:3])
            raise InputError(f"unknown setting {listed}; known are {', '.join(sorted(known))}")
        # TOML and JSON know lists only.
        values: dict[str, Any] = {}
        for name, value in settings.items():
            values[name] = tuple(value) if isinstance(value, list) else value
        return cls(**values)


def with_settings(prior: "Prior", settings: Mapping[str, Any]) -> "Prior":
    """The prior with settings of `PRIOR_LEAVES` in place of its own; a share of stray points that is set is fixed.

    Args:
        prior: in the unit of the clouds.
        settings: by their names in `DetectionConfig`, numbers or traced arrays.
    """
    leaves = {PRIOR_LEAVES[name]: value for name, value in settings.items()}
    if "noise_share" in settings:
        leaves["noise_strength"] = FIXED
    return dataclasses.replace(prior, **leaves)


def _check_unit(unit: object) -> None:
    if not (isinstance(unit, str) and unit[:1].isalpha() and unit.isprintable() and len(unit) <= LONGEST_UNIT):
        raise InputError(
            f"unit={shown(unit)} must be a name of at most {LONGEST_UNIT} characters that starts with a letter, such "
            "as m, mm or ft"
        )


def _is_real(value: object) -> bool:
    """True for a finite number that a float can hold, but for True and False."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _checked_crop(crop: Any) -> tuple[float, ...]:
    numbers = tuple(crop) if isinstance(crop, Sequence | np.ndarray) and not isinstance(crop, str | bytes) else ()
    if len(numbers) != 6 or not all(_is_real(number) for number in numbers):
        raise InputError(
            f"crop={shown(crop)} must be six finite numbers: x, y, z of the lower and then of the upper corner"
        )
    if not all(lower < upper for lower, upper in zip(numbers[:3], numbers[3:], strict=True)):
        raise InputError(f"crop={shown(crop)}: the lower corner must be below the upper one on every axis")
    return tuple(float(number) for number in numbers)


def _check_least(name: str, value: object, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= LARGEST_INTEGER:
        raise InputError(f"{name}={shown(value)} must be a whole number of at least {least} and below 2^63")
