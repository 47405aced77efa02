"""Which command is meant, and how it ends: the exit status, and errors as one line."""

import difflib
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module

from gmmjax._messages import print_message
from gmmjax.cli.options import help_of, parsed
from gmmjax.cli.start import INTERRUPTED, INTERRUPTION, starting
from gmmjax.errors import ComputationError, InputError

DONE = 0
FAILED = 1
BAD_INPUT = 2
# What a shell reports for a program that SIGPIPE ended, as it ends others whose reader has gone.
PIPE_CLOSED = 141

# What nearly all commands need, and with it most of what takes time to import: before the work begins, so that an
# interruption finds no import half done.
NEEDED = ("gmmjax.reporting.console", "gmmjax.changes.detectors.joint")
HELP, HELP_ALL = frozenset({"-h", "--help"}), "--help-all"
MORE = "gmmjax COMMAND --help shows the options of a command, gmmjax --version the version."
DESCRIPTION = "What changed between two 3D scans, and how sure are you?"

# Command: its module in this package, which has a function of its name, and its line in the help. Only this module is
# imported. Where a command has many options, those that `--help` shows are the module's `COMMON`.
COMMANDS: Mapping[str, tuple[str, str]] = {
    "detect": ("detect", "Find what changed between two scans: a list, labels for all points, a report."),
    "batch": ("batch", "Find what changed in many pairs of scans, on all cores or a cluster; can be resumed."),
    "fit": ("fit", "Fit a Gaussian mixture to a scan; the number of Gaussians comes from the data."),
    "extract": ("extract", "Extract frames and maps from a ROS bag or a depth image, as files that detect reads."),
    "simulate gaussians": ("simulate_gaussians", "Sample a pair of clouds from Gaussians, with ground truth."),
    "simulate lab": ("simulate_lab", "Simulate a laboratory surveyed by a robot: bags, frames, maps, ground truth."),
    "evaluate gaussians": ("evaluate", "Score detectors on artificial scenes of Gaussians."),
    "evaluate laboratory": ("evaluate", "Score detectors on a simulated room."),
    "evaluate scenes": ("evaluate", "Score detectors on simulated rooms, halls, corridors and other places."),
    "evaluate pairs": ("evaluate", "Score detectors on pairs of scans with ground truth."),
    "evaluate thesis": ("evaluate_thesis", "Reproduce chapter 4 of the thesis, next to its published numbers."),
    "tune": ("tune", "Tune settings by gradient on pairs of scans, with or without ground truth."),
    "demo": ("demo", "Simulate two scans of a storehouse, detect the changes, and compare them with the truth."),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        arguments: without the program's name; default those of the process.

    Returns:
        0 done, whether or not there were changes; 1 the computation failed; 2 bad usage or input; 130 interrupted;
        141 the reader of the output has closed it.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        try:
            with starting(own_process=arguments is None) as loaded:
                return _status(words, loaded)
        finally:
            # What is left in the buffer would fail to be written when it is too late to give a status.
            if sys.stdout is not None:
                sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as error:
        # Rich's console ends the program where a pipe is closed.
        if not isinstance(error, BrokenPipeError) and not isinstance(error.__context__, BrokenPipeError):
            raise
        _discard_output()
        return PIPE_CLOSED


def _status(words: list[str], loaded: Callable[[], object]) -> int:
    try:
        return _run(words, loaded)
    except InputError as error:
        print_message(f"error: {as_given(str(error), words)}")
        return BAD_INPUT
    except ComputationError as error:
        print_message(f"error: {error}")
        return FAILED
    except KeyboardInterrupt:
        print_message(INTERRUPTION)
        return INTERRUPTED


def as_given(message: str, words: list[str]) -> str:
    """A message that begins with an argument, named as it was given: `--tile-size 0.5` in place of `tile_size=0.5`."""
    name, equals, rest = message.partition("=")
    option = f"--{name.replace('_', '-')}"
    given = {word.split("=")[0] for word in words}
    return f"{option} {rest}" if equals and option in given else message


def _discard_output() -> None:
    """Lets what is still to be written to standard output go nowhere, so that the interpreter ends in silence."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(words: list[str], loaded: Callable[[], object]) -> int:
    width = shutil.get_terminal_size().columns
    if words == ["--version"]:
        from gmmjax import __version__

        print(f"gmmjax {__version__}")
        return DONE
    count = 2 if " ".join(words[:2]) in COMMANDS else 1
    name, words = " ".join(words[:count]), words[count:]
    if name not in COMMANDS:
        if HELP.isdisjoint([name, *words]):
            raise InputError(_unknown([name, *words]))
        print(overview(width))
        return DONE
    module = import_module(f"gmmjax.cli.{COMMANDS[name][0]}")
    command = getattr(module, name.replace(" ", "_"))
    if HELP_ALL in words or not HELP.isdisjoint(words):
        print(help_of(name, command, width, getattr(module, "COMMON", ()), everything=HELP_ALL in words))
        return DONE
    arguments = parsed(command, words)
    for needed in NEEDED:
        import_module(needed)
    loaded()
    return int(command(**arguments))


def overview(width: int) -> str:
    """The help of the program: its commands, a line or more for each."""
    longest = max(map(len, COMMANDS))
    lines = [DESCRIPTION, "", "usage: gmmjax COMMAND ...", ""]
    for name, (_, text) in COMMANDS.items():
        # In a terminal that leaves hardly any room for the text it is better that it wraps by itself.
        first, *others = textwrap.wrap(text, max(width - longest - 4, 20))
        lines += [f"  {name:<{longest}}  {first}", *(" " * (longest + 4) + other for other in others)]
    return "\n".join([*lines, "", *textwrap.wrap(MORE, width)])


def _unknown(words: list[str]) -> str:
    """Name the error of words that do not begin with a command, and what may be meant."""
    if not words[0]:
        return "give a command, such as detect; gmmjax --help lists them"
    name, places = words[0], (" ".join(words[:2]), words[0])
    close = [found for place in places for found in difflib.get_close_matches(place, COMMANDS, n=1)]
    parts = [command for command in COMMANDS if command.startswith(f"{name} ")]
    meant = " or ".join(parts or close[:1])
    return f"{name} is no command{f'; do you mean {meant}?' if meant else ';'} gmmjax --help lists them"
