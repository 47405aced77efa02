r"""Fixed points of maps of parameters, and derivatives through them (optimistix).

Where $\theta^* = F(\theta^*, p)$, the implicit function theorem gives
$\mathrm{d}\theta^* / \mathrm{d}p = (I - \partial F / \partial \theta)^{-1} \, \partial F / \partial p$: one linear
system, whatever the number of steps that led there.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, Int

from gmmjax._matrix_products import in_full_precision

_Parameters = TypeVar("_Parameters")

# Steps of the past that the next one is made of.
MEMORY = 8
# Relative to the squares of the past steps' differences: below it they are taken for dependent.
RIDGE = 1e-14
# A residual that grows by more than this factor says that the extrapolation went astray.
LARGEST_GROWTH = 2.0

# Of the linear systems of derivatives: the residual, relative to the right-hand side.
LINEAR_TOLERANCE = 1e-9
# Products kept of the linear systems' Krylov spaces, and how often a new space is begun.
KRYLOV, RESTARTS = 60, 20
# What rounding may add to the residual of a system that was solved.
LARGEST_SLACK = 10.0


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
    solver = AndersonAcceleration(rtol=0.0, atol=tolerance)
    solution: Any = optx.fixed_point(function, solver, start, held, max_steps=max_steps, throw=False)
    converged = solution.result == optx.RESULTS.successful
    linear_tolerance = max(tolerance, LINEAR_TOLERANCE)
    parameters = _with_implicit_derivatives(function, solution.value, arguments, converged, linear_tolerance)
    return FixedPoint(parameters, solution.stats["num_steps"], converged)


# Optimistix's own adjoint raises at run time where a system cannot be solved, for a whole batch if for one of it; here
# that is a derivative of NaN.
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
    solution = _solved(lambda own: jax.tree.map(jnp.subtract, own, derivative(own)), pushed, tolerance)
    # A factor, not a choice between two branches, so that the rule is linear in the tangent and can be transposed.
    factor = jnp.where(trusted, 1.0, jnp.nan)
    return parameters, jax.tree.map(lambda leaf: leaf * factor.astype(leaf.dtype), solution)


class _Past(eqx.Module):
    """The last steps of `AndersonAcceleration`, one a row, filled up with zeros.

    `image` is where the map led from the last parameters that were accepted.
    """

    images: Float[JaxArray, "m p"]
    residuals: Float[JaxArray, "m p"]
    known: Bool[JaxArray, " m"]
    image: Float[JaxArray, " p"]
    least_residual: Float[JaxArray, ""]
    error: Float[JaxArray, ""]


class AndersonAcceleration(optx.AbstractFixedPointSolver[Any, Any, _Past]):
    """Anderson's acceleration of a fixed-point iteration (Walker and Ni 2011), with the plain step to fall back on.

    EM creeps where components overlap: its error shrinks by the same factor near 1 every step. The combination of the
    last images whose residuals cancel best makes tens of steps of hundreds. Where it leads astray, to a residual that
    is not finite or grows, the iteration goes on from the last image, which EM guarantees, with an empty memory.
    """

    rtol: float
    atol: float
    norm: Callable[[Any], JaxArray] = optx.max_norm

    def init(self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any) -> _Past:
        """No past."""
        flat, _ = ravel_pytree(y)
        none = jnp.zeros((MEMORY, flat.size), flat.dtype)
        infinity = jnp.asarray(jnp.inf, flat.dtype)
        return _Past(none, none, jnp.zeros(MEMORY, bool), flat, infinity, infinity)

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: _Past, tags: Any) -> tuple[Any, _Past, Any]:
        """One evaluation of the map and one combination of the last ones."""
        mapped, aux = fn(y, args)
        flat, unravel = ravel_pytree(y)
        image = ravel_pytree(mapped)[0]
        residual = image - flat
        size = self.norm(residual)
        astray = ~(size <= LARGEST_GROWTH * state.least_residual)
        error = jnp.where(astray, jnp.inf, size / (self.atol + self.rtol * self.norm(flat)))
        past = _Past(
            images=jnp.roll(state.images, 1, axis=0).at[0].set(image),
            residuals=jnp.roll(state.residuals, 1, axis=0).at[0].set(residual),
            known=jnp.roll(state.known, 1).at[0].set(True),
            image=image,
            least_residual=jnp.minimum(size, state.least_residual),
            error=error,
        )
        forgotten = eqx.tree_at(
            lambda old: (old.known, old.least_residual, old.error),
            state,
            (jnp.zeros_like(state.known), jnp.asarray(jnp.inf, flat.dtype), error),
        )
        following = jnp.where(astray, state.image, jnp.where(error < 1, image, _combined(past)))
        chosen = jax.tree.map(lambda old, new: jnp.where(astray, old, new), forgotten, past)
        return unravel(following), chosen, aux

    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: _Past, tags: Any
    ) -> tuple[JaxArray, optx.RESULTS]:
        """At rest."""
        successful: Any = optx.RESULTS.successful
        return state.error < 1, successful

    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: _Past, tags: Any, result: Any
    ) -> tuple[Any, Any, dict[str, Any]]:
        """Nothing more."""
        return y, aux, {}


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


def _solved(product: Callable[[_Parameters], _Parameters], right: _Parameters, tolerance: float) -> _Parameters:
    """The solution of a linear system by GMRES, or NaN: a derivative is right or is not a number.

    Args:
        product: of the system's matrix with parameters.
        right: the right-hand side.
        tolerance: of the residual, relative to the right-hand side.
    """
    flat, unravel = ravel_pytree(right)

    def solve(product: Callable[[JaxArray], JaxArray], right: JaxArray) -> JaxArray:
        # JAX's GMRES takes vectors shorter than the rounding of 1 for nothing.
        size = jnp.max(jnp.abs(right))
        scale = jnp.where(size > 0, size, 1)
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            solution, _ = jax.scipy.sparse.linalg.gmres(
                product, right / scale, tol=tolerance, restart=KRYLOV, maxiter=RESTARTS, solve_method="incremental"
            )
        solution = jnp.where(size == 0, jnp.zeros_like(right), solution * scale)
        error = jnp.linalg.norm((product(solution) - right) / scale)
        solved = error <= LARGEST_SLACK * tolerance * jnp.linalg.norm(right / scale)
        return jnp.where(solved, solution, jnp.nan)

    # With the same solver for the transposed system, in reverse mode.
    solution: _Parameters = unravel(
        jax.lax.custom_linear_solve(
            lambda own: ravel_pytree(product(unravel(own)))[0], flat, solve, transpose_solve=solve
        )
    )
    return solution
