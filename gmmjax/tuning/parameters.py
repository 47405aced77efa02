"""The settings that can be tuned, each as a number without bounds."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._typing import Array
from gmmjax.changes import (
    PRIOR_LEAVES,
    DetectionConfig,
    with_settings,
)
from gmmjax.comparison import NOISE_SHARE
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures import Prior
from gmmjax.tuning.parameter_names import TUNABLE, VERDICT


class _Constraint(NamedTuple):
    """The map from all real numbers to a setting's domain, with its inverse.

    `fallback` is where tuning starts if the prior says nothing: in units of the clouds' spread for lengths.
    """

    constrained: Callable[[Array], Array]
    free: Callable[[float], float]
    fallback: float


# A change of the free number by 1 is a factor of e, so that all are tuned at the same rate.
_POSITIVE = (jnp.exp, lambda value: float(np.log(value)))
_CONSTRAINTS: Mapping[str, _Constraint] = {
    "noise_floor": _Constraint(*_POSITIVE, fallback=1e-3),
    "tolerance": _Constraint(*_POSITIVE, fallback=1e-3),
    "concentration": _Constraint(lambda free: 1 - jnp.exp(free), lambda value: float(np.log(1 - value)), fallback=0.0),
    "noise_share": _Constraint(
        jax.nn.sigmoid, lambda value: float(np.log(value) - np.log1p(-value)), fallback=NOISE_SHARE
    ),
    "covariance_scale": _Constraint(*_POSITIVE, fallback=0.1),
    "degrees_of_freedom": _Constraint(*_POSITIVE, fallback=1.0),
}
_LENGTHS = ("noise_floor", "tolerance", "covariance_scale")


def check_parameters(names: Sequence[str], config: DetectionConfig) -> None:
    """Checks the names of what is to be tuned.

    Raises:
        InputError: none, one twice, an unknown one, or one that says nothing without another.
    """
    if not names:
        raise InputError(f"parameters is empty; choose from {', '.join(TUNABLE)}")
    for name in names:
        check_choice("parameters", name, TUNABLE)
    if VERDICT in names and len(names) > 1:
        raise InputError(
            f"parameters {', '.join(names)}: the verdict is tuned alone, because the mixture's posterior is one of its "
            "facts; tune the others first, and then the verdict with their config"
        )
    if len(set(names)) < len(names):
        raise InputError(f"parameters {', '.join(names)} has a name twice")
    together = ("covariance_scale", "degrees_of_freedom")
    tuned = [name for name in together if name in names]
    if len(tuned) == 1 and getattr(config, tuned[0]) is None:
        raise InputError(f"parameters: {' and '.join(together)} go together; tune both, or set both in the config")


def free_values(names: Sequence[str], prior: Prior, spread: float) -> Float[np.ndarray, " p"]:
    """The free numbers that tuning starts from.

    Args:
        names: of the settings.
        prior: that has them; what is 0 or None in it says nothing.
        spread: of the clouds, in the unit of the prior.
    """
    return free_of(names, np.array([_first_value(name, prior, spread) for name in names]))


def _first_value(name: str, prior: Prior, spread: float) -> float:
    value = getattr(prior, PRIOR_LEAVES[name])
    if value is None or (float(value) == 0 and name != "concentration"):
        return _CONSTRAINTS[name].fallback * (spread if name in _LENGTHS else 1.0)
    return float(value)


def free_of(names: Sequence[str], values: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """The free numbers of settings: the inverse of `settings_of`."""
    return np.array([_CONSTRAINTS[name].free(float(value)) for name, value in zip(names, values, strict=True)])


def settings_of(names: Sequence[str], free: Float[np.ndarray, " p"]) -> dict[str, float]:
    """The settings by name, for a `DetectionConfig`, from their free numbers."""
    with jax.enable_x64(True):
        return {
            name: float(_CONSTRAINTS[name].constrained(jnp.asarray(value)))
            for name, value in zip(names, free, strict=True)
        }


def with_free_values(prior: Prior, names: Sequence[str], free: Float[Array, " p"]) -> Prior:
    """The prior with these settings in place of its own; differentiable with respect to the free numbers."""
    values = {name: _CONSTRAINTS[name].constrained(free[position]) for position, name in enumerate(names)}
    return with_settings(prior, values)
