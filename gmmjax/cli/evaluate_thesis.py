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
    """Reproduce chapter 4 of the thesis: its figures and tables as a page, next to the published numbers, and as CSV.

    Finished results are kept in the folder: after an interruption the same command resumes, and other parts can be
    added later.

    Args:
        out: folder for index.html and the tables; created if missing.
        parts: "grid": figure 3.9, scores of the grid search; "clustering": figures 4.1 and 4.2; "filtering": figure
            4.6, localised maps without and with the outlier filter; "gaussians": figure 4.9; "surveys": figures 4.10
            and 4.12, frames and maps. Volumetric maps need the extra `open3d`.
        quick: a small run that takes a minute or two.
        first_seed: first seed; the others follow.
        overwrite: discard an earlier run in the folder.
        quiet: print nothing but errors.
    """
    from gmmjax.reporting import console
    from gmmjax.thesis.chapter4 import Plan, run_chapter
    from gmmjax.thesis.report import open_folder, print_thesis, write_results

    check_seed("--first-seed", first_seed)
    if not parts:
        raise InputError("--parts is empty; leave it out for all parts")
    plan = Plan.quick(first_seed) if quick else Plan(first_seed)
    journal = open_folder(out, plan, overwrite=overwrite)
    use_compilation_cache()
    try:
        with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
            results = run_chapter(plan, parts, journal, progress=progress)
            progress("Writing the page", 1.0)
            write_results(out, results)
    except KeyboardInterrupt:
        console.print_note(f"{len(journal)} results are kept in {out}; the same command goes on where it was")
        raise
    if not quiet:
        print_thesis(results, out)
    console.print_failures(results.failures)
    return FAILED if results.failures else DONE
