"""`gmmjax demo`."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import tyro

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.errors import check_seed

DEFAULT_FOLDER = Path("gmmjax-demo")
SETTINGS: Mapping[str, Any] = {}


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`demo`, whatever the arguments."""
    del arguments
    return demo


def demo(
    *,
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = DEFAULT_FOLDER,
    seed: int = 0,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Simulate a pair of scans, detect the changes, and say where the results lie.

    Five Gaussians, of which one disappears while another appears.

    Args:
        out: folder for the scene (in scene/) and what was found (in result/).
        seed: of the scene.
        overwrite: replace an earlier demo.
        quiet: print nothing but errors.
    """
    import jax

    from gmmjax.changes import DetectionConfig, detect_changes
    from gmmjax.clouds import read_cloud
    from gmmjax.reporting import console
    from gmmjax.reporting.result_folder import check_result_folder, result_files, write_result
    from gmmjax.reporting.scene_files import check_scene_folder, write_scene
    from gmmjax.scenes import random_scene

    scene_folder, result_folder = out / "scene", out / "result"
    check_seed("--seed", seed)
    check_scene_folder(scene_folder, overwrite=overwrite)
    check_result_folder(result_folder, overwrite=overwrite)
    use_compilation_cache()
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        scene = random_scene(jax.random.key(seed), start=5, appeared=1, disappeared=1)
        write_scene(scene_folder, scene, settings={"seed": seed}, overwrite=overwrite)
        clouds = read_cloud(scene_folder / "before.ply"), read_cloud(scene_folder / "after.ply")
        changes = detect_changes(*clouds, config=DetectionConfig(**SETTINGS), progress=progress)
        write_result(result_folder, *clouds, changes, overwrite=overwrite)
    if not quiet:
        console.print_changes(changes)
        console.print_truth(scene)
        console.print_files(result_folder, result_files(result_folder))
        console.print_report_hint(result_folder / "report.html")
    return 0
