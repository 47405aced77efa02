"""A robot's survey of the laboratory with its depth camera: frames with their times, and its estimated trajectories."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial.transform import Rotation

from gmmjax.errors import InputError
from gmmjax.scenes import DepthCamera, looking_at, small_motion
from gmmjax.surveys import Frame, Trajectory
from gmmjax.thesis.laboratory.runs import RUNS, Laboratory, RunName, laboratory_of

FRAMES = 16
# Time of the first survey, 2022-05-05, 12:00 UTC, and from one survey to the next, seconds.
START, DAY = 1_651_752_000.0, 86_400.0
# Time between two frames, and between two poses of a trajectory, seconds.
FRAME_PERIOD, POSE_PERIOD = 2.0, 0.1
# Range noise of the camera at 2 m: smallest and largest standard deviation, metres.
NOISE = (0.006, 0.01)
# Extrinsics, camera to body: the camera looks along the body's x axis; the body's z axis points down.
SENSOR_ON_BODY = np.array([[0.0, 0.0, 1.0, 0.13], [1.0, 0.0, 0.0, 0.04], [0.0, 1.0, 0.0, -0.08], [0.0, 0.0, 0.0, 1.0]])


class PoseNoise(NamedTuple):
    """Standard deviations of estimated poses, metres and degrees: a periodic slow drift, and jitter of each pose."""

    drift: float
    drift_angle: float
    jitter: float
    jitter_angle: float


# Of the robot's localisation in a map (thesis 3.1.5), and of bundle adjustment (3.1.4).
LOCALISED = PoseNoise(drift=0.006, drift_angle=0.2, jitter=0.002, jitter_angle=0.06)
ADJUSTED = PoseNoise(drift=0.002, drift_angle=0.06, jitter=0.0005, jitter_angle=0.02)
# Registration error of a survey: range of the translation, metres, and largest rotation, degrees.
SURVEY_TRANSLATION, SURVEY_ROTATION = (0.005, 0.01), 0.25


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """One survey, as the robot recorded it, with the truth.

    Attributes:
        laboratory: the laboratory that was surveyed.
        camera: the depth camera.
        frames: ordered, in the camera's coordinates, with their times.
        things: for each frame the label of the thing that every point lies on; -1 for flying pixels.
        poses: true pose of the camera at each frame, camera to world.
        localised: trajectory of the body by the robot's localisation.
        adjusted: trajectory of the body after bundle adjustment.
        sensor_on_body: the camera's extrinsics, camera to body.
        misregistration: registration error of the survey: true world to the survey's world.
    """

    laboratory: Laboratory
    camera: DepthCamera
    frames: tuple[Frame, ...]
    things: tuple[Int[np.ndarray, " _"], ...]
    poses: Float64[np.ndarray, "v 4 4"]
    localised: Trajectory
    adjusted: Trajectory
    sensor_on_body: Float64[np.ndarray, "4 4"]
    misregistration: Float64[np.ndarray, "4 4"]


def recorded_run(run: RunName, seed: int, *, frames: int = FRAMES) -> Recording:
    """Simulate a survey of one run of the laboratory along its walls, determined by the arguments.

    Args:
        run: name of the run, such as "run1".
        seed: of the places of the objects, the path and the noise.
        frames: number of depth images.

    Raises:
        InputError: an unknown run, or fewer than four frames.
    """
    laboratory = laboratory_of(run, seed)
    if frames < 4:
        raise InputError(f"frames={frames} must be at least 4")
    which = RUNS.index(run)
    random = np.random.default_rng([seed, which])
    camera = DepthCamera(noise=random.uniform(*NOISE))
    times = START + DAY * which + FRAME_PERIOD * (1 + np.arange(frames))
    path = Trajectory(times, np.stack(_waypoints(random, frames)))
    # Frames are taken a little before or after the robot reaches its waypoints.
    frame_times = np.sort(np.clip(times + random.uniform(-0.3, 0.3, frames), times[0], times[-1]))
    poses, _ = path.at(frame_times, max_gap=np.inf)
    images, things = zip(
        *(frame_from(laboratory, camera, *pose, random) for pose in zip(poses, frame_times, strict=True)), strict=True
    )
    misregistration = small_motion(random, random.uniform(*SURVEY_TRANSLATION), random.uniform(0, SURVEY_ROTATION))
    samples = np.arange(times[0] - POSE_PERIOD, times[-1] + 2 * POSE_PERIOD, POSE_PERIOD)
    samples = samples + random.uniform(-0.02, 0.02, len(samples))
    body = misregistration @ path.at(samples, max_gap=np.inf)[0] @ np.linalg.inv(SENSOR_ON_BODY)
    localised, adjusted = (Trajectory(samples, _noisy(random, body, noise)) for noise in (LOCALISED, ADJUSTED))
    return Recording(laboratory, camera, images, things, poses, localised, adjusted, SENSOR_ON_BODY, misregistration)


def frame_from(
    laboratory: Laboratory,
    camera: DepthCamera,
    pose: Float64[np.ndarray, "4 4"],
    time: float,
    random: np.random.Generator,
) -> tuple[Frame, Int[np.ndarray, " n"]]:
    """Take one frame from a pose (camera to world), with the label of the thing that each of its points lies on."""
    ranges, labels = camera.measured(laboratory.solids, pose, random)
    # Depth cameras measure in single precision.
    points = (camera.directions() * ranges[:, None]).astype(np.float32)
    frame = Frame.of_image(points.reshape(camera.rows, camera.columns, 3), float(time), "haz_cam")
    return frame, labels[frame.cloud.rows]


def _waypoints(random: np.random.Generator, frames: int) -> list[np.ndarray]:
    """Camera poses on a rectangle along the walls, looking across the room (thesis 3.1.2)."""
    start = random.uniform(0, 2 * np.pi)
    poses = []
    for index in range(frames):
        angle = start + 2 * np.pi * index / frames
        outward = np.array([np.cos(angle), np.sin(angle)])
        # Alternately low and high.
        height, aim = ((0.85, 0.65), (1.25, 0.2))[index % 2]
        position = np.array([*(0.62 * outward / np.abs(outward).max()), height]) + 0.03 * random.standard_normal(3)
        target = np.array([*(-0.8 * outward), aim]) + 0.05 * random.standard_normal(3)
        poses.append(looking_at(position, target))
    return poses


def _noisy(random: np.random.Generator, poses: np.ndarray, noise: PoseNoise) -> np.ndarray:
    """The poses with errors of translation and rotation about the body: drift from two harmonics, and jitter."""
    phase = np.linspace(0, 2 * np.pi, len(poses))
    waves = np.stack([np.sin(phase), np.cos(phase), np.sin(2 * phase), np.cos(2 * phase)])
    # The sum of the waves of an axis has standard deviation 1.
    slow = np.einsum("wt,wa->ta", waves, random.standard_normal((4, 6))) / np.sqrt(2)
    fast = random.standard_normal((len(poses), 6))
    noisy = poses.copy()
    noisy[:, :3, 3] += noise.drift * slow[:, :3] + noise.jitter * fast[:, :3]
    rotation = np.radians(noise.drift_angle * slow[:, 3:] + noise.jitter_angle * fast[:, 3:])
    noisy[:, :3, :3] = Rotation.from_rotvec(rotation).as_matrix() @ poses[:, :3, :3]
    return noisy
