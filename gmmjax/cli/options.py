"""The options of a command, read from its function's signature and docstring: parsed by argparse, shown as help."""

import argparse
import dataclasses
import difflib
import functools
import inspect
import re
import textwrap
import types
import typing
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NoReturn

from gmmjax.errors import InputError, shown

Command = Callable[..., int]

# What a value is called in the help, by its type, and of settings where the type does not say.
PLACEHOLDERS = {int: "N", float: "X", str: "TEXT", Path: "FILE"}
OF_SETTINGS = {
    **dict.fromkeys(("tolerance", "voxel_size", "noise_floor", "covariance_scale", "penalty"), "LENGTH"),
    **{"crop": "X Y Z X Y Z", "verdict": "FILE", "threshold": "P", "unit": "UNIT"},
}
# Argparse takes -1e-3 for an option without this.
NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$", re.IGNORECASE)
# Characters of the help: of its first column, and of choices that stand in it.
COLUMN, LONGEST = 24, 56


@dataclasses.dataclass(frozen=True)
class Option:
    """An argument of a command.

    Attributes:
        name: of the function's parameter, or of the record's field.
        kind: the type of its value; of one that may be None, the other type.
        text: what the help says of it.
        default: None also where there is none.
        placeholder: what its value is called; "-v" of a flag that counts, in brackets where the value may be left out.
        record: parameter that takes the field; None: it is a parameter itself.
        positional: whether it is given without its name.
        required: whether it must be given.
    """

    name: str
    kind: Any
    text: str
    default: Any
    placeholder: str
    record: str | None = None
    positional: bool = False
    required: bool = False

    @property
    def flag(self) -> str:
        """The option as it is typed; `--no-...` where it switches off what is on."""
        return f"--{'no-' * (self.default is True)}{self.name.replace('_', '-')}"

    @property
    def usage(self) -> str:
        """The option with its value, as the help shows it."""
        if self.positional:
            return self.placeholder
        if self.kind is bool or self.placeholder.startswith("-"):
            return self.flag
        return f"{self.flag} {self.placeholder}"

    @property
    def description(self) -> str:
        """The text of the help, with the default where there is one that says something."""
        if self.default is True:
            text = re.sub(r" False [^.]*\.", "", self.text)
            return f"switch off that {text.removeprefix('whether ')}"
        if self.required and not self.positional:
            return f"{self.text} Required."
        if self.default is None or self.default == () or self.kind is bool or self.placeholder.startswith("-"):
            return self.text
        values = self.default if isinstance(self.default, tuple) else (self.default,)
        return f"{self.text} Default: {' '.join(map(str, values))}."

    def arguments(self) -> dict[str, Any]:
        """The arguments of argparse for it."""
        if self.kind is bool:
            return {"action": f"store_{str(self.default is not True).lower()}"}
        if self.placeholder.startswith("-"):
            return {"action": "count"}
        kind, arguments = self.kind, {}
        if typing.get_origin(kind) is tuple:
            kinds = typing.get_args(kind)
            kind, arguments = kinds[0], {"nargs": "*" if ... in kinds else len(kinds)}
        return {"type": functools.partial(_read, kind), "metavar": self.placeholder, **arguments}


class _Parser(argparse.ArgumentParser):
    """Argparse, whose errors are ours."""

    def error(self, message: str) -> NoReturn:
        message = re.sub(r"^argument (?:-\w/)?(--[\w-]+)(?:/[\w-]+)?", r"\1", message)
        counted = re.fullmatch(r"(--\S+): expected (\w+|at least one) arguments?", message)
        if not counted:
            raise InputError(message)
        (placeholder,) = {action.metavar for action in self._actions if counted[1] in action.option_strings}
        raise InputError(f"{counted[1]} takes {counted[2]} value{'s' * (counted[2] != 'one')}: {placeholder}")


def parsed(command: Command, words: Sequence[str]) -> dict[str, Any]:
    """The arguments of a command's function; those that are not given are left out.

    A record's fields are one argument, a dictionary: the function makes the record, so that its errors are those of
    the record.

    Args:
        command: the function.
        words: of the command line, after the command.

    Raises:
        InputError: an option that there is not, a value that cannot be read, or none where one is needed.
    """
    options = options_of(command)
    places = [option for option in options if option.positional]
    parser = _Parser(prog="gmmjax", add_help=False, allow_abbrev=False, argument_default=argparse.SUPPRESS)
    parser._negative_number_matcher = NUMBER
    for option in options:
        if not option.positional:
            names = [option.flag, option.flag[:2] + option.flag[2:].replace("-", "_")]
            names += [option.placeholder] if option.placeholder.startswith("-") else []
            parser.add_argument(*dict.fromkeys(names), dest=option.name, required=option.required, **option.arguments())
        if option.default is True:
            # Over a file that switches it off.
            parser.add_argument(option.flag.replace("--no-", "--", 1), dest=option.name, action="store_true")
    found, others = parser.parse_known_args(_with_labels(options, words))
    if len(others) > len(places) or any(word.startswith("-") for word in others):
        raise InputError(_unknown(others[len(places) :] or others, options))
    given = vars(found) | {place.name: place.kind(word) for place, word in zip(places, others, strict=False)}
    if missing := [place.placeholder for place in places if place.required and place.name not in given]:
        raise InputError(f"{' '.join(missing)} is missing; --help shows what the command needs")
    values: dict[str, Any] = {option.record: {} for option in options if option.record is not None}
    for option in options:
        if option.name in given:
            value = given[option.name]
            place = values if option.record is None else values[option.record]
            place[option.name] = tuple(value) if isinstance(value, list) else value
    return values


def options_of(command: Command) -> list[Option]:
    """The arguments of a command: its parameters, and the fields of records in place of the parameters for them.

    A parameter that takes the fields of a record is `Annotated[dict[str, Any], Record]`; what a value is called in
    the help is `Annotated[Path, "DIR"]`. Parameters before the `*` are given without their names.

    Args:
        command: the function.
    """
    hints = typing.get_type_hints(command, include_extras=True)
    texts = described(command)[1]
    found: list[Option] = []
    for name, parameter in inspect.signature(command).parameters.items():
        kind, *marks = typing.get_args(hints[name]) if typing.get_origin(hints[name]) is Annotated else [hints[name]]
        if marks and dataclasses.is_dataclass(marks[0]):
            found += _fields(marks[0], name)
            continue
        required, positional = parameter.default is parameter.empty, parameter.kind is parameter.POSITIONAL_OR_KEYWORD
        default = None if required else parameter.default
        found.append(_option(name, kind, texts[name], default, *marks, required=required, positional=positional))
    names = {option.name for option in found}
    return [dataclasses.replace(option, text=_with_flags(option.text, names)) for option in found]


def described(documented: Any) -> tuple[Sequence[str], dict[str, str]]:
    """The paragraphs of a Google-style docstring, and the text of each argument or attribute, each in one line."""
    head, *rest = re.split(r"^(?:Args|Attributes):\n", inspect.getdoc(documented) or "", maxsplit=1, flags=re.MULTILINE)
    paragraphs = [" ".join(paragraph.split()) for paragraph in head.split("\n\n") if paragraph.strip()]
    # A section ends at the next line without an indent.
    fields = re.split(r"^(?=\S)", "".join(rest), maxsplit=1, flags=re.MULTILINE)[0]
    entries = re.findall(r"^    (\w+): (.*?)(?=^    \w+: |\Z)", fields, re.MULTILINE | re.DOTALL)
    return paragraphs, {name: " ".join(text.split()) for name, text in entries}


def help_of(name: str, command: Command, width: int, common: Sequence[str], *, everything: bool) -> str:
    """The help of a command.

    Args:
        name: of the command.
        command: its function.
        width: of the terminal, characters.
        common: names of the arguments that come first, in this order; empty: there are so few that all are shown.
        everything: whether the others follow.
    """
    options = options_of(command)
    first = [option for name in common for option in options if option.name == name] or options
    others = [option for option in options if option not in first]
    needed = [option.usage for option in options if option.required and not option.positional]
    positional = [option.placeholder for option in options if option.positional]
    usage = " ".join(["usage: gmmjax", name, *positional, *needed, "[options]"])
    blocks = [_wrapped(paragraph, width) for paragraph in (*described(command)[0], usage)]
    blocks.append("\n".join(_entry(option, width) for option in first))
    if everything:
        texts = described(command)[1]
        for record in dict.fromkeys(option.record for option in others):
            entries = [_entry(option, width) for option in others if option.record == record and not option.positional]
            heading = "rarely needed" if record is None else texts[record].rstrip(".")
            blocks += [f"{heading[0].upper()}{heading[1:]}:", "\n".join(entries)]
    elif others:
        blocks.append(f"gmmjax {name} --help-all shows all options.")
    return "\n\n".join(blocks)


def check_output_file(
    flag: str, path: Path, endings: Sequence[str], *, others: Sequence[Path] = (), overwrite: bool, hint: str = ""
) -> None:
    """Finds out before the work begins whether a file can be written.

    Args:
        flag: that names it.
        path: of the file.
        endings: that it may have.
        others: files that are written beside it.
        overwrite: whether those that are there may be replaced.
        hint: what else is possible, after the endings.

    Raises:
        InputError: it cannot.
    """
    if path.suffix not in endings:
        raise InputError(f"{flag} {path}: must end in {', '.join(endings)}{hint}")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{flag} {path}: there is no folder {path.parent}; make it first")
    for file in (path, *others):
        if file.exists() and not overwrite:
            raise InputError(f"{flag} {path}: {file} is there already; --overwrite replaces it")


def _fields(record: Any, parameter: str) -> Iterator[Option]:
    """The fields of a record as options."""
    hints, texts = typing.get_type_hints(record, include_extras=True), described(record)[1]
    for field in dataclasses.fields(record):
        hint = hints[field.name]
        kind, *marks = typing.get_args(hint) if typing.get_origin(hint) is Annotated else [hint]
        yield _option(field.name, kind, texts[field.name], field.default, *marks, record=parameter)


def _option(name: str, hint: Any, text: str, default: Any, placeholder: str | None = None, **more: Any) -> Option:
    kind = hint
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        (kind,) = (part for part in typing.get_args(hint) if part is not type(None))
    value = typing.get_args(kind)[0] if typing.get_origin(kind) is tuple else kind
    choices = ",".join(_choices(value))
    listed = f"{{{choices}}}" if len(choices) < LONGEST else "NAME"
    called = OF_SETTINGS.get(name) or (listed if choices else PLACEHOLDERS.get(value, ""))
    called += " ..." * (value is not kind and name not in OF_SETTINGS)
    # The texts of the library say what None means.
    text = re.sub(r"(^|[.;:] )None: ", r"\1Default: ", text)
    return Option(name, kind, text, default, placeholder or called, **more)


def _choices(kind: Any) -> tuple[str, ...]:
    """The words of a choice, or of a union of them; none of other types."""
    if typing.get_origin(kind) is typing.Literal:
        return typing.get_args(kind)
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return tuple(word for part in typing.get_args(kind) for word in _choices(part))
    return ()


def _with_flags(text: str, names: set[str]) -> str:
    """The text in which other options have the names that are typed."""
    return re.sub(r"`(\w+)`", lambda found: f"--{found[1].replace('_', '-')}" if found[1] in names else found[0], text)


def _read(kind: Any, word: str) -> Any:
    """A value, or an error that says what is wrong with it."""
    choices = _choices(kind)
    if choices and word not in choices:
        raise argparse.ArgumentTypeError(f"{shown(word)} is none of {', '.join(choices)}")
    try:
        return word if choices else kind(word)
    except ValueError:
        whole = "whole " * (kind is int)
        raise argparse.ArgumentTypeError(f"{shown(word)} is not a {whole}number") from None


def _with_labels(options: Sequence[Option], words: Sequence[str]) -> list[str]:
    """The words with "all" after an option whose label is left out, as `--explain` before the scans."""
    flags = {option.flag for option in options if option.placeholder.startswith("[")}
    found = []
    for index, word in enumerate(words):
        found.append(word)
        if word in flags and not "".join(words[index + 1 : index + 2]).isdecimal():
            found.append("all")
    return found


def _unknown(words: Sequence[str], options: Sequence[Option]) -> str:
    """Name the error of words that are left over."""
    word = next((word for word in words if word.startswith("-")), None)
    if word is None:
        return f"{' '.join(map(shown, words))}: more than the command takes; --help shows what it does"
    close = difflib.get_close_matches(word.split("=")[0], [option.flag for option in options], n=1)
    return f"{word}: there is no such option; {f'do you mean {close[0]}? ' if close else ''}--help-all lists them"


def _wrapped(text: str, width: int, **more: Any) -> str:
    return textwrap.fill(text, max(width, 20), break_long_words=False, break_on_hyphens=False, **more)


def _entry(option: Option, width: int) -> str:
    """The lines of an option: what is typed, and beside or below it what it does."""
    usage, indent = f"  {option.usage}", " " * COLUMN
    if len(usage) + 2 <= COLUMN:
        return _wrapped(option.description, width, initial_indent=f"{usage:<{COLUMN}}", subsequent_indent=indent)
    return f"{usage}\n{_wrapped(option.description, width, initial_indent=indent, subsequent_indent=indent)}"
