import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import InputError, Prior
from gmmjax.tuning import check_gradient


def test_agrees_where_the_gradient_is_right():
    result = check_gradient(lambda x, y: jnp.sum(jnp.sin(x) * y[0]), np.arange(5.0), (np.array(2.0),))
    assert result.largest_error < 1e-9
    assert [entry.name for entry in result.entries] == [*(f"[0][{index}]" for index in range(5)), "[1][0]"]
    assert result.entries[0].gradient == pytest.approx(2)


def test_finds_a_wrong_gradient():
    @jax.custom_jvp
    def square(x):
        return x**2

    square.defjvp(lambda primals, tangents: (square(*primals), 2.02 * primals[0] * tangents[0]))
    result = check_gradient(square, 3.0)
    assert result.largest_error == pytest.approx(0.01, rel=0.05)
    assert "[0]" in str(result) and "6.06" in str(result)


def test_says_what_the_differences_are_good_for():
    smooth, kinked = (check_gradient(function, 1.0) for function in (jnp.exp, lambda x: jnp.abs(x - 1.001)))
    assert smooth.entries[0].resolution < 1e-8
    assert kinked.entries[0].resolution > 0.1


def test_names_the_leaves_of_a_prior():
    result = check_gradient(lambda prior: prior.noise_floor**2 * prior.concentration, Prior(0.5, 3.0))
    gradients = {entry.name: entry.gradient for entry in result.entries}
    assert gradients["[0].noise_floor"] == pytest.approx(3) and gradients["[0].concentration"] == pytest.approx(9)
    assert gradients["[0].tolerance"] == 0 and result.largest_error < 1e-9


def test_compares_some_entries_of_a_large_array():
    result = check_gradient(lambda x: jnp.sum(x**3), np.ones((40, 3)), max_entries=4)
    assert len(result.entries) == 4 and result.largest_error < 1e-9


def test_a_gradient_that_is_not_a_number_is_no_agreement():
    result = check_gradient(lambda x: jnp.where(x > 0, x, jnp.sqrt(x - 1)), 1.0)
    assert np.isnan(result.largest_error)


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (lambda x: x * jnp.ones(2), (1.0,), "one finite number"),
        (lambda x: x / 0, (1.0,), "one finite number"),
        (lambda: jnp.ones(()), (), "nothing to differentiate"),
    ],
)
def test_says_what_cannot_be_checked(function, arguments, message):
    with pytest.raises(InputError, match=message):
        check_gradient(function, *arguments)
