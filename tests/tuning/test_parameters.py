import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax import DetectionConfig, InputError
from gmmjax.tuning import PARAMETERS, joint_prior
from gmmjax.tuning.parameters import check_parameters, free_values, settings_of, with_free_values

PRIOR = joint_prior(0.003, 0.02)
TOGETHER = ("covariance_scale", "degrees_of_freedom")


@given(st.lists(st.floats(-20, 20), min_size=len(PARAMETERS), max_size=len(PARAMETERS)))
def test_every_free_number_is_a_setting_that_a_config_takes(free):
    settings = settings_of(PARAMETERS, np.array(free))
    config = DetectionConfig(**settings)
    assert config.to_dict().items() >= settings.items()


def test_free_values_are_the_inverse():
    settings = settings_of(PARAMETERS, np.linspace(-2, 1, len(PARAMETERS)))
    prior = DetectionConfig(**settings).over(PRIOR)
    np.testing.assert_allclose(free_values(PARAMETERS, prior, 1.0), np.linspace(-2, 1, len(PARAMETERS)), atol=1e-9)


def test_where_the_prior_says_nothing_tuning_starts_at_a_share_of_the_spread():
    started = settings_of(PARAMETERS, free_values(PARAMETERS, joint_prior(0.0, 0.0), 20.0))
    assert started["tolerance"] == pytest.approx(0.02) and started["covariance_scale"] == pytest.approx(2.0)
    assert started["degrees_of_freedom"] == pytest.approx(1.0)


def test_the_tuned_prior_is_that_of_the_config(float64):
    free = np.array([-5.0, -4.0, 1.0, -3.0])
    names = ("noise_floor", "tolerance", "concentration", "noise_share")
    tuned = with_free_values(PRIOR, names, jnp.asarray(free))
    config = DetectionConfig(**settings_of(names, free)).over(PRIOR)
    for own, other in zip(jax.tree.leaves(tuned), jax.tree.leaves(config), strict=True):
        assert float(own) == pytest.approx(float(other))


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "is empty"),
        (("noise",), "noise_floor"),
        (("tolerance", "tolerance"), "twice"),
        (("covariance_scale",), "go together"),
    ],
)
def test_says_what_cannot_be_tuned(names, message):
    with pytest.raises(InputError, match=message):
        check_parameters(names, DetectionConfig())


def test_two_that_go_together_can_be_tuned_one_by_one_where_the_other_is_set():
    check_parameters(TOGETHER[:1], DetectionConfig(covariance_scale=0.1, degrees_of_freedom=5.0))
    check_parameters(TOGETHER, DetectionConfig())
