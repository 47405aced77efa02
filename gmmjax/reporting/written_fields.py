"""The fields of a scan in a result: what they are called, and what they hold, beside what was found."""

import re
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Float64

from gmmjax.clouds import AXES, CHANNELS, PointCloud, free_name

# Names of the components of a normal, of the writers of PLY and of the Point Cloud Library.
NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))


def written_fields(
    scan: PointCloud,
    found: Mapping[str, np.ndarray],
    reserved: tuple[str, ...],
    transform: Float64[np.ndarray, "4 4"] | None,
) -> dict[str, np.ndarray]:
    """Name what is written beside the coordinates of some points, in the order of the file.

    That is what was found, the scan's own colours as `scan_red` and so on where those of the kinds take their place,
    and its own fields, normals turned by the transform. None of these has one of the `reserved` names.
    """
    fields = dict(found)
    if scan.colors is not None and "kind" in found:
        fields |= {f"scan_{channel}": scan.colors[:, index] for index, channel in enumerate(CHANNELS)}
    own = _turned(scan.fields, transform)
    names = written_names(own, {*fields, *reserved})
    return fields | {names[name]: values for name, values in own.items()}


def written_names(own: Iterable[str], taken: set[str]) -> dict[str, str]:
    """Name the fields of a scan in the result; one whose name is `taken` becomes `input_NAME`."""
    originals = tuple(own)
    names: dict[str, str] = {}
    for name in originals:
        plain = _plain(name)
        used = {*taken, *names.values(), *AXES, *CHANNELS, "rgb", "rgba"}
        names[name] = free_name(plain, {*used, *originals}) if plain in used else plain
    return names


def _turned(fields: Mapping[str, np.ndarray], transform: np.ndarray | None) -> dict[str, np.ndarray]:
    """Return the fields, in their order; normals turned as the points are."""
    turned = dict(fields)
    for names in NORMALS if transform is not None else ():
        if all(name in fields and fields[name].dtype.kind == "f" for name in names):
            assert transform is not None
            normals = np.stack([fields[name] for name in names], axis=1) @ transform[:3, :3].T
            turned |= {name: normals[:, axis].astype(fields[name].dtype) for axis, name in enumerate(names)}
    return turned


def _plain(name: str) -> str:
    """Return a name that PLY and PCD can have: of letters, digits, dots, - and _, with a letter in front."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
    return plain if re.match(r"[A-Za-z]", plain) else f"field_{plain}"
