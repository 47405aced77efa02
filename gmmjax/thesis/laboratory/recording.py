"""A robot's survey of the laboratory with its depth camera: frames with their times, and its estimated trajectories."""

import dataclasses
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial.transform import Rotation

from gmmjax.errors import InputError, check_choice
from gmmjax.scenes import DepthCamera, looking_at, small_motion
from gmmjax.surveys import Frame, Trajectory
from gmmjax.thesis.laboratory.runs import RUNS, Laboratory, RunName, laboratory_of

Pattern = Literal["geometric", "panoramic"]
FRAMES = 16
# Time of the first survey, 2022-05-05, 12:00 UTC, and the time between two surveys, seconds.
START, DAY = 1_651_752_000.0, 86_400.0
# Time between two frames, and between two poses of a trajectory, seconds.
FRAME_PERIOD, POSE_PERIOD = 2.0, 0.1
# Range noise of the camera at 2 m: smallest and largest standard deviation, metres.
NOISE = (0.006, 0.01)
SENSOR_FRAME, BODY_FRAME, WORLD_FRAME = "haz_cam", "body", "world"


@dataclasses.dataclass(frozen=True)
class PoseNoise:
    """Errors of estimated poses: standard deviations, metres and degrees.

    Attributes:
        drift: of the position's slow drift along the survey, which is periodic: the same at both ends.
        drift_angle: of the orientation's slow drift.
        jitter: of the position's independent error at each pose.
        jitter_angle: of the orientation's independent error.
    """

    drift: float
    drift_angle: float
    jitter: float
    jitter_angle: float


# Of the robot's localisation in a map (thesis 3.1.5), and of bundle adjustment (3.1.4).
LOCALISED = PoseNoise(drift=0.006, drift_angle=0.2, jitter=0.002, jitter_angle=0.06)
ADJUSTED = PoseNoise(drift=0.002, drift_angle=0.06, jitter=0.0005, jitter_angle=0.02)

# Registration error of a survey: range of the translation, metres, and largest rotation, degrees. Two surveys are up to
# 2 cm and 0.5 degrees apart.
SURVEY_TRANSLATION, SURVEY_ROTATION = (0.005, 0.01), 0.25

# Extrinsics, camera to body: the camera looks along the body's x axis; the body's z axis points down.
SENSOR_ON_BODY = np.array([[0.0, 0.0, 1.0, 0.13], [1.0, 0.0, 0.0, 0.04], [0.0, 1.0, 0.0, -0.08], [0.0, 0.0, 0.0, 1.0]])


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


def recorded_run(
    run: RunName, seed: int, *, occasion: int = 0, pattern: Pattern = "geometric", frames: int = FRAMES
) -> Recording:
    """A survey of one run of the laboratory, determined by the arguments.

    Args:
        run: name of the run, such as "run1".
        seed: of the places of the objects, the path and the noise.
        occasion: number of the survey, where one run is surveyed several times.
        pattern: of the path: "geometric" along the walls, looking across the room; "panoramic" turning at two places.
        frames: number of depth images.

    Raises:
        InputError: an unknown run or pattern, or fewer than four frames.
    """
    surveyed = laboratory_of(run, seed)
    which = RUNS.index(run) + len(RUNS) * occasion
    start = START + DAY * which
    check_choice("pattern", pattern, get_args(Pattern))
    if frames < 4:
        raise InputError(f"frames={frames} must be at least 4")
    return _recorded(surveyed, np.random.default_rng([seed, which]), pattern, frames, start)


def _recorded(
    laboratory: Laboratory, random: np.random.Generator, pattern: Pattern, frames: int, start: float
) -> Recording:
    """A survey that begins at a time, in seconds."""
    camera = DepthCamera(noise=random.uniform(*NOISE))
    waypoints = _geometric(random, frames) if pattern == "geometric" else _panoramic(random, frames)
    times = start + FRAME_PERIOD * (1 + np.arange(frames))
    path = Trajectory(times, np.stack(waypoints))
    # Frames are taken a little before or after the robot reaches its waypoints.
    frame_times = np.sort(np.clip(times + random.uniform(-0.3, 0.3, frames), times[0], times[-1]))
    poses, _ = path.at(frame_times, max_gap=np.inf)
    measured = [
        frame_from(laboratory, camera, pose, random, time) for pose, time in zip(poses, frame_times, strict=True)
    ]
    misregistration = small_motion(random, random.uniform(*SURVEY_TRANSLATION), random.uniform(0, SURVEY_ROTATION))
    samples = np.arange(times[0] - POSE_PERIOD, times[-1] + 2 * POSE_PERIOD, POSE_PERIOD)
    samples = samples + random.uniform(-0.02, 0.02, len(samples))
    flown, _ = path.at(samples, max_gap=np.inf)
    body = misregistration @ flown @ np.linalg.inv(SENSOR_ON_BODY)
    return Recording(
        laboratory,
        camera,
        tuple(frame for frame, _ in measured),
        tuple(things for _, things in measured),
        poses,
        Trajectory(samples, _noisy(random, body, LOCALISED)),
        Trajectory(samples, _noisy(random, body, ADJUSTED)),
        SENSOR_ON_BODY,
        misregistration,
    )


def frame_from(
    laboratory: Laboratory,
    camera: DepthCamera,
    pose: Float64[np.ndarray, "4 4"],
    random: np.random.Generator,
    time: float,
) -> tuple[Frame, Int[np.ndarray, " n"]]:
    """One frame from a pose (camera to world), and the label of the thing that each of its points lies on."""
    ranges, labels = camera.measured(laboratory.solids, pose, random)
    # Depth cameras measure in single precision.
    points = (camera.directions() * ranges[:, None]).astype(np.float32)
    frame = Frame.of_image(points.reshape(camera.rows, camera.columns, 3), float(time), SENSOR_FRAME)
    return frame, labels[frame.cloud.rows]


def _geometric(random: np.random.Generator, frames: int) -> list[np.ndarray]:
    """Camera poses on a rectangle along the walls, looking across the room (thesis 3.1.2)."""
    start = random.uniform(0, 2 * np.pi)
    poses = []
    for index in range(frames):
        angle = start + 2 * np.pi * index / frames
        outward = np.array([np.cos(angle), np.sin(angle)])
        rectangle = 0.62 * outward / np.abs(outward).max()
        # Alternately low and high.
        high = index % 2
        position = np.array([*rectangle, (0.85, 1.25)[high]])
        target = np.array([*(-0.8 * outward), (0.65, 0.2)[high]])
        poses.append(looking_at(_about(random, position, 0.03), _about(random, target, 0.05)))
    return poses


def _panoramic(random: np.random.Generator, frames: int) -> list[np.ndarray]:
    """Camera poses at two places, turning about the vertical, looking alternately ahead and down."""
    start = random.uniform(0, 2 * np.pi)
    at_each = (frames + 1) // 2
    poses = []
    for index in range(frames):
        station, step = divmod(index, at_each)
        angle = start + 2 * np.pi * step / at_each
        outward = np.array([np.cos(angle), np.sin(angle)])
        position = np.array([0.0, (-0.35, 0.35)[station], 1.0])
        target = position + np.array([*outward, (-0.15, -0.75)[(index + station) % 2]])
        poses.append(looking_at(_about(random, position, 0.03), _about(random, target, 0.03)))
    return poses


def _about(random: np.random.Generator, place: np.ndarray, deviation: float) -> np.ndarray:
    return np.asarray(place + deviation * random.standard_normal(3))


def _noisy(random: np.random.Generator, poses: np.ndarray, noise: PoseNoise) -> np.ndarray:
    """The poses with errors of translation and rotation about the body: drift from two harmonics, and jitter."""
    phase = np.linspace(0, 2 * np.pi, len(poses))
    waves = np.stack([np.sin(phase), np.cos(phase), np.sin(2 * phase), np.cos(2 * phase)])
    # The sum of the waves of an axis has standard deviation 1.
    slow = np.einsum("wt,wa->ta", waves, random.standard_normal((4, 6))) / np.sqrt(2)
    fast = random.standard_normal((len(poses), 6))
    translation = noise.drift * slow[:, :3] + noise.jitter * fast[:, :3]
    rotation = np.radians(noise.drift_angle * slow[:, 3:] + noise.jitter_angle * fast[:, 3:])
    noisy = poses.copy()
    noisy[:, :3, 3] += translation
    noisy[:, :3, :3] = Rotation.from_rotvec(rotation).as_matrix() @ poses[:, :3, :3]
    return noisy
