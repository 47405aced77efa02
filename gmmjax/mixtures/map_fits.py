"""Fits of many clouds from many random starts, shared out over cores or devices."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import ArrayLike, Float, PRNGKeyArray

from gmmjax._host import is_traced, to_numpy
from gmmjax._programs import lru_jit
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures.annihilation import Fit, FitSettings
from gmmjax.mixtures.checked_points import checked_points
from gmmjax.mixtures.gaussian_mixture_model import fit_by_annihilation
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.parallel import Precision, in_precision, map_on_cores, stacked
from gmmjax.mixtures.precision_check import scored_in_double
from gmmjax.mixtures.prior import Prior, check_prior
from gmmjax.mixtures.seeding import initial_mixture
from gmmjax.mixtures.standardisation import Standardisation
from gmmjax.mixtures.weighted_points import WeightedPoints

# The default noise floor, in units of the points' spread. In float32 the rounding of the second moments is about 7e-4
# of the spread, and the floor must stand well above it.
RELATIVE_NOISE_FLOOR = {"float64": 1e-3, "float32": 5e-3}


def default_noise_floor(points: Float[np.ndarray, "n d"]) -> float:
    """The noise floor of a fit in float64 where nothing else is known, in the unit of the points."""
    return RELATIVE_NOISE_FLOOR["float64"] * float(np.sqrt(points.var(axis=0).mean()))


class _Task(NamedTuple):
    """One fit in its frame: padded points, prior, and the start that replaces random seeds."""

    points: WeightedPoints
    prior: Prior
    start: GaussianMixture | None


class FramedCloud(NamedTuple):
    """A cloud that is ready for fits from any number of starts, on the host.

    Attributes:
        task: what is fitted, in its frame.
        frame: of the fits.
        observations: the mass of all points.
    """

    task: _Task
    frame: Standardisation
    observations: float

    @classmethod
    def of(
        cls,
        cloud: WeightedPoints,
        prior: Prior | None,
        settings: FitSettings,
        start: GaussianMixture | None = None,
        precision: Precision = "float64",
    ) -> "FramedCloud":
        """A checked cloud in its frame; arguments as of `map_fits`."""
        frame = Standardisation.of(cloud)
        if prior is not None:
            check_prior(prior, cloud.points.shape[1])
        task = _Task(
            points=frame.enter(cloud).padded(),
            prior=_prior_in_frame(prior, frame, settings, precision),
            start=None if start is None else frame.enter_mixture(jax.tree.map(np.asarray, start)),
        )
        return cls(task, frame, float(cloud.mass.sum()))

    def fit(self, key: PRNGKeyArray, max_components: int, settings: FitSettings) -> Fit:
        """One fit in float64, on the core that calls; NumPy arrays in the unit of the points."""
        with jax.enable_x64(True):
            fit = to_numpy(_fit_in_two(self.task, key, max_components=max_components, settings=settings))
        return self.frame.leave_fit(fit, self.observations)


_Job = tuple[_Task, PRNGKeyArray]
_Run = Callable[..., list[Fit]]


def map_fits(
    clouds: Sequence[ArrayLike | WeightedPoints],
    *,
    key: PRNGKeyArray,
    max_components: int = 25,
    prior: Prior | None = None,
    restarts: int = 1,
    starts: Sequence[GaussianMixture] | None = None,
    settings: FitSettings = FitSettings(),
    precision: Precision = "float64",
    devices: Sequence[jax.Device] | None = None,
    progress: Callable[[], None] | None = None,
) -> list[Fit]:
    """Fits a mixture to each of many clouds, from one or more starts, by what is fastest here.

    On the CPU every core takes one fit after the other from a common queue, so that none waits for the longest. On
    given devices (GPUs, or host devices) clouds of equal padded size are stacked and sharded over them; on a GPU fits
    run side by side, on a host device one after the other.

    Args:
        clouds: points [n, d] each, or `WeightedPoints` with masses and scatter; their sizes may differ.
        key: random key; every cloud and restart gets its own part.
        max_components: K_max.
        prior: of all clouds, in their unit; default as in `fit_mixture`.
        restarts: fits of each cloud.
        starts: a mixture for each cloud to start from in place of random seeds, such as the fit of an earlier scan of
            the same place; then `max_components` is its number of slots and there are no restarts.
        settings: how EM runs.
        precision: as in `fit_mixture`.
        devices: where to compute; default the CPU's cores, or all GPUs where there are any.
        progress: called after each finished fit on the cores, from any thread.

    Returns:
        For each cloud a `Fit` with a leading axis of restarts, NumPy arrays in the cloud's unit; see `best_fit`.

    Raises:
        InputError: as `fit_mixture`, and says which cloud; a number of starts that does not fit the clouds.
    """
    if is_traced(clouds, key, prior, starts):
        raise InputError("map_fits is a host function: call it outside of jit and vmap, where fit_mixture can be used")
    check_restarts(restarts, precision)
    if not len(clouds):
        raise InputError("clouds is empty; give at least one")
    if starts is not None and len(starts) != len(clouds):
        raise InputError(f"starts has {len(starts)} mixtures for {len(clouds)} clouds; give one a cloud")
    checked = []
    for index, cloud in enumerate(clouds):
        try:
            checked.append(_checked(cloud, settings))
        except InputError as error:
            raise InputError(f"clouds[{index}]: {error}") from error
    dimensions = sorted({cloud.points.shape[1] for cloud in checked})
    if len(dimensions) > 1:
        raise InputError(f"clouds have {dimensions[0]} to {dimensions[-1]} dimensions; map those of each apart")
    keys = [list(jax.random.split(own, restarts)) for own in jax.random.split(key, len(clouds))]
    return fits_of(checked, keys, max_components, prior, starts, settings, precision, devices, progress)


def fits_of(
    clouds: Sequence[WeightedPoints],
    keys: Sequence[Sequence[PRNGKeyArray]],
    max_components: int,
    prior: Prior | None,
    starts: Sequence[GaussianMixture] | None,
    settings: FitSettings,
    precision: Precision,
    devices: Sequence[jax.Device] | None,
    progress: Callable[[], None] | None,
) -> list[Fit]:
    """`map_fits` for checked clouds, with the keys of each cloud's restarts."""
    if starts is not None:
        _check_starts(starts, clouds, restarts=len(keys[0]))
    for index, cloud in enumerate(clouds):
        slots = max_components if starts is None else len(starts[index].weights)
        check_components(slots, int(np.count_nonzero(cloud.mass)))
    framed = [
        FramedCloud.of(cloud, prior, settings, None if starts is None else starts[index], precision)
        for index, cloud in enumerate(clouds)
    ]
    if devices is None and jax.default_backend() != "cpu":
        devices = jax.devices()
    run: _Run = _on_cores if devices is None else functools.partial(_on_devices, devices=devices)
    run = functools.partial(run, max_components=max_components, settings=settings)
    jobs = [(cloud.task, key) for cloud, of_cloud in zip(framed, keys, strict=True) for key in of_cloud]
    results = iter(run(jobs, precision=precision, progress=progress))
    fits = []
    for ready, of_cloud in zip(framed, keys, strict=True):
        own = [next(results) for _ in of_cloud]
        if precision == "float32":
            own = _trusted(own, ready.task, of_cloud, run, settings)
        # One by one in NumPy: to trace a `vmap` would take longer than a small fit.
        fits.append(stacked([ready.frame.leave_fit(fit, ready.observations) for fit in own]))
    return fits


def fit_in_frame(
    points: WeightedPoints,
    key: PRNGKeyArray,
    prior: Prior | None,
    start: GaussianMixture | None,
    max_components: int,
    settings: FitSettings,
) -> Fit:
    """One traced fit, from and to the unit of the points; see `fit_mixture`."""
    prior, start = jax.tree.map(lambda leaf: _in_dtype(leaf, points.points.dtype), (prior, start))
    frame = Standardisation.of(points)
    in_frame = _prior_in_frame(prior, frame, settings, str(points.points.dtype))
    start = None if start is None else frame.enter_mixture(start)
    fit = _fit(_Task(frame.enter(points), in_frame, start), key, max_components, settings)
    return frame.leave_fit(fit, jnp.sum(points.mass))


def _in_dtype(leaf: Any, dtype: Any) -> JaxArray:
    return jnp.asarray(leaf, None if jnp.issubdtype(jnp.result_type(leaf), jnp.bool_) else dtype)


def check_restarts(restarts: int, precision: str) -> None:
    """Checks what all of a call's fits have in common.

    Raises:
        InputError: no restart, or an unknown precision.
    """
    check_choice("precision", precision, get_args(Precision))
    if restarts < 1:
        raise InputError(f"restarts={restarts} must be at least 1")


def check_components(max_components: int, points: int) -> None:
    """Checks K_max against the number of points.

    Raises:
        InputError: it is not between 1 and that number.
    """
    if not 1 <= max_components <= points:
        raise InputError(
            f"max_components={max_components} must be at least 1 and at most the number of points, {points}"
        )


def _check_starts(starts: Sequence[GaussianMixture], clouds: Sequence[WeightedPoints], restarts: int) -> None:
    if restarts > 1:
        raise InputError(f"restarts={restarts}: from a given start all fits are the same; leave restarts at 1")
    for start, cloud in zip(starts, clouds, strict=True):
        if start.dimension != cloud.points.shape[1]:
            raise InputError(f"a start in {start.dimension} dimensions is for no points in {cloud.points.shape[1]}")
    slots = sorted({len(start.weights) for start in starts})
    if len(slots) > 1:
        raise InputError(f"starts have {slots[0]} to {slots[-1]} slots; give all as many, with `compacted`")


def _checked(cloud: ArrayLike | WeightedPoints, settings: FitSettings) -> WeightedPoints:
    if isinstance(cloud, WeightedPoints):
        return checked_points(cloud.points, cloud.mass, settings.covariance_type, cloud.scatter)
    return checked_points(cloud, None, settings.covariance_type)


def _prior_in_frame(prior: Prior | None, frame: Standardisation, settings: FitSettings, precision: str) -> Prior:
    if prior is not None:
        return frame.enter_prior(prior)
    return Prior.figueiredo_jain(len(frame.origin), RELATIVE_NOISE_FLOOR[precision], settings.covariance_type)


def _on_cores(
    jobs: Sequence[_Job],
    *,
    max_components: int,
    settings: FitSettings,
    precision: Precision,
    progress: Callable[[], None] | None,
) -> list[Fit]:
    """A common queue: a core that is done takes the next."""
    fit_one = functools.partial(_fit_in_two, max_components=max_components, settings=settings)
    results = map_on_cores(fit_one, jobs, precision, progress)
    return [_nth(results, nth) for nth in range(len(jobs))]


def _on_devices(
    jobs: Sequence[_Job],
    *,
    devices: Sequence[jax.Device],
    max_components: int,
    settings: FitSettings,
    precision: Precision,
    progress: Callable[[], None] | None,
) -> list[Fit]:
    """Clouds of equal padded size together, their stack sharded over the devices."""
    results: dict[int, Fit] = {}
    sizes = [task.points.points.shape for task, _ in jobs]
    for size in dict.fromkeys(sizes):
        numbers = [number for number, own in enumerate(sizes) if own == size]
        # Filled up, so that every device has as many.
        filled = numbers + numbers[:1] * (-len(numbers) % len(devices))
        tasks = stacked([jobs[number][0] for number in filled])
        keys = jnp.stack([jobs[number][1] for number in filled])
        with jax.enable_x64(precision == "float64"):
            fits = _sharded_fits(in_precision(tasks, precision), keys, tuple(devices), max_components, settings)
            fits = to_numpy(fits)
        results.update((number, _nth(fits, nth)) for nth, number in enumerate(numbers))
        if progress is not None:
            for _ in numbers:
                progress()
    return [results[number] for number in range(len(jobs))]


@functools.partial(jax.jit, static_argnames=("devices", "max_components", "settings"))
def _sharded_fits(
    tasks: Any, keys: JaxArray, devices: tuple[jax.Device, ...], max_components: int, settings: FitSettings
) -> Fit:
    def fit_one(job: _Job) -> Fit:
        return _fit(*job, max_components, settings)

    # Side by side fills a GPU; on a CPU all would wait for the longest.
    over_own = functools.partial(jax.lax.map, fit_one) if devices[0].platform == "cpu" else jax.vmap(fit_one)
    mesh = jax.sharding.Mesh(np.array(devices), ("fits",))
    shard = jax.sharding.PartitionSpec("fits")
    fits: Fit = jax.shard_map(over_own, mesh=mesh, in_specs=shard, out_specs=shard, check_vma=False)((tasks, keys))
    return fits


def _started(task: _Task, key: PRNGKeyArray, max_components: int) -> _Task:
    if task.start is not None:
        return task
    points, prior = jax.lax.stop_gradient((task.points, task.prior))
    return task._replace(start=initial_mixture(points, max_components, prior, key))


def _fit(task: _Task, key: PRNGKeyArray, max_components: int, settings: FitSettings) -> Fit:
    points, prior, start = _started(task, key, max_components)
    assert start is not None
    return fit_by_annihilation(points, start, prior, settings)


_compiled_start, _compiled_fit = lru_jit(_started), lru_jit(_fit)


def _fit_in_two(task: _Task, key: PRNGKeyArray, max_components: int, settings: FitSettings) -> Fit:
    """`_fit` as two programs: in one, XLA's threads wait beside the loop, for half as much CPU again (measured)."""
    started = _compiled_start(task, key, max_components=max_components)
    return _compiled_fit(started, key, max_components=max_components, settings=settings)


def _trusted(
    fits: Sequence[Fit], task: _Task, keys: Sequence[PRNGKeyArray], run: _Run, settings: FitSettings
) -> list[Fit]:
    """The fits of single precision, scored in double; those that it got wrong are computed again."""
    scored, right = scored_in_double(stacked(fits), task.points, settings)
    trusted = [_nth(scored, nth) for nth in range(len(fits))]
    doubtful = np.flatnonzero(~right).tolist()
    if doubtful:
        again = run([(task, keys[nth]) for nth in doubtful], precision="float64", progress=None)
        for nth, fit in zip(doubtful, again, strict=True):
            trusted[nth] = fit
    return trusted


def _nth(fits: Fit, nth: int) -> Fit:
    own: Fit = jax.tree.map(lambda leaf: np.asarray(leaf[nth]), fits)
    return own
