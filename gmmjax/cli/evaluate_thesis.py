"""`gmmjax evaluate thesis`."""

from pathlib import Path
from typing import Annotated

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.cli.evaluate import DONE, FAILED
from gmmjax.errors import InputError, check_seed
from gmmjax.thesis.chapter4 import PARTS, PartName


def evaluate_thesis(
    *,
    out: Annotated[Path, "DIR"],
    parts: tuple[PartName, ...] = PARTS,
    quick: bool = False,
    first_seed: int = 0,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Reproduce chapter 4 of the thesis: its figures and tables, next to the published numbers.

    Each part is written as soon as it is done; other parts can be added later.

    Args:
        out: folder for the tables (Markdown and CSV) and figures (PNG); created if missing.
        parts: "clustering": figures 4.1 and 4.2; "filtering": figure 4.6, localised maps without and with the outlier
            filter; "gaussians": figure 4.9; "surveys": figures 4.10 and 4.12, frames and maps. Volumetric maps need the
            extra `open3d`.
        quick: a small run that takes a minute or two.
        first_seed: first seed; the others follow.
        overwrite: replace parts that are there.
        quiet: print nothing but errors.
    """
    from gmmjax.reporting import console
    from gmmjax.thesis.chapter4.chapter import print_part, run_chapter

    check_seed("--first-seed", first_seed)
    if not parts:
        raise InputError("--parts is empty; leave it out for all parts")
    use_compilation_cache()
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        results = run_chapter(out, parts, first_seed=first_seed, quick=quick, overwrite=overwrite, progress=progress)
    for part in results:
        if not quiet:
            print_part(part)
    if not quiet:
        console.print_plot(out, "Tables and figures")
    failures = [failure for part in results for failure in part.failures]
    console.print_failures(failures)
    return FAILED if failures else DONE
