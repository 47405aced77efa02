"""The settings that can be tuned, each as a number without bounds."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._typing import Array
from gmmjax.changes.config import FIXED, DetectionConfig
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures import Prior

ParameterName = Literal[
    "noise_floor", "tolerance", "concentration", "noise_share", "covariance_scale", "degrees_of_freedom"
]
PARAMETERS: tuple[ParameterName, ...] = get_args(ParameterName)


class _Constraint(NamedTuple):
    """A setting's name among the prior's leaves, and the map from all real numbers to its domain, with its inverse."""

    leaf: str
    constrained: Callable[[Array], Array]
    free: Callable[[float], float]
    least: float


# A change of the free number by 1 is a factor of e, so that all are tuned at the same rate.
_POSITIVE = (jnp.exp, lambda value: float(np.log(value)))
_CONSTRAINTS: Mapping[str, _Constraint] = {
    "noise_floor": _Constraint("noise_floor", *_POSITIVE, least=1e-12),
    "tolerance": _Constraint("tolerance", *_POSITIVE, least=1e-12),
    "concentration": _Constraint(
        "concentration", lambda free: 1 - jnp.exp(free), lambda value: float(np.log(1 - value)), least=-np.inf
    ),
    "noise_share": _Constraint(
        "noise_share", jax.nn.sigmoid, lambda value: float(np.log(value) - np.log1p(-value)), least=1e-6
    ),
    "covariance_scale": _Constraint("scale", *_POSITIVE, least=1e-12),
    "degrees_of_freedom": _Constraint("degrees_of_freedom", *_POSITIVE, least=1e-3),
}


def check_parameters(names: Sequence[str], config: DetectionConfig) -> None:
    """Checks the names of what is to be tuned.

    Raises:
        InputError: none, one twice, an unknown one, or one that says nothing without another.
    """
    if not names:
        raise InputError(f"parameters is empty; choose from {', '.join(PARAMETERS)}")
    for name in names:
        check_choice("parameters", name, PARAMETERS)
    if len(set(names)) < len(names):
        raise InputError(f"parameters {', '.join(names)} has a name twice")
    together = ("covariance_scale", "degrees_of_freedom")
    tuned = [name for name in together if name in names]
    if len(tuned) == 1 and getattr(config, tuned[0]) is None:
        raise InputError(f"parameters: {' and '.join(together)} go together; tune both, or set both in the config")


def free_values(names: Sequence[str], prior: Prior) -> Float[np.ndarray, " p"]:
    """The free numbers of a prior's settings; those on the border of their domain are moved inside."""
    values = []
    for name in names:
        constraint = _CONSTRAINTS[name]
        value = getattr(prior, constraint.leaf)
        values.append(constraint.free(max(constraint.least, 0.02 if value is None else float(value))))
    return np.array(values)


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


def with_settings(prior: Prior, names: Sequence[str], free: Float[Array, " p"]) -> Prior:
    """The prior with these settings in place of its own; differentiable with respect to the free numbers."""
    leaves = {
        _CONSTRAINTS[name].leaf: _CONSTRAINTS[name].constrained(free[position]) for position, name in enumerate(names)
    }
    if "noise_share" in leaves:
        leaves["noise_strength"] = jnp.asarray(FIXED, free.dtype)
    return dataclasses.replace(prior, **leaves)
