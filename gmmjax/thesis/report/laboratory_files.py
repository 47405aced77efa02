"""The simulated laboratory on disk: the robot's recording of each run, and pairs of runs with the truth."""

import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Shaped

from gmmjax.clouds import (
    FolderKind,
    atomic_write,
    check_output_folder,
    load_open3d,
    output_folder,
    write_pcd,
    write_ply,
    write_views,
)
from gmmjax.surveys import Frame, load_rosbags, write_bag, write_intrinsics
from gmmjax.thesis.laboratory import (
    FRAMES,
    PRESETS,
    THINGS,
    CloudKind,
    LabCloud,
    LabPair,
    Pattern,
    Preset,
    Recording,
    RunName,
    lab_cloud,
    lab_frames,
    laboratory_of,
    recorded_run,
    with_truth,
)
from gmmjax.thesis.report.laboratory_page import lab_page

SCHEMA_VERSION = 1
LAB_FILE = "lab.json"
PAGE_FILE = "index.html"
SURVEYS = "surveys"
LAB = FolderKind("simulated laboratory", LAB_FILE, "pairs", (), tree=True)
# Topic of the body's poses after bundle adjustment; those by localisation are on the default topic of `write_bag`.
ADJUSTED_TOPIC = "/loc/adjusted"
BagFormat = Literal["ros1", "ros2", "none"]
BAG_FILES: Mapping[str, str] = {"ros1": "survey.bag", "ros2": "survey"}


def check_lab_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Checks that `write_lab` can write there.

    Raises:
        InputError: the folder is a file, holds something else, holds a laboratory without `overwrite`, or cannot be
            written.
    """
    check_output_folder(folder, LAB, overwrite=overwrite)


def write_lab(
    folder: str | os.PathLike[str],
    *,
    runs: Sequence[Preset],
    seed: int,
    kinds: Sequence[CloudKind],
    bag: BagFormat,
    pattern: Pattern = "geometric",
    frames: int = FRAMES,
    overwrite: bool = False,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> dict[str, str]:
    """Simulates runs of the laboratory and writes them, all or none.

    `surveys/RUN/` has the robot's recording: the bag, the frames as PCD files with `poses.npz` and `intrinsics.json`,
    the maps with the camera's views, and the thing of each point. `KIND-RUN-RUN/` is a pair as `find_pairs` reads it.
    `index.html` shows all of it; `lab.json` has the objects of each run and the changes of each pair.

    Args:
        folder: is created where needed; may be empty.
        runs: names in `PRESETS`.
        seed: of the places of the objects, the paths and the noise.
        kinds: of clouds that are made of the runs.
        bag: format of the bag that is written of each run, or "none".
        pattern: of the surveys' paths.
        frames: number of depth images of a survey.
        overwrite: replace a previous laboratory.
        progress: called with a description of the current step and the fraction of the steps that are done.

    Returns:
        The content of each folder by its name, in which * stands for the kind.

    Raises:
        InputError: a folder that cannot be written, volumetric maps without Open3D, or bags without rosbags.
    """
    if bag != "none":
        load_rosbags("the surveys' bags")
    if "volumetric" in kinds:
        load_open3d("volumetric maps")
    simulation = _Simulation(runs, seed, kinds, bag, pattern, frames)
    with output_folder(folder, LAB, overwrite=overwrite) as staging:
        maps = _write_surveys(staging, simulation, progress)
        pairs = _write_pairs(staging, simulation, maps, progress)
        frame_pairs = {" to ".join(pair.names): pair.clouds for pair in pairs if pair.kind == "frame"}
        with atomic_write(staging / PAGE_FILE) as file:
            file.write(lab_page(maps, frame_pairs, seed).encode())
        _write_json(staging / LAB_FILE, _description(simulation, pairs))
    return {
        f"{SURVEYS}/": "what the robot recorded in each run",
        **{f"*-{'-'.join(pair.names)}/": _in_words(pair.clouds.changes) for pair in pairs},
    }


@dataclasses.dataclass(frozen=True)
class _Simulation:
    """The arguments of `write_lab`, and the surveys and pairs that they ask for."""

    runs: Sequence[Preset]
    seed: int
    kinds: Sequence[CloudKind]
    bag: BagFormat
    pattern: Pattern
    frames: int

    @property
    def pairs(self) -> list[tuple[RunName, RunName]]:
        return [pair for name in dict.fromkeys(self.runs) for pair in PRESETS[name]]

    @property
    def surveys(self) -> dict[str, tuple[RunName, int]]:
        """Run and occasion of each survey, by its name."""
        return {_survey_name(*survey): survey for pair in self.pairs for survey in _surveys(pair)}

    @property
    def steps(self) -> int:
        return len(self.surveys) + len(self.pairs) * len(self.kinds)


@dataclasses.dataclass(frozen=True)
class _WrittenPair:
    """A pair in its folder: the runs, the names of their surveys, and the clouds with the truth."""

    folder: str
    kind: CloudKind
    runs: tuple[RunName, RunName]
    names: Sequence[str]
    clouds: LabPair


_Maps: TypeAlias = dict[tuple[str, CloudKind], LabCloud]


def _write_surveys(staging: Path, simulation: _Simulation, progress: Callable[[str, float], None]) -> _Maps:
    """Writes the recording and the maps of each survey; the maps by the survey's name and their kind."""
    maps: _Maps = {}
    for number, (name, (run, occasion)) in enumerate(simulation.surveys.items()):
        progress(f"Survey of {name}", number / simulation.steps)
        recording = recorded_run(
            run, simulation.seed, occasion=occasion, pattern=simulation.pattern, frames=simulation.frames
        )
        home = staging / SURVEYS / name
        _write_recording(home, recording, simulation.bag)
        for kind in simulation.kinds:
            if kind != "frame":
                maps[name, kind] = cloud = lab_cloud(recording, kind)
                _write_map(home, kind, cloud)
    return maps


def _write_pairs(
    staging: Path, simulation: _Simulation, maps: _Maps, progress: Callable[[str, float], None]
) -> list[_WrittenPair]:
    """Writes the folder of each pair and kind."""
    written = []
    for number, (runs, kind) in enumerate((runs, kind) for runs in simulation.pairs for kind in simulation.kinds):
        names = [_survey_name(*survey) for survey in _surveys(runs)]
        title = f"{kind}-{'-'.join(names)}"
        progress(f"Truth of {title}", (len(simulation.surveys) + number) / simulation.steps)
        if kind == "frame":
            clouds = lab_frames(runs, simulation.seed)
        else:
            clouds = with_truth(maps[names[0], kind], maps[names[1], kind])
        _write_pair(staging, title, kind, clouds, names)
        written.append(_WrittenPair(title, kind, runs, names, clouds))
    return written


def _description(simulation: _Simulation, pairs: Sequence[_WrittenPair]) -> dict[str, Any]:
    """The content of `lab.json`."""
    settings = {
        "runs": list(simulation.runs),
        "seed": simulation.seed,
        "kinds": list(simulation.kinds),
        "pattern": simulation.pattern,
    }
    return {
        "schema_version": SCHEMA_VERSION,
        "settings": {**settings, "frames": simulation.frames, "bag": simulation.bag},
        "things": list(THINGS),
        "runs": {name: _objects(run, simulation.seed) for name, (run, _) in simulation.surveys.items()},
        "pairs": [
            {
                "folder": pair.folder,
                "kind": pair.kind,
                "before": pair.runs[0],
                "after": pair.runs[1],
                "changes": pair.clouds.changes,
            }
            for pair in pairs
        ],
    }


def _surveys(pair: tuple[RunName, RunName]) -> list[tuple[RunName, int]]:
    """A run that is compared with itself is surveyed twice."""
    return [(pair[0], 0), (pair[1], int(pair[0] == pair[1]))]


def _survey_name(run: RunName, occasion: int) -> str:
    return f"{run}again" if occasion else run


def _objects(run: RunName, seed: int) -> dict[str, list[list[float]]]:
    return {name: pose.tolist() for name, pose in laboratory_of(run, seed).objects.items()}


def _in_words(changes: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {kind}" for name, kind in changes.items()) or "nothing changed"


def _write_recording(home: Path, recording: Recording, bag: BagFormat) -> None:
    frames = home / "frames"
    frames.mkdir(parents=True)
    for number, frame in enumerate(recording.frames):
        write_pcd(frames / f"frame_{number:03}.pcd", frame.image().astype(np.float32))
    times = np.array([frame.time for frame in recording.frames])
    sensor = recording.localised.of_sensor(recording.sensor_on_body)
    _write_npz(
        home / "poses.npz",
        times=times,
        poses=sensor.at(times)[0],
        poses_adjusted=recording.adjusted.of_sensor(recording.sensor_on_body).at(times)[0],
        poses_true=recording.poses,
        sensor_on_body=recording.sensor_on_body,
        misregistration=recording.misregistration,
    )
    images = [
        _by_pixel(things.astype(np.int8), frame, -1).reshape(frame.height or 1, -1)
        for frame, things in zip(recording.frames, recording.things, strict=True)
    ]
    _write_npz(home / "things.npz", frames=np.stack(images))
    write_intrinsics(home / "intrinsics.json", recording.camera.intrinsics())
    if bag != "none":
        write_bag(
            home / BAG_FILES[bag],
            recording.frames,
            recording.localised,
            sensor_on_body=recording.sensor_on_body,
            other_poses={ADJUSTED_TOPIC: recording.adjusted},
        )


def _write_map(home: Path, kind: CloudKind, cloud: LabCloud) -> None:
    write_ply(home / f"{kind}.ply", cloud.points, fields={"thing": cloud.things.astype(np.int8)})
    write_views(home / f"{kind}_views.json", cloud.views)


def _write_pair(staging: Path, title: str, kind: CloudKind, pair: LabPair, names: Sequence[str]) -> None:
    home = staging / title
    home.mkdir()
    sides = (
        ("before", pair.before, pair.truth_before, pair.unseen_before, pair.uncounted_before),
        ("after", pair.after, pair.truth_after, pair.unseen_after, pair.uncounted_after),
    )
    for (side, cloud, truth, unseen, uncounted), name in zip(sides, names, strict=True):
        if cloud.frame is not None:
            write_pcd(home / f"{side}.pcd", cloud.frame.image().astype(np.float32))
            truth, unseen = _by_pixel(truth, cloud.frame, -1), _by_pixel(unseen, cloud.frame, False)
        else:
            _link(staging / SURVEYS / name / f"{kind}.ply", home / f"{side}.ply")
        write_views(home / f"views_{side}.json", cloud.views)
        _write_npy(home / f"truth_{side}.npy", truth.astype(np.int64))
        _write_npy(home / f"unseen_{side}.npy", unseen)
        if uncounted:
            _write_npy(home / f"not_counted_{side}.npy", np.array(sorted(uncounted), np.int64))


def _by_pixel(values: Shaped[np.ndarray, " n"], frame: Frame, missing: int | bool) -> Shaped[np.ndarray, " p"]:
    """One value for each pixel of a frame, row by row, from one for each point."""
    pixels = np.full(len(frame.cloud) + frame.cloud.rows_dropped, missing, values.dtype)
    pixels[frame.cloud.rows] = values
    return pixels


def _link(source: Path, target: Path) -> None:
    """A hard link, or a copy where the file system has none."""
    with suppress(OSError):
        os.link(source, target)
        return
    shutil.copyfile(source, target)


def _write_npy(path: Path, values: np.ndarray) -> None:
    with atomic_write(path) as file:
        np.save(file, values, allow_pickle=False)


def _write_npz(path: Path, **arrays: np.ndarray) -> None:
    with atomic_write(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    with atomic_write(path) as file:
        file.write((json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
