"""A program for another checkout's gmmjax: `python -P detect_there.py CHECKOUT FOLDER`, with CHECKOUT as `PYTHONPATH`.

It writes NAME.labels.npz for each NAME.pair.npz in the folder, or why there are none to NAME.failed.txt. Of gmmjax it
uses only what every version has had.
"""

import sys
import warnings
from pathlib import Path

import numpy as np

import gmmjax


def main() -> None:
    checkout, folder = (Path(argument).resolve() for argument in sys.argv[1:])
    if not Path(gmmjax.__file__).is_relative_to(checkout):
        sys.exit(f"{checkout}: gmmjax was imported from {gmmjax.__file__}; give the root of a checkout")
    warnings.simplefilter("ignore", gmmjax.InputWarning)
    for file in sorted(folder.glob("*.pair.npz")):
        name = file.name.removesuffix(".pair.npz")
        try:
            labels = labels_of(np.load(file))
        except (gmmjax.InputError, gmmjax.ComputationError) as error:
            (folder / f"{name}.failed.txt").write_text(str(error))
        else:
            np.savez(folder / f"{name}.labels.npz", **labels)


def labels_of(pair):
    """The labels of both clouds, without the sensor's poses and with them."""
    labels = {}
    for poses in ("unknown", "given"):
        given = {f"views_{side}": views(pair, side) for side in ("before", "after")} if poses == "given" else {}
        changes = gmmjax.detect_changes(pair["points_before"], pair["points_after"], **given)
        labels[f"{poses}_before"], labels[f"{poses}_after"] = changes.labels_before, changes.labels_after
    return labels


def views(pair, side):
    """Where the sensor of one cloud stood."""
    poses, angles, longest = (pair[f"{name}_{side}"] for name in ("poses", "field_of_view", "max_range"))
    return gmmjax.SensorViews(poses, angles, float(longest))


if __name__ == "__main__":
    main()
