"""The simulated laboratory on disk: what the robot recorded in each run, and the runs compared, with the truth."""

import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Int

from gmmjax.clouds import atomic_write, write_pcd, write_ply, write_views
from gmmjax.clouds.mesh import load_open3d
from gmmjax.reporting.output_folder import FolderKind, check_output_folder, output_folder
from gmmjax.surveys import Frame, write_bag, write_intrinsics
from gmmjax.surveys.bags import load_rosbags
from gmmjax.thesis.laboratory.pairs import CloudKind, LabCloud, LabPair, compared, lab_cloud, lab_frames
from gmmjax.thesis.laboratory.recording import FRAMES, Pattern, Recording, recorded_run
from gmmjax.thesis.laboratory.runs import PRESETS, THINGS, Preset, RunName, laboratory
from gmmjax.thesis.report.laboratory_page import lab_page

SCHEMA_VERSION = 1
LAB_FILE = "lab.json"
PAGE_FILE = "index.html"
SURVEYS = "surveys"
LAB = FolderKind("simulated laboratory", LAB_FILE, "pairs", (), tree=True)
# The body's poses after bundle adjustment; those of its localisation are on the usual topic.
ADJUSTED_TOPIC = "/loc/adjusted"
BagFormat = Literal["ros1", "ros2", "none"]
BAG_FILES: Mapping[str, str] = {"ros1": "survey.bag", "ros2": "survey"}


def check_lab_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Whether `write_lab` could write there.

    Raises:
        InputError: the folder is a file, holds something else, holds a laboratory and not `overwrite`, or cannot be
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

    `surveys/RUN/` has what the robot recorded: the bag, the frames as PCD files with `poses.npz` and
    `intrinsics.json`, the maps with the camera's views, and the label of what each point is on. `KIND-RUN-RUN/` is a
    pair as `find_pairs` reads it. `index.html` shows all of it, `lab.json` says what stood where, and what changed.

    Args:
        folder: is made where needed; may be empty.
        runs: names in `PRESETS`.
        seed: of all.
        kinds: which clouds are made of the runs.
        bag: what kind of bag is written of each run, or "none".
        pattern: of the surveys.
        frames: of a survey.
        overwrite: replace a previous laboratory.
        progress: called with what is being done and the share that is done.

    Returns:
        What the folders hold, by their names; * is one of the kinds.

    Raises:
        InputError: a folder that cannot be written, volumetric maps without Open3D, or bags without rosbags.
    """
    if bag != "none":
        load_rosbags("the surveys' bags")
    if "volumetric" in kinds:
        load_open3d("volumetric maps")
    pairs = [pair for name in dict.fromkeys(runs) for pair in PRESETS[name]]
    surveys = {_survey_name(*survey): survey for pair in pairs for survey in _surveys(pair)}
    steps = len(surveys) + len(pairs) * len(kinds)
    description: dict[str, str] = {}
    with output_folder(folder, LAB, overwrite=overwrite) as staging:
        clouds: dict[tuple[str, CloudKind], LabCloud] = {}
        for number, (name, (run, occasion)) in enumerate(surveys.items()):
            progress(f"Survey of {name}", number / steps)
            recording = recorded_run(run, seed, occasion=occasion, pattern=pattern, frames=frames)
            home = staging / SURVEYS / name
            _write_recording(home, recording, bag)
            for kind in kinds:
                if kind != "frame":
                    clouds[name, kind] = cloud = lab_cloud(recording, kind)
                    _write_map(home, kind, cloud)
        description[f"{SURVEYS}/"] = "what the robot recorded in each run"
        content = []
        frame_pairs: dict[str, LabPair] = {}
        for number, (pair, kind) in enumerate((pair, kind) for pair in pairs for kind in kinds):
            names = [_survey_name(*survey) for survey in _surveys(pair)]
            title = f"{kind}-{'-'.join(names)}"
            progress(f"Truth of {title}", (len(surveys) + number) / steps)
            if kind == "frame":
                found = frame_pairs[" to ".join(names)] = lab_frames(pair, seed)
            else:
                found = compared(clouds[names[0], kind], clouds[names[1], kind])
            _write_pair(staging, title, kind, found, names)
            description[f"*-{'-'.join(names)}/"] = _in_words(found.changes)
            content.append(
                {"folder": title, "kind": kind, "before": pair[0], "after": pair[1], "changes": found.changes}
            )
        with atomic_write(staging / PAGE_FILE) as file:
            file.write(lab_page(clouds, frame_pairs, seed).encode())
        settings = {"runs": list(runs), "seed": seed, "kinds": list(kinds), "pattern": pattern, "frames": frames}
        _write_json(
            staging / LAB_FILE,
            {
                "schema_version": SCHEMA_VERSION,
                "settings": {**settings, "bag": bag},
                "things": list(THINGS),
                "runs": {name: _objects(run, seed) for name, (run, _) in surveys.items()},
                "pairs": content,
            },
        )
    return description


def _surveys(pair: tuple[RunName, RunName]) -> list[tuple[RunName, int]]:
    """A run that is compared with itself is surveyed twice."""
    return [(pair[0], 0), (pair[1], int(pair[0] == pair[1]))]


def _survey_name(run: RunName, occasion: int) -> str:
    return f"{run}again" if occasion else run


def _objects(run: RunName, seed: int) -> dict[str, list[list[float]]]:
    return {name: pose.tolist() for name, pose in laboratory(run, seed).objects.items()}


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
    labels = [_by_pixel(frame, things) for frame, things in zip(recording.frames, recording.things, strict=True)]
    _write_npz(home / "things.npz", frames=np.stack(labels))
    write_intrinsics(home / "intrinsics.json", recording.camera.intrinsics())
    if bag != "none":
        write_bag(
            home / BAG_FILES[bag],
            recording.frames,
            recording.localised,
            sensor_on_body=recording.sensor_on_body,
            other_poses={ADJUSTED_TOPIC: recording.adjusted},
        )


def _by_pixel(frame: Frame, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, "h w"]:
    image = np.full(len(frame.cloud) + frame.cloud.rows_dropped, -1, np.int8)
    image[frame.cloud.rows] = labels
    return image.reshape(frame.height or 1, -1)


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
            pixels = len(cloud.frame.cloud) + cloud.frame.cloud.rows_dropped
            truth, unseen = _in_rows(truth, cloud.frame, pixels, -1), _in_rows(unseen, cloud.frame, pixels, False)
        else:
            _link(staging / SURVEYS / name / f"{kind}.ply", home / f"{side}.ply")
        write_views(home / f"views_{side}.json", cloud.views)
        _write_npy(home / f"truth_{side}.npy", truth.astype(np.int64))
        _write_npy(home / f"unseen_{side}.npy", unseen)
        if uncounted:
            _write_npy(home / f"not_counted_{side}.npy", np.array(sorted(uncounted), np.int64))


def _in_rows(values: np.ndarray, frame: Frame, pixels: int, missing: int | bool) -> np.ndarray:
    rows = np.full(pixels, missing, values.dtype)
    rows[frame.cloud.rows] = values
    return rows


def _link(source: Path, target: Path) -> None:
    """The same file under another name, where the file system can; else a copy."""
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
