"""Which command is meant, and how it ends: the exit status, errors as one line, warnings as one line."""

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module

from gmmjax._messages import print_message
from gmmjax.cli.garbage import no_search_of_imports
from gmmjax.cli.interruption import INTERRUPTED, INTERRUPTION, interruptions
from gmmjax.errors import ComputationError, InputError

DONE = 0
FAILED = 1
BAD_INPUT = 2
# What a shell reports for a program that SIGPIPE ended, as it ends others whose reader has gone.
PIPE_CLOSED = 141

# What nearly all commands need, and with it most of what takes time to import: before the work begins, so that an
# interruption finds no import half done.
NEEDED = ("gmmjax.reporting.console", "gmmjax.changes.detectors.joint")
HELP = frozenset({"-h", "--help"})
DESCRIPTION = "What changed between two 3D scans, and how sure are you?   (gmmjax --version prints the version.)"

# Command: its module in this package, which has a function `command(arguments)` that gives the function to be run on
# them, and its line in the help. Only the module of the command at hand is imported.
COMMANDS: Mapping[str, tuple[str, str]] = {
    "detect": ("detect", "What changed from one scan to another: a list, labels for all points, a report."),
    "batch": ("batch", "What changed in many pairs of scans, on all cores or a cluster; goes on where it stopped."),
    "fit": ("fit", "Fit a Gaussian mixture to a scan; the number of Gaussians is found."),
    "extract": ("extract", "Frames and maps from a ROS bag or a depth image, as files that detect reads."),
    "simulate gaussians": ("simulate_gaussians", "A pair of clouds drawn from Gaussians, with the truth."),
    "simulate lab": ("simulate_lab", "A laboratory that a robot surveys: bags, frames, maps, pairs with the truth."),
    "evaluate gaussians": ("evaluate_gaussians", "Score detectors on artificial scenes of Gaussians."),
    "evaluate laboratory": ("evaluate_laboratory", "Score detectors on a simulated room."),
    "evaluate scenes": ("evaluate_scenes", "Score detectors on simulated rooms, halls, corridors, modules."),
    "evaluate pairs": ("evaluate_pairs", "Score detectors on pairs of scans with truth."),
    "evaluate thesis": ("evaluate_thesis", "Run chapter 4 of the thesis again, beside its published numbers."),
    "tune": ("tune", "Tune settings by gradient on pairs of scans, with truth or without."),
    "demo": ("demo", "Simulate two scans of a storehouse, detect the changes, and compare them with the truth."),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        arguments: without the program's name; default those of the process.

    Returns:
        0 done, whether or not there were changes; 1 the computation failed; 2 bad usage or input; 130 interrupted;
        141 the reader of the output has closed it.

    Raises:
        SystemExit: with 2 on bad usage, with 0 after help.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        try:
            with (
                no_search_of_imports(own_process=arguments is None) as imported,
                interruptions() as interruptible,
            ):
                return _status(words, lambda: (imported(), interruptible()))
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
    if words == ["--version"]:
        from gmmjax import __version__

        print(f"gmmjax {__version__}")
        return DONE
    try:
        return _run(words, loaded)
    except InputError as error:
        print_message(f"error: {error}")
        return BAD_INPUT
    except ComputationError as error:
        print_message(f"error: {error}")
        return FAILED
    except KeyboardInterrupt:
        print_message(INTERRUPTION)
        return INTERRUPTED


def _discard_output() -> None:
    """Lets what is still to be written to standard output go nowhere, so that the interpreter ends in silence."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(words: list[str], loaded: Callable[[], object]) -> int:
    import tyro

    words = _joined(words)
    name = words[0] if words else ""
    commands: dict[str, Callable[..., int]] = {other: _summary(text) for other, (_, text) in COMMANDS.items()}
    if name in COMMANDS:
        module = import_module(f"gmmjax.cli.{COMMANDS[name][0]}")
        if HELP.isdisjoint(words):
            for needed in NEEDED:
                import_module(needed)
        loaded()
        if name == "detect":
            words = [name, *module.completed(words[1:])]
        commands[name] = module.command(words[1:])
    result = tyro.extras.subcommand_cli_from_dict(
        commands, prog="gmmjax", description=DESCRIPTION, args=words, config=(tyro.conf.FlagCreatePairsOff,)
    )
    return int(result)


def _joined(words: list[str]) -> list[str]:
    """The words with a command of two words as one: "simulate", "gaussians", ..."""
    if " ".join(words[:2]) in COMMANDS:
        return [" ".join(words[:2]), *words[2:]]
    return words


def _summary(text: str) -> Callable[[], int]:
    """Stands in for a command that is not the one at hand, for its line in the help."""

    def command() -> int:
        return DONE

    command.__doc__ = text
    return command
