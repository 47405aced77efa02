"""`gmmjax demo`."""

from pathlib import Path
from typing import Annotated

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.errors import check_seed

DEFAULT_FOLDER = Path("gmmjax-demo")


def demo(
    *,
    out: Annotated[Path, "DIR"] = DEFAULT_FOLDER,
    seed: int = 0,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Simulate two scans of a storehouse, detect the changes, and compare them with the truth.

    A terrestrial scanner surveys the storehouse twice, in colour; meanwhile two things appeared, two disappeared and
    two moved. The scans and the poses of the scanner are kept, so that `gmmjax detect` can be tried on them.

    Args:
        out: folder for the scans (in scene/) and the detected changes (in result/).
        seed: seed of the scene.
        overwrite: replace an earlier demo.
        quiet: print nothing but errors.
    """
    from gmmjax.changes import DetectionConfig, detect_changes
    from gmmjax.clouds import read_cloud, read_views
    from gmmjax.reporting import console
    from gmmjax.reporting.result_folder import check_result_folder, result_files, write_result
    from gmmjax.reporting.scene_files import check_scene_folder, write_surveyed_scene
    from gmmjax.scenes import storehouse

    scene_folder, result_folder = out / "scene", out / "result"
    check_seed("--seed", seed)
    check_scene_folder(scene_folder, overwrite=overwrite, surveyed=True)
    check_result_folder(result_folder, overwrite=overwrite)
    use_compilation_cache()
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        progress("Simulating", 0.0)
        colored = storehouse(seed)
        write_surveyed_scene(scene_folder, colored, settings={"seed": seed}, overwrite=overwrite)
        clouds = read_cloud(scene_folder / "before.ply"), read_cloud(scene_folder / "after.ply")
        views = [read_views(scene_folder / f"views_{side}.json") for side in ("before", "after")]
        changes = detect_changes(
            *clouds,
            config=DetectionConfig(unit="m"),
            views_before=views[0],
            views_after=views[1],
            progress=progress,
        )
        write_result(result_folder, *clouds, changes, overwrite=overwrite)
    if not quiet:
        console.print_changes(changes)
        console.print_truth(colored.scene, changes)
        console.print_files(result_folder, result_files(result_folder))
        console.print_report_hint(result_folder / "report.html")
    return 0
