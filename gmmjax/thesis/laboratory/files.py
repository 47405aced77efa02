"""The simulated laboratory on disk: the robot's recording of each run, and pairs of runs with the truth."""

import dataclasses
import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from gmmjax.clouds import (
    FolderKind,
    atomic_write,
    check_output_folder,
    load_open3d,
    output_folder,
    write_ply,
    write_views,
)
from gmmjax.surveys import load_rosbags, write_bag
from gmmjax.thesis.laboratory.pairs import CloudKind, LabCloud, lab_cloud, lab_frames, labelled
from gmmjax.thesis.laboratory.recording import FRAMES, Recording, recorded_run
from gmmjax.thesis.laboratory.runs import PAIRS, THINGS, RunName, RunPair, laboratory_of, object_changes

LAB = FolderKind("simulated laboratory", "lab.json", "pairs", (), tree=True)
SURVEYS = "surveys"
# Topic of the body's poses after bundle adjustment; those by localisation are on the default topic of `write_bag`.
ADJUSTED_TOPIC = "/loc/adjusted"
BagFormat = Literal["ros1", "ros2", "none"]
BAG_FILES: Mapping[str, str] = {"ros1": "survey.bag", "ros2": "survey"}


@dataclasses.dataclass(frozen=True)
class LabSettings:
    """Settings of the simulated laboratory.

    Attributes:
        seed: of the places of the objects, the paths and the noise.
        kinds: of clouds that are made of the runs.
        frames: number of depth images of a survey.
        bag: format of the bag that is written of each run, or "none".
        pairs: of runs that are compared.
    """

    seed: int = 0
    kinds: Sequence[CloudKind] = ("frame", "localised")
    frames: int = FRAMES
    bag: BagFormat = "none"
    pairs: Sequence[RunPair] = PAIRS


def check_lab_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Check that `write_lab` can write there.

    Raises:
        InputError: the folder is a file, holds something else, holds a laboratory without `overwrite`, or cannot be
            written.
    """
    check_output_folder(folder, LAB, overwrite=overwrite)


def write_lab(
    folder: str | os.PathLike[str],
    settings: LabSettings,
    *,
    overwrite: bool = False,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> dict[str, str]:
    """Simulate surveys of the laboratory and write them, with pairs that `find_pairs` reads; all files or none.

    Args:
        folder: is created where needed; may be empty.
        settings: how it is simulated.
        overwrite: replace a previous laboratory.
        progress: called with a description of the current step and the fraction of the steps that are done.

    Returns:
        The content of each folder by its name, in which * stands for the kind.

    Raises:
        InputError: a folder that cannot be written, volumetric maps without Open3D, or bags without rosbags.
    """
    if settings.bag != "none":
        load_rosbags("the surveys' bags")
    if "volumetric" in settings.kinds:
        load_open3d("volumetric maps")
    runs = list(dict.fromkeys(run for pair in settings.pairs for run in pair))
    pairs = [(pair, kind) for pair in settings.pairs for kind in settings.kinds]
    changes = {pair: object_changes(*(laboratory_of(run, settings.seed) for run in pair)) for pair in settings.pairs}
    maps: dict[tuple[RunName, CloudKind], LabCloud] = {}
    with output_folder(folder, LAB, overwrite=overwrite) as staging:
        for number, run in enumerate(runs):
            progress(f"Survey of {run}", number / (len(runs) + len(pairs)))
            recording = recorded_run(run, settings.seed, frames=settings.frames)
            _write_recording(staging / SURVEYS / run, recording, settings.bag)
            for kind in settings.kinds:
                if kind != "frame":
                    maps[run, kind] = lab_cloud(recording, kind)
                    _write_map(staging / SURVEYS / run, kind, maps[run, kind])
        for number, (pair, kind) in enumerate(pairs, start=len(runs)):
            progress(f"Truth of {kind} {' to '.join(pair)}", number / (len(runs) + len(pairs)))
            frames = lab_frames(pair, settings.seed) if kind == "frame" else None
            _write_pair(staging / "-".join((kind, *pair)), *(frames or (maps[run, kind] for run in pair)))
        with atomic_write(staging / LAB.marker) as file:
            file.write(_description(settings, runs, changes).encode())
    words = {pair: ", ".join(f"{name} {kind}" for name, kind in own.items()) for pair, own in changes.items()}
    return {
        f"{SURVEYS}/": "what the robot recorded in each run",
        **{f"*-{'-'.join(pair)}/": text for pair, text in words.items()},
    }


def _description(settings: LabSettings, runs: Sequence[RunName], changes: Mapping[RunPair, dict[str, str]]) -> str:
    """The content of `lab.json`."""
    objects = {run: laboratory_of(run, settings.seed).objects for run in runs}
    pairs = [
        {"folder": "-".join((kind, *pair)), "kind": kind, "before": pair[0], "after": pair[1], "changes": own}
        for pair, own in changes.items()
        for kind in settings.kinds
    ]
    content = {
        "schema_version": 1,
        "settings": dataclasses.asdict(settings),
        "things": list(THINGS),
        "runs": {run: {name: pose.tolist() for name, pose in own.items()} for run, own in objects.items()},
        "pairs": pairs,
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _write_recording(home: Path, recording: Recording, bag: BagFormat) -> None:
    home.mkdir(parents=True)
    times, sensor = np.array([frame.time for frame in recording.frames]), recording.sensor_on_body
    poses = {
        "times": times,
        "poses": recording.localised.of_sensor(sensor).at(times)[0],
        "poses_adjusted": recording.adjusted.of_sensor(sensor).at(times)[0],
        "poses_true": recording.poses,
        "sensor_on_body": sensor,
        "misregistration": recording.misregistration,
    }
    with atomic_write(home / "poses.npz") as file:
        np.savez_compressed(file, allow_pickle=False, **poses)
    if bag != "none":
        topics = {ADJUSTED_TOPIC: recording.adjusted}
        path = home / BAG_FILES[bag]
        write_bag(path, recording.frames, recording.localised, sensor_on_body=sensor, other_poses=topics)


def _write_map(home: Path, kind: CloudKind, cloud: LabCloud) -> None:
    write_ply(home / f"{kind}.ply", cloud.points, fields={"thing": cloud.things.astype(np.int8)})
    write_views(home / f"{kind}_views.json", cloud.views)


def _write_pair(home: Path, before: LabCloud, after: LabCloud) -> None:
    home.mkdir()
    pair = labelled(home.name, before, after)
    for side, cloud, views in (("before", pair.before, before.views), ("after", pair.after, after.views)):
        write_ply(home / f"{side}.ply", cloud.points)
        write_views(home / f"views_{side}.json", views)
        assert cloud.unseen is not None
        arrays: dict[str, np.ndarray] = {"truth": cloud.truth.astype(np.int64), "unseen": cloud.unseen}
        if cloud.not_counted:
            arrays["not_counted"] = np.array(sorted(cloud.not_counted), np.int64)
        for name, values in arrays.items():
            with atomic_write(home / f"{name}_{side}.npy") as file:
                np.save(file, values, allow_pickle=False)
