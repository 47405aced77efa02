"""Bags opened with rosbags, and checked before they are believed."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gmmjax.clouds import read_bytes, require_file
from gmmjax.errors import LARGEST_INTEGER, InputError, one_line, shown
from gmmjax.surveys.bag_poses import POSE_TYPES, TF_TYPES

CLOUD_TYPES = ("sensor_msgs/msg/PointCloud2",)
TRANSFORM = "geometry_msgs/msg/TransformStamped"
SUFFIXES = (".bag", ".mcap", ".db3")
# Bytes of a bag's metadata.yaml, which has some hundred a topic; its parser takes five seconds for this size.
MAX_METADATA = 1 << 19
# What merges maps in YAML, in time that doubles with each, and what can give it another name; no recorder writes it.
MERGES = re.compile(rb"<<|!!merge|yaml\.org|%TAG")


@contextmanager
def open_reader(bag: Path) -> Iterator[Any]:
    """The reader of rosbags, open while the block runs.

    Raises:
        InputError: as `open_bag`.
    """
    load_rosbags(str(bag))
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    _check_path(bag)
    # What ROS 2 recorded before Iron has no definitions of its messages; those here have not changed since.
    known = get_typestore(Stores.ROS1_NOETIC if bag.suffix == ".bag" else Stores.LATEST)
    with readable(bag):
        reader = AnyReader([bag], default_typestore=known)
        reader.open()
    try:
        with readable(bag):
            _add_missing_types(reader, known)
            _check_definitions(reader, known, bag)
            _check_metadata(reader)
        yield reader
    finally:
        reader.close()


def load_rosbags(bag: str) -> None:
    """Import rosbags.

    Args:
        bag: what it is needed for, at the start of the message.

    Raises:
        InputError: it is not installed.
    """
    try:
        import rosbags.highlevel  # noqa: F401
    except ModuleNotFoundError as error:
        raise InputError(f"{bag}: ROS bags need {error.name}: pip install '.[ros]'") from error


@contextmanager
def readable(bag: Path) -> Iterator[None]:
    """Turn whatever the reader raises on a damaged bag into one error."""
    try:
        yield
    except (InputError, GeneratorExit, KeyboardInterrupt):
        raise
    # rosbags and the libraries below it raise a dozen kinds of exception on damaged files, AssertionError among them.
    except Exception as error:
        cause = one_line(error)
        remedy = (
            "write it without compression (rosbag decompress, or ros2 bag convert)"
            if "ompression" in cause
            else "if it is cut off or was not closed, copy it again, or mend it with rosbag reindex (ROS 1) or "
            "ros2 bag reindex"
        )
        raise InputError(f"{bag}: cannot be read ({cause}); {remedy}") from error


def _check_path(bag: Path) -> None:
    if not bag.exists():
        raise InputError(f"{bag}: no such file or folder; check the path (current folder: {Path.cwd()})")
    if bag.is_dir():
        _check_folder(bag)
        return
    require_file(bag)
    if bag.name.endswith(".active"):
        raise InputError(f"{bag}: was not closed; mend it with rosbag reindex, and take .active off its name")
    if bag.suffix not in SUFFIXES:
        raise InputError(f"{bag}: is no bag by its ending; bags are files with {', '.join(SUFFIXES)}, or folders")


def _check_folder(bag: Path) -> None:
    """A folder of ROS 2; whatever is in it may be opened by the reader."""
    if not (bag / "metadata.yaml").exists():
        raise InputError(
            f"{bag}: is no ROS 2 bag, because it has no metadata.yaml; name the folder that holds it or the file in "
            "it, or make it with ros2 bag reindex"
        )
    if MERGES.search(read_bytes(bag / "metadata.yaml", MAX_METADATA)):
        raise InputError(
            f"{bag / 'metadata.yaml'}: merges maps (<<), which is not read; write it with ros2 bag reindex"
        )
    for entry in bag.iterdir():
        # Empty files are none of ours: databases have such beside them.
        if not entry.is_dir() and not entry.is_file():
            require_file(entry)


def _add_missing_types(reader: Any, known: Any) -> None:
    """Definitions of messages that the bag has itself for other topics only."""
    defined = reader.typestore.fielddefs
    if {connection.msgtype for connection in reader.connections} - set(defined):
        reader.typestore.register({name: kind for name, kind in known.fielddefs.items() if name not in defined})


def _check_definitions(reader: Any, known: Any, bag: Path) -> None:
    """Check that the bag defines the messages that are read, and their parts, as ROS does."""
    waiting = [name for name in (*CLOUD_TYPES, *POSE_TYPES, *TF_TYPES) if name in reader.typestore.fielddefs]
    seen: set[str] = set()
    while waiting:
        name = waiting.pop()
        seen.add(name)
        fields = reader.typestore.fielddefs[name][1]
        if name in TF_TYPES:
            # ROS 1 has this message in no package that the library knows: a sequence of one kind of message.
            as_ros = [field for field, _ in fields] == ["transforms"] and list(_parts(fields)) == [TRANSFORM]
        else:
            as_ros = _plain(fields) == _plain(known.fielddefs[name][1])
        if not as_ros:
            raise InputError(
                f"{bag}: defines {name} otherwise than ROS; it is damaged, or record it with ROS's messages"
            )
        waiting += [part for part in _parts(fields) if part not in seen]


def _check_metadata(reader: Any) -> None:
    """Check that names are text, and counts and times whole numbers: YAML gives whatever stands there."""
    for connection in reader.connections:
        if not (isinstance(connection.topic, str) and isinstance(connection.msgtype, str)):
            raise ValueError(
                f"a topic's name or type is no text: {shown(connection.topic)}, {shown(connection.msgtype)}"
            )
        if not (isinstance(connection.msgcount, int) and 0 <= connection.msgcount <= LARGEST_INTEGER):
            raise ValueError(f"{connection.topic} has {shown(connection.msgcount)} messages")
    for time in (reader.start_time, reader.end_time):
        if not (isinstance(time, int) and 0 <= time <= LARGEST_INTEGER):
            raise ValueError(f"it starts or ends at {shown(time)} ns")


def _plain(fields: Any) -> Any:
    """The definition of fields as tuples, whose kinds compare across the libraries' versions."""
    return tuple(_plain(part) for part in fields) if isinstance(fields, list | tuple) else str(fields)


def _parts(fields: Any) -> Iterator[str]:
    """The names of messages in a definition of fields."""
    if isinstance(fields, list | tuple):
        for part in fields:
            yield from _parts(part)
    elif isinstance(fields, str) and "/msg/" in fields:
        yield fields
