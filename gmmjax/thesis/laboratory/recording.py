"""A robot's survey of the laboratory with its depth camera: frames, times, and poses as it believes them."""

import dataclasses
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial.transform import Rotation

from gmmjax.errors import InputError, check_choice
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.rigid_motions import looking_at, small_motion
from gmmjax.surveys import Frame, Trajectory
from gmmjax.thesis.laboratory.runs import RUNS, Laboratory, RunName, laboratory

Pattern = Literal["geometric", "panoramic"]
FRAMES = 16
# 2022-05-05, 12:00 UTC.
START, DAY = 1_651_752_000.0, 86_400.0
# Of the robot between two frames, and of its poses, seconds.
FRAME_PERIOD, POSE_PERIOD = 2.0, 0.1
SENSOR_FRAME, BODY_FRAME, WORLD_FRAME = "haz_cam", "body", "world"


@dataclasses.dataclass(frozen=True)
class PoseNoise:
    """How wrong believed poses are. Standard deviations, metres and degrees.

    Attributes:
        drift: of what changes slowly along the survey, as a random walk that is the same at both ends.
        drift_angle: the same of the orientation.
        jitter: of each pose by itself.
        jitter_angle: the same of the orientation.
    """

    drift: float
    drift_angle: float
    jitter: float
    jitter_angle: float


# By the robot's localisation in a map (thesis 3.1.5), and after bundle adjustment (3.1.4).
LOCALISED = PoseNoise(drift=0.006, drift_angle=0.2, jitter=0.002, jitter_angle=0.06)
ADJUSTED = PoseNoise(drift=0.002, drift_angle=0.06, jitter=0.0005, jitter_angle=0.02)

# A survey's world is so far off the true one: two surveys are up to 2 cm and 0.5 degrees apart.
ASTRAY, TURNED = (0.005, 0.01), 0.25

# The camera on the body: it looks along the body's x axis, whose z axis points down.
SENSOR_ON_BODY = np.array([[0.0, 0.0, 1.0, 0.13], [1.0, 0.0, 0.0, 0.04], [0.0, 1.0, 0.0, -0.08], [0.0, 0.0, 0.0, 1.0]])


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """One survey, as the robot recorded it, with the truth.

    Attributes:
        laboratory: what was surveyed.
        camera: that it was surveyed with.
        frames: ordered, in the camera's coordinates, with their times.
        things: for each frame the label of what every point is on; -1 for flying pixels.
        poses: where the camera truly was at each frame, camera to world.
        localised: the body's poses by the robot's localisation.
        adjusted: the body's poses after bundle adjustment.
        sensor_on_body: the camera's extrinsics.
        misregistration: where the survey believes to be: true world to the survey's world.
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
    """The survey of a run of the laboratory: always the same for these arguments.

    Args:
        run: a name in `RUNS`.
        seed: of the places of the objects, the path and the noise.
        occasion: another one is another survey of the same run.
        pattern: of the path.
        frames: of the depth camera.

    Raises:
        InputError: an unknown run or pattern, or fewer than four frames.
    """
    surveyed = laboratory(run, seed)
    which = RUNS.index(run) + len(RUNS) * occasion
    start = START + DAY * which
    return recorded(surveyed, np.random.default_rng([seed, which]), pattern=pattern, frames=frames, start=start)


def recorded(
    laboratory: Laboratory,
    random: np.random.Generator,
    *,
    pattern: Pattern = "geometric",
    frames: int = FRAMES,
    start: float = START,
) -> Recording:
    """A survey of the laboratory.

    Args:
        laboratory: what to survey.
        random: where the path begins, how it is flown, and all noise.
        pattern: "geometric": along the walls, looking across the room; "panoramic": turning at two places.
        frames: of the depth camera.
        start: when the robot sets out, seconds.

    Raises:
        InputError: an unknown pattern, or fewer than four frames.
    """
    check_choice("pattern", pattern, get_args(Pattern))
    if frames < 4:
        raise InputError(f"frames={frames} must be at least 4")
    camera = DepthCamera(noise=random.uniform(0.006, 0.01))
    stands = _geometric(random, frames) if pattern == "geometric" else _panoramic(random, frames)
    times = start + FRAME_PERIOD * (1 + np.arange(frames))
    stood = Trajectory(times, np.stack(stands))
    # The camera's frames come a little before or after the robot is where it was sent.
    seen_at = np.sort(np.clip(times + random.uniform(-0.3, 0.3, frames), times[0], times[-1]))
    poses, _ = stood.at(seen_at, max_gap=np.inf)
    measured = [frame_from(laboratory, camera, pose, random, time) for pose, time in zip(poses, seen_at, strict=True)]
    misregistration = small_motion(random, random.uniform(*ASTRAY), random.uniform(0, TURNED))
    samples = np.arange(times[0] - POSE_PERIOD, times[-1] + 2 * POSE_PERIOD, POSE_PERIOD)
    samples = samples + random.uniform(-0.02, 0.02, len(samples))
    flown, _ = stood.at(samples, max_gap=np.inf)
    believed = misregistration @ flown @ np.linalg.inv(SENSOR_ON_BODY)
    return Recording(
        laboratory,
        camera,
        tuple(frame for frame, _ in measured),
        tuple(things for _, things in measured),
        poses,
        Trajectory(samples, _noisy(random, believed, LOCALISED)),
        Trajectory(samples, _noisy(random, believed, ADJUSTED)),
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
    """One frame from a pose (camera to world), and the label of what each of its points is on."""
    ranges, labels = camera.measured(laboratory.solids, pose, random)
    # Depth cameras measure in single precision.
    points = (camera.directions() * ranges[:, None]).astype(np.float32)
    frame = Frame.of_image(points.reshape(camera.rows, camera.columns, 3), float(time), SENSOR_FRAME)
    return frame, labels[frame.cloud.rows]


def _geometric(random: np.random.Generator, frames: int) -> list[np.ndarray]:
    """Along a rectangle at the walls, looking at the other side of the room (thesis 3.1.2)."""
    start = random.uniform(0, 2 * np.pi)
    poses = []
    for index in range(frames):
        angle = start + 2 * np.pi * index / frames
        outward = np.array([np.cos(angle), np.sin(angle)])
        rectangle = 0.62 * outward / np.abs(outward).max()
        # High and low by turns.
        high = index % 2
        position = np.array([*rectangle, (0.85, 1.25)[high]])
        target = np.array([*(-0.8 * outward), (0.65, 0.2)[high]])
        poses.append(looking_at(_about(random, position, 0.03), _about(random, target, 0.05)))
    return poses


def _panoramic(random: np.random.Generator, frames: int) -> list[np.ndarray]:
    """Turning round at two places, looking ahead and down by turns."""
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
    """The poses, each a little off by its own motion about where the body is."""
    share = np.linspace(0, 2 * np.pi, len(poses))
    waves = np.stack([np.sin(share), np.cos(share), np.sin(2 * share), np.cos(2 * share)])
    # The waves of an axis have the standard deviation 1 together.
    slow = np.einsum("wt,wa->ta", waves, random.standard_normal((4, 6))) / np.sqrt(2)
    fast = random.standard_normal((len(poses), 6))
    shift = noise.drift * slow[:, :3] + noise.jitter * fast[:, :3]
    turn = np.radians(noise.drift_angle * slow[:, 3:] + noise.jitter_angle * fast[:, 3:])
    noisy = poses.copy()
    noisy[:, :3, 3] += shift
    noisy[:, :3, :3] = Rotation.from_rotvec(turn).as_matrix() @ poses[:, :3, :3]
    return noisy
