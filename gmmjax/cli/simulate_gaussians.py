"""`gmmjax simulate gaussians --out DIR`."""

from pathlib import Path
from typing import Annotated, Literal

from gmmjax.errors import check_seed

SCENE_FILES = {
    "before.ply": "the first cloud",
    "after.ply": "the second cloud",
    "truth_before.npy": "-1 or the number of the change, per point",
    "truth_after.npy": "-1 or the number of the change, per point",
    "scene.json": "the Gaussians",
}


def simulate_gaussians(
    *,
    out: Annotated[Path, "DIR"],
    start: int = 5,
    appeared: int = 1,
    disappeared: int = 1,
    overlap: Literal["low", "medium"] = "low",
    points: int = 1000,
    seed: int = 0,
    fixed: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """A pair of clouds drawn from Gaussians, with the truth.

    Args:
        out: folder for the scene; created if missing.
        start: Gaussians in the before cloud.
        appeared: new Gaussians in the after cloud.
        disappeared: Gaussians of the before cloud that are not in the after cloud.
        overlap: "low" has the means in [-4, 4] m, "medium" in [-2, 2] m.
        points: points drawn from each Gaussian.
        seed: of the scene; the same seed gives the same scene.
        fixed: the fixed scene of four Gaussians, then three more, in place of a random one.
        overwrite: replace a previous scene in the output folder.
        quiet: print nothing but errors.
    """
    import jax

    from gmmjax.reporting import console
    from gmmjax.reporting.scene_files import check_scene_folder, write_scene
    from gmmjax.scenes import fixed_scene, random_scene

    check_seed("--seed", seed)
    check_scene_folder(out, overwrite=overwrite)
    key = jax.random.key(seed)
    if fixed:
        scene = fixed_scene(key, points=points)
        settings: dict[str, object] = {"fixed": True, "points": points, "seed": seed}
    else:
        numbers = {"start": start, "appeared": appeared, "disappeared": disappeared, "points": points}
        scene = random_scene(key, overlap=overlap, **numbers)
        settings = {**numbers, "overlap": overlap, "seed": seed}
    write_scene(out, scene, settings=settings, overwrite=overwrite)
    if not quiet:
        console.print_files(out, SCENE_FILES)
    return 0
