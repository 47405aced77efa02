r"""Fixed points of maps of parameters, and derivatives through them.

Where $\theta^* = F(\theta^*, p)$, the implicit function theorem gives
$\mathrm{d}\theta^* / \mathrm{d}p = (I - \partial F / \partial \theta)^{-1} \, \partial F / \partial p$: one linear
system, whatever the number of steps that led there.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int

from gmmjax._matrix_products import in_full_precision
from gmmjax._varying import varying_as

_Parameters = TypeVar("_Parameters")

# Steps of the past that the next one is made of.
MEMORY = 8
# Relative to the squares of the past steps' differences: below it they are taken for dependent.
RIDGE = 1e-14
# A residual that grows by more than this factor says that the extrapolation went astray.
LARGEST_GROWTH = 2.0

# Of the linear systems of derivatives: the residual, relative to the right-hand side.
LINEAR_TOLERANCE = 1e-10
# Products kept of the linear systems' Krylov spaces, and at the most.
KRYLOV, MAX_PRODUCTS = 60, 1200
# A residual that shrinks by less says that the space is better extended by the last image than by the residual.
STALLING = 0.9
# What rounding may add to the residual of a system that was solved, as a multiple of the tolerance, or at least this.
LARGEST_SLACK, MIN_SLACK = 10.0, 1e-8


class FixedPoint(NamedTuple):
    """Result of `fixed_point`.

    Attributes:
        parameters: where the map leaves them, or the last ones.
        steps: evaluations of the map.
        converged: whether they rest; where not, their derivatives are NaN.
    """

    parameters: Any
    steps: Int[JaxArray, ""]
    converged: Bool[JaxArray, ""]


def fixed_point(
    function: Callable[[_Parameters, Any], _Parameters],
    start: _Parameters,
    arguments: Any,
    *,
    tolerance: float,
    max_steps: int,
) -> FixedPoint:
    """The parameters that a map leaves as they are, differentiable with respect to the map's arguments.

    Args:
        function: a map of (parameters, arguments), the same at every call, so that it compiles once. Its parameters
            should all be of order 1.
        start: parameters near the fixed point; nothing is differentiated with respect to them.
        arguments: everything else that the map depends on; derivatives are with respect to these.
        tolerance: the largest change of any parameter at rest.
        max_steps: evaluations of the map at the most.
    """
    start, held = jax.lax.stop_gradient((start, arguments))
    end = _iterated(function, start, held, tolerance, max_steps)
    linear_tolerance = max(tolerance, LINEAR_TOLERANCE)
    parameters = _with_implicit_derivatives(function, end.parameters, arguments, end.converged, linear_tolerance)
    return FixedPoint(parameters, end.steps, end.converged)


@eqx.filter_custom_jvp
def _with_implicit_derivatives(
    function: Callable[[_Parameters, Any], _Parameters],
    parameters: _Parameters,
    arguments: Any,
    trusted: Bool[JaxArray, ""],
    tolerance: float,
) -> _Parameters:
    """The parameters, which are a fixed point if they are to be trusted, with their derivatives by the arguments."""
    del function, arguments, trusted, tolerance
    return parameters


@_with_implicit_derivatives.def_jvp
def _implicit_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    function, parameters, arguments, trusted, tolerance = primals
    moved = tangents[2]
    # With derivatives of their own, for those of higher order.
    parameters = _with_implicit_derivatives(function, parameters, arguments, trusted, tolerance)
    unmoved = jax.tree.map(lambda tangent: tangent is None, moved, is_leaf=lambda tangent: tangent is None)
    fixed, differentiated = eqx.partition(arguments, unmoved)
    _, pushed = jax.jvp(lambda own: function(parameters, eqx.combine(own, fixed)), (differentiated,), (moved,))

    _, derivative = jax.linearize(lambda own: function(own, arguments), parameters)
    solution = _solved(lambda own: jax.tree.map(jnp.subtract, own, derivative(own)), pushed, trusted, tolerance)
    return parameters, solution


class _Past(eqx.Module):
    """The last steps of `_iterated`, one a row, filled up with zeros.

    `image` is where the map led from the last parameters that were accepted, by the largest `change`.
    """

    images: Float[JaxArray, "m p"]
    residuals: Float[JaxArray, "m p"]
    known: Bool[JaxArray, " m"]
    image: Float[JaxArray, " p"]
    min_residual: Float[JaxArray, ""]
    change: Float[JaxArray, ""]


def _iterated(
    function: Callable[[_Parameters, Any], _Parameters],
    start: _Parameters,
    arguments: Any,
    tolerance: float,
    max_steps: int,
) -> FixedPoint:
    """Anderson's acceleration of a fixed-point iteration (Walker and Ni 2011), with the plain step to fall back on.

    EM creeps where components overlap: its error shrinks by the same factor near 1 every step. The combination of the
    last images whose residuals cancel best makes tens of steps of hundreds. Where it leads astray, to a residual that
    is not finite or grows, the iteration goes on from the last image, which EM guarantees, with an empty memory.
    """
    flat, unravel = ravel_pytree(start)

    def further(state: tuple[JaxArray, _Past, JaxArray]) -> tuple[JaxArray, _Past, JaxArray]:
        own, past, steps = state
        image = ravel_pytree(function(unravel(own), arguments))[0]
        return *_accelerated(own, image, past, tolerance), steps + 1

    def unfinished(state: tuple[JaxArray, _Past, JaxArray]) -> JaxArray:
        return (state[1].change >= tolerance) & (state[2] < max_steps)

    none, infinity = jnp.zeros((MEMORY, flat.size), flat.dtype), jnp.asarray(jnp.inf, flat.dtype)
    past = _Past(none, none, jnp.zeros(MEMORY, bool), flat, infinity, infinity)
    state = varying_as((flat, past, jnp.asarray(0, jnp.int32)), arguments)
    end, past, steps = jax.lax.while_loop(unfinished, further, state)
    return FixedPoint(unravel(end), steps, past.change < tolerance)


def _accelerated(own: JaxArray, image: JaxArray, past: _Past, tolerance: float) -> tuple[JaxArray, _Past]:
    """Next iterate, and the history with one more evaluation of the map."""
    residual = image - own
    change = jnp.max(jnp.abs(residual))
    astray = ~(change <= LARGEST_GROWTH * past.min_residual)
    known = _Past(
        images=jnp.roll(past.images, 1, axis=0).at[0].set(image),
        residuals=jnp.roll(past.residuals, 1, axis=0).at[0].set(residual),
        known=jnp.roll(past.known, 1).at[0].set(True),
        image=image,
        min_residual=jnp.minimum(change, past.min_residual),
        change=change,
    )
    infinity = jnp.asarray(jnp.inf, own.dtype)
    forgotten = _Past(past.images, past.residuals, jnp.zeros_like(past.known), past.image, infinity, infinity)
    following = jnp.where(astray, past.image, jnp.where(change < tolerance, image, _combined(known)))
    return following, jax.tree.map(lambda old, new: jnp.where(astray, old, new), forgotten, known)


@in_full_precision
def _combined(past: _Past) -> Float[JaxArray, " p"]:
    """The last image, corrected by the differences of images whose residuals' differences explain its residual."""
    known = past.known[1:, None]
    residuals = jnp.where(known, past.residuals[1:] - past.residuals[:1], 0)
    images = jnp.where(known, past.images[1:] - past.images[:1], 0)
    gram = residuals @ residuals.T
    ridge = RIDGE * jnp.trace(gram) + jnp.finfo(gram.dtype).tiny
    shares = jnp.linalg.solve(gram + ridge * jnp.eye(len(gram), dtype=gram.dtype), -residuals @ past.residuals[0])
    return past.image + shares @ images


class _Krylov(NamedTuple):
    """A solution, its residual, and directions (one a row, the last `KRYLOV` of them) with orthonormal images.

    `error` is the size of the residual by a product with the solution itself; infinite until that is computed.
    """

    solution: JaxArray
    residual: JaxArray
    directions: JaxArray
    images: JaxArray
    following: JaxArray
    products: JaxArray
    error: JaxArray


@in_full_precision
def _krylov_solution(
    product: Callable[[JaxArray], JaxArray], right: JaxArray, tolerance: float
) -> tuple[Float[JaxArray, " p"], Float[JaxArray, ""]]:
    """The solution with the least residual, as of GMRES, in the adaptive form of Jiranek and Rozloznik (2010).

    Returns:
        The solution, and the size of its residual.
    """
    kept = min(KRYLOV, len(right))
    size = jnp.linalg.norm(right)

    def further(state: _Krylov) -> _Krylov:
        last = ~(jnp.linalg.norm(state.residual) > tolerance * size) | (state.products >= MAX_PRODUCTS)
        # One product for both, so that it compiles once.
        direction = jnp.where(last, state.solution, state.following)
        image = product(direction)
        error = jnp.where(last, jnp.linalg.norm(right - image), jnp.inf)
        # Twice: once leaves what rounding makes of a nearly dependent image.
        for _ in range(2):
            shares = state.images @ image
            direction, image = direction - shares @ state.directions, image - shares @ state.images
        length = jnp.linalg.norm(image)
        direction, image = direction / length, image / length
        step = image @ state.residual
        residual = state.residual - step * image
        rest = jnp.linalg.norm(residual)
        stalls = rest > STALLING * jnp.linalg.norm(state.residual)
        slot = state.products % kept
        return _Krylov(
            solution=jnp.where(last, state.solution, state.solution + step * direction),
            residual=residual,
            directions=state.directions.at[slot].set(direction),
            images=state.images.at[slot].set(image),
            following=jnp.where(stalls, image, residual / rest),
            products=state.products + 1,
            error=error,
        )

    none = jnp.zeros((kept, len(right)), right.dtype)
    zero, infinity = jnp.asarray(0, jnp.int32), jnp.asarray(jnp.inf, right.dtype)
    start = _Krylov(jnp.zeros_like(right), right, none, none, right / size, zero, infinity)
    end = jax.lax.while_loop(lambda state: jnp.isposinf(state.error), further, varying_as(start, right))
    return end.solution, end.error


def _solved(
    product: Callable[[_Parameters], _Parameters], right: _Parameters, trusted: Bool[JaxArray, ""], tolerance: float
) -> _Parameters:
    """The solution of a linear system, or NaN: a derivative is right or is not a number.

    Args:
        product: of the system's matrix with parameters.
        right: the right-hand side.
        trusted: where false, the solution is NaN unless the right-hand side is 0.
        tolerance: of the residual, relative to the right-hand side.
    """
    flat, unravel = ravel_pytree(right)

    def solve(product: Callable[[JaxArray], JaxArray], right: JaxArray) -> JaxArray:
        size = jnp.max(jnp.abs(right))
        scale = jnp.where(size > 0, size, 1)
        solution, error = _krylov_solution(product, right / scale, tolerance)
        solved = error <= max(LARGEST_SLACK * tolerance, MIN_SLACK) * jnp.linalg.norm(right / scale)
        return jnp.where(size == 0, 0, jnp.where(trusted & solved, solution * scale, jnp.nan))

    # With the same solver for the transposed system, in reverse mode.
    solution: _Parameters = unravel(
        jax.lax.custom_linear_solve(
            lambda own: ravel_pytree(product(unravel(own)))[0], flat, solve, transpose_solve=solve
        )
    )
    return solution
