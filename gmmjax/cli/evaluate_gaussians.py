"""`gmmjax evaluate gaussians`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import tyro

from gmmjax.changes.config import METHODS, DetectionConfig, Method
from gmmjax.cli.compilation_cache import use_compilation_cache
from gmmjax.errors import InputError


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`evaluate_gaussians`, whatever the arguments."""
    del arguments
    return evaluate_gaussians


def evaluate_gaussians(
    *,
    methods: tuple[Method, ...] = METHODS,
    seeds: int = 10,
    first_seed: int = 0,
    restarts: int = DetectionConfig.restarts,
    points: int = 1000,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    quiet: bool = False,
) -> int:
    """Precision, recall and F1 on the thesis's artificial scenes: (+1) (+2) (-1) (-2) (-1 +1), low and medium overlap.

    Args:
        methods: detection methods.
        seeds: scenes of each condition.
        first_seed: of the scenes; the others follow on.
        restarts: random starts of each cloud's fit.
        points: points drawn from each Gaussian.
        out: also write the table there: .csv, .json or .md, by the ending.
        quiet: print nothing but errors.
    """
    from gmmjax.clouds import atomic_write
    from gmmjax.evaluation import gaussians
    from gmmjax.reporting import console

    writers = {".csv": gaussians.to_csv, ".json": gaussians.to_json, ".md": gaussians.to_markdown}
    if out is not None and out.suffix not in writers:
        raise InputError(f"--out {out}: the ending must be one of {', '.join(writers)}")
    if seeds < 1:
        raise InputError(f"--seeds {seeds} must be at least 1")
    if out is not None and not out.resolve().parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}; make it first")
    use_compilation_cache()
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        rows = gaussians.evaluate_gaussians(
            methods,
            range(first_seed, first_seed + seeds),
            config=DetectionConfig(restarts=restarts),
            points=points,
            progress=progress,
        )
    if out is not None:
        with atomic_write(out) as file:
            file.write(writers[out.suffix](rows).encode())
    if not quiet:
        console.print_evaluation([row.to_dict() for row in rows], gaussians.summary(rows))
    return 0
