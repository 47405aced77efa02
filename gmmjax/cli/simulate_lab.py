"""`gmmjax simulate lab --out DIR`."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

from gmmjax.errors import InputError, check_seed


def simulate_lab(
    *,
    out: Annotated[Path, "DIR"],
    kinds: tuple[Literal["frame", "volumetric", "localised"], ...] | None = None,
    bag: Literal["ros1", "ros2", "none"] | None = None,
    frames: int = 16,
    seed: int = 0,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """A laboratory that a robot surveys with its depth camera: bags, maps, and pairs with the truth.

    The five runs of the thesis: from no object to some, back, and two pairs in which objects come and move.

    Args:
        out: folder for the scenes; created if missing. `gmmjax evaluate pairs DIR` scores detectors on its pairs.
        kinds: "frame": single frames of what changed; "volumetric": maps of surfaces, which need Open3D; "localised":
            the points of all frames. Default all that can be made here.
        bag: the kind of bag that each survey is recorded in; default ROS 1 where rosbags is installed.
        frames: of the depth camera in each survey.
        seed: of the objects' places, the paths and the noise; the same seed gives the same scenes.
        overwrite: replace previous scenes in the output folder.
        quiet: print nothing but errors.
    """
    from gmmjax.reporting import console
    from gmmjax.thesis.laboratory.files import LabSettings, check_lab_folder, write_lab

    check_seed("--seed", seed)
    check_lab_folder(out, overwrite=overwrite)
    missing = []
    made = kinds or (("frame", "volumetric", "localised") if _has_open3d() else ("frame", "localised"))
    if kinds is None and "volumetric" not in made:
        missing.append("no volumetric maps: Open3D is not here (pip install '.[open3d]')")
    if bag is None:
        bag = "ros1" if find_spec("rosbags") else "none"
        if bag == "none":
            missing.append("no bags: rosbags is not here (pip install '.[ros]')")
    with console.progress_bar(quiet=quiet) as progress:
        settings = LabSettings(seed, made, frames, bag)
        description = write_lab(out, settings, overwrite=overwrite, progress=progress)
    if not quiet:
        console.print_files(out, {**description, "lab.json": "what stood where, and what changed"})
        console.print_next_command(f"gmmjax evaluate pairs {out} --methods joint c2c")
        for line in missing:
            console.print_note(line)
    return 0


def _has_open3d() -> bool:
    from gmmjax.clouds import load_open3d

    try:
        load_open3d("volumetric maps")
    except InputError:
        return False
    return True
