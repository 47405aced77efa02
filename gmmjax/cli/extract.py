"""`gmmjax extract BAG --out FILE`."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from gmmjax.cli.options import check_output_file
from gmmjax.errors import InputError

if TYPE_CHECKING:
    from gmmjax.surveys import Bag, Frame, FrameMap, PlacedFrames, Trajectory

Six = tuple[float, float, float, float, float, float]
Seven = tuple[float, float, float, float, float, float, float]
Progress = Callable[[str, float], None]
DEPTH_SUFFIXES = (".png", ".npy")

# What `--help` shows.
COMMON = (
    *("source", "out", "topic", "at", "every", "rate", "start", "end", "poses", "map", "crop"),
    *("voxel_size", "intrinsics", "depth_unit", "overwrite"),
)


@dataclasses.dataclass(frozen=True)
class Options:
    """The selection from the bag, and the output.

    Attributes:
        out: output: one frame as .pcd, .ply or .npz; many frames as one .npz, or as a folder; a map as .ply.
            Without it the topics are listed.
        topic: topic of the point clouds; optional if the bag has only one.
        at: a single frame, the one nearest to this time: seconds as in the time stamps, or +SECONDS from
            the start of the bag.
        every: many frames: one out of this many.
        rate: many frames: at most this number a second.
        start: no frame before this time.
        end: no frame after this time.
        format: of the frames in a folder; pcd keeps the order of the pixels and the pose.
        poses: topic of the robot's poses (odometry, stamped poses or transforms such as /tf); points are then written
            in the world, and frames without a pose at their time are left out and counted.
        parent: of transforms, the coordinate frame of the world; default the root of the tree.
        child: the coordinate frame whose poses these are; default what the messages say, or the sensor for transforms.
        sensor_on_body: pose of the sensor on the body, position and quaternion; default what the bag's transforms say.
        max_gap: poses are not interpolated over longer gaps than this, seconds.
        map: merge the frames: localised concatenates them, volumetric fuses them into a surface. Next to the map,
            NAME_views.json says where the sensor stood, for detect.
        crop: box that a map is cropped to, by its lower and its upper corner.
        refine: refine the poses of a map's frames so that they fit together.
        voxel_size: of a volumetric map, metres.
        max_range: points of a map further than this from the sensor are left out, metres.
        intrinsics: of a depth image: JSON with fx, fy, cx, cy, width and height in pixels.
        depth_unit: metres for one number of a depth image; default what the file says.
        overwrite: replace an earlier output.
        quiet: print nothing but errors.
    """

    out: Annotated[Path | None, "PATH"] = None
    topic: Annotated[str | None, "TOPIC"] = None
    at: Annotated[str | None, "TIME"] = None
    every: Annotated[int | None, "N"] = None
    rate: Annotated[float | None, "HZ"] = None
    start: Annotated[str | None, "TIME"] = None
    end: Annotated[str | None, "TIME"] = None
    format: Literal["pcd", "ply"] = "pcd"
    poses: Annotated[str | None, "TOPIC"] = None
    parent: Annotated[str | None, "FRAME"] = None
    child: Annotated[str | None, "FRAME"] = None
    sensor_on_body: Annotated[Seven | None, "X Y Z QX QY QZ QW"] = None
    max_gap: Annotated[float, "SECONDS"] = 0.5
    map: Literal["localised", "volumetric"] | None = None
    crop: Annotated[Six | None, "X Y Z X Y Z"] = None
    refine: bool = False
    voxel_size: Annotated[float, "METRES"] = 0.01
    max_range: Annotated[float | None, "METRES"] = None
    intrinsics: Annotated[Path | None, "FILE"] = None
    depth_unit: Annotated[float | None, "METRES"] = None
    overwrite: bool = False
    quiet: bool = False

    def check(self, source: Path) -> None:
        """Finds out what cannot be done before the work begins.

        Raises:
            InputError: not exactly one thing to do, or an output that does not fit it or cannot be written.
        """
        many = self.every is not None or self.rate is not None
        wanted = {"--at": self.at, "--every or --rate": (many and not self.map) or None, "--map": self.map}
        given = [name for name, value in wanted.items() if value is not None]
        depth_image = source.suffix.lower() in DEPTH_SUFFIXES
        if self.out is None:
            if given or depth_image:
                raise InputError("--out is missing: give the file or the folder to write")
            return
        if len(given) != (not depth_image):
            what = "nothing of " if depth_image else "one of "
            raise InputError(
                f"{source}: give {what}--at, --every or --rate, --map; not {' and '.join(given) or 'none'}"
            )
        if depth_image and self.intrinsics is None:
            raise InputError(f"{source}: a depth image needs the intrinsics of its camera: --intrinsics FILE")
        if self.map is not None and self.poses is None:
            raise InputError("--map needs the poses of the frames: give their topic with --poses")
        self._check_out(self.out, many="--every or --rate" in given)

    def _check_out(self, out: Path, *, many: bool) -> None:
        from gmmjax.reporting.frame_files import FRAME_SUFFIXES, check_frame_folder

        if many and not out.suffix:
            check_frame_folder(out, overwrite=self.overwrite)
            return
        endings = (".ply",) if self.map else (".npz",) if many else FRAME_SUFFIXES
        others = (_views_of(out),) if self.map else ()
        hint = ", or be a folder, without ending" if many else ""
        check_output_file("--out", out, endings, others=others, overwrite=self.overwrite, hint=hint)


def extract(source: Annotated[Path, "BAG"], *, given: Annotated[dict[str, Any], Options]) -> int:
    """Extract frames and maps from a ROS bag, or the frame of a depth image, as files that detect reads.

    Reads bags of ROS 1 (.bag) and ROS 2 (a folder, .mcap or .db3), and depth images (.png, .npy). Without --out it
    lists the topics.

    Args:
        source: the bag, or the depth image.
        given: rarely needed.
    """
    from gmmjax.reporting import console
    from gmmjax.surveys import open_bag

    options = Options(**given)
    options.check(source)
    with console.shown_warnings(quiet=options.quiet):
        if source.suffix.lower() in DEPTH_SUFFIXES:
            assert options.out is not None
            files = _write_depth_image(source, options.out, options)
        else:
            with open_bag(source) as bag:
                if options.out is None:
                    console.print_topics(bag)
                    return 0
                with console.progress_bar(quiet=options.quiet) as progress:
                    files = _write(bag, options.out, options, progress)
    if not options.quiet:
        console.print_files(options.out if options.out.is_dir() else options.out.parent, files)
    return 0


def _write_depth_image(source: Path, out: Path, options: Options) -> dict[str, str]:
    from gmmjax.reporting.frame_files import write_frame
    from gmmjax.surveys import read_depth_frame, read_intrinsics

    assert options.intrinsics is not None
    frame = read_depth_frame(source, read_intrinsics(options.intrinsics), unit=options.depth_unit)
    write_frame(out, frame)
    return {out.name: f"{len(frame.cloud):,} points of {frame.width} x {frame.height} pixels"}


def _write(bag: "Bag", out: Path, options: Options, progress: Progress) -> dict[str, str]:
    """Writes what is asked for; gives what the files are, by name."""
    topic = bag.cloud_topic(options.topic)
    start, end = (_time(flag, text, bag) for flag, text in (("--start", options.start), ("--end", options.end)))
    trajectory = _trajectory(bag, topic, options, progress)
    if options.at is not None:
        time = _time("--at", options.at, bag)
        assert time is not None
        frame = bag.frame_at(topic, time)
        return _write_frame(frame, trajectory, out, options)
    first, last = bag.start if start is None else start, bag.end if end is None else end
    wanted = functools.partial(
        bag.frames, topic, every=1 if options.every is None else options.every, rate=options.rate, start=start, end=end
    )
    frames = functools.partial(_with_progress, wanted, first, last, progress)
    if options.map is not None:
        assert trajectory is not None
        return _write_map(frames, trajectory, out, options)
    return _write_frames(frames(), trajectory, out, options)


def _write_frame(frame: "Frame", trajectory: "Trajectory | None", out: Path, options: Options) -> dict[str, str]:
    from gmmjax.reporting.frame_files import write_frame

    pose = None
    if trajectory is not None:
        ((frame, pose),) = _placed([frame], trajectory, options)
    write_frame(out, frame, pose)
    return {out.name: f"{len(frame.cloud):,} points at {frame.time:.3f} s"}


def _write_frames(
    frames: Iterable["Frame"], trajectory: "Trajectory | None", out: Path, options: Options
) -> dict[str, str]:
    from gmmjax.reporting.frame_files import frame_archive, frame_folder

    placed = None if trajectory is None else _placed(frames, trajectory, options)
    folder = not out.suffix
    written = 0
    with frame_folder(out, options.format, overwrite=options.overwrite) if folder else frame_archive(out) as add:
        for frame, pose in ((frame, None) for frame in frames) if placed is None else placed:
            add(frame, pose)
            written += 1
    counted = _counted(written, 0 if placed is None else placed.skipped)
    if folder:
        return {f"frame_000000.{options.format}, ...": counted, "frames.json": "their times, and poses where known"}
    return {out.name: counted}


def _placed(frames: Iterable["Frame"], trajectory: "Trajectory", options: Options) -> "PlacedFrames":
    from gmmjax.surveys import PlacedFrames

    return PlacedFrames(frames, trajectory, max_gap=options.max_gap)


def _write_map(
    frames: Callable[[], Iterable["Frame"]], trajectory: "Trajectory", out: Path, options: Options
) -> dict[str, str]:
    from gmmjax.clouds import write_ply, write_views

    laid = _map(frames, trajectory, options)
    views = _views_of(out)
    write_views(views, laid.views)
    write_ply(out, laid.points)
    counted = _counted(laid.frames_used, laid.frames_skipped)
    return {out.name: f"{len(laid.points):,} points of {counted}", views.name: "where the sensor stood, for detect"}


def _map(frames: Callable[[], Iterable["Frame"]], trajectory: "Trajectory", options: Options) -> "FrameMap":
    from gmmjax.surveys import Trajectory, localised_map, volumetric_map

    bounds = None if options.crop is None else np.array(options.crop).reshape(2, 3)
    shared: dict[str, Any] = {"bounds": bounds, "max_range": options.max_range}
    max_gap = options.max_gap
    if options.map == "localised" or options.refine:
        laid = localised_map(frames(), trajectory, refine=options.refine, max_gap=max_gap, **shared)
        if options.map == "localised":
            return laid
        # Refined poses are those of the frames themselves.
        trajectory, max_gap = Trajectory.of_samples(laid.times, laid.poses), 0.0
    return volumetric_map(frames(), trajectory, voxel_size=options.voxel_size, max_gap=max_gap, **shared)


def _views_of(out: Path) -> Path:
    """The file beside a map that says where the sensor stood."""
    return out.with_name(f"{out.stem}_views.json")


def _trajectory(bag: "Bag", topic: str, options: Options, progress: Progress) -> "Trajectory | None":
    """The trajectory of the sensor, where poses are asked for."""
    from gmmjax.surveys import pose_matrix, sensor_trajectory

    if options.poses is None:
        return None
    progress("Reading the poses", 0.0)
    first = next(bag.frames(topic), None)
    extrinsics = None if options.sensor_on_body is None else np.array(options.sensor_on_body)
    return sensor_trajectory(
        bag,
        options.poses,
        "" if first is None else first.name,
        parent=options.parent,
        child=options.child,
        sensor_on_body=None if extrinsics is None else pose_matrix(extrinsics[:3], extrinsics[3:]),
        max_gap=options.max_gap,
    )


def _with_progress(
    frames: Callable[[], Iterable["Frame"]], start: float, end: float, progress: Progress
) -> Iterator["Frame"]:
    for frame in frames():
        progress("Reading the frames", (frame.time - start) / max(end - start, 1e-9))
        yield frame


def _counted(written: int, skipped: int) -> str:
    left_out = f", {skipped} left out, because no pose is near" if skipped else ""
    return f"{written} frame{'s' * (written != 1)}{left_out}"


def _time(flag: str, text: str | None, bag: "Bag") -> float | None:
    """Seconds since 1970; "+12.5" is from the bag's start."""
    if text is None:
        return None
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{flag} {text}: must be seconds as the stamps have them, or +SECONDS from the bag's start")
    return bag.start + number if text.startswith("+") else number
