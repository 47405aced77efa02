"""The help of a command, from the documentation of its function and of its settings."""

import dataclasses
import functools
import inspect
import re
import textwrap
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import tyro

# What a value is called in the help, by its type.
VALUES: Mapping[type, str] = {int: "N", float: "X", str: "TEXT"}


def documented(function: Callable[..., int]) -> Callable[..., int]:
    """The function of a command with its help as the parser shows it best.

    The lines of each text are joined, so that they are broken where the terminal ends, and "(default: None)" is left
    out: the texts say what happens then.

    Args:
        function: of a command, or a partial one.
    """
    inner = _inner(function)
    hints = typing.get_type_hints(inner, include_extras=True)
    _, texts = described(inner.__doc__ or "")
    signature = inspect.signature(function)

    def run(*arguments: Any, **named: Any) -> int:
        return function(*arguments, **named)

    parameters = [
        parameter.replace(
            annotation=with_help(hints[name], with_options(texts.get(name, ""), set(hints)), parameter.default)
        )
        for name, parameter in signature.parameters.items()
    ]
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def description_of(function: Callable[..., int], width: int) -> str:
    """What a command does, for above its options, which the parser would not break into lines.

    Args:
        function: of the command, or a partial one.
        width: of the terminal, characters.
    """
    paragraphs, _ = described(_inner(function).__doc__ or "")
    return "\n\n".join(
        textwrap.fill(paragraph, max(width, 20), break_long_words=False, break_on_hyphens=False)
        for paragraph in paragraphs
    )


def _inner(function: Callable[..., int]) -> Callable[..., int]:
    return function.func if isinstance(function, functools.partial) else function


def with_help(hint: Any, text: str, default: Any, value: str | None = None) -> Any:
    """The type of an option with what the parser is to say of it.

    Args:
        hint: the type; what it is annotated with comes first.
        text: of the help. Where a sentence begins with "None:", the help says "Default:".
        default: of the option; one that says nothing, such as None, is not shown.
        value: what its value is called; default by its type.
    """
    silent = default is None or isinstance(default, bool) or default == ()
    text = re.sub(r"(^|[.;] )None: ", r"\1Default: ", text)
    metavar = value or _value(hint)
    told = tyro.conf.arg(help=text or None, help_behavior_hint="" if silent else None, metavar=metavar)
    # What the type says itself comes last, and wins.
    own = typing.get_args(hint) if typing.get_origin(hint) is Annotated else (hint,)
    return Annotated[own[0], told, *_parser(hint, metavar), *own[1:]]


def with_options(text: str, names: set[str]) -> str:
    """A text in which settings have the names of their options."""
    return re.sub(r"`(\w+)`", lambda found: f"--{found[1].replace('_', '-')}" if found[1] in names else found[0], text)


def described(documentation: str) -> tuple[Sequence[str], dict[str, str]]:
    """The paragraphs of a Google-style docstring, and the text of each argument or attribute, each in one line."""
    body = inspect.cleandoc(documentation)
    head, *rest = re.split(r"^(?:Args|Attributes):\n", body, maxsplit=1, flags=re.MULTILINE)
    paragraphs = [" ".join(paragraph.split()) for paragraph in head.split("\n\n") if paragraph.strip()]
    # A section ends at the next line without an indent.
    fields = re.split(r"^(?=\S)", "".join(rest), maxsplit=1, flags=re.MULTILINE)[0]
    entries = re.findall(r"^    (\w+): (.*?)(?=^    \w+: |\Z)", fields, re.MULTILINE | re.DOTALL)
    return paragraphs, {name: " ".join(text.split()) for name, text in entries}


def record_with_help(record: type) -> type:
    """A record of options, with what the parser is to say of each field by the record's documentation.

    Args:
        record: a dataclass with a Google-style docstring.
    """
    hints = typing.get_type_hints(record, include_extras=True)
    _, texts = described(record.__doc__ or "")
    for field in dataclasses.fields(record):
        record.__annotations__[field.name] = with_help(
            hints[field.name], with_options(texts[field.name], set(hints)), field.default
        )
    return record


def _parser(hint: Any, metavar: str | None) -> tuple[tyro.constructors.PrimitiveConstructorSpec[Any], ...]:
    """How a number is read, for an error that says what is wrong with it; nothing for other types."""
    kind, optional = _kind(hint)
    if kind not in (int, float):
        return ()

    def parsed(words: list[str]) -> int | float | None:
        if optional and words[0] == "None":
            return None
        try:
            return kind(words[0])
        except ValueError:
            raise ValueError(f"{words[0]!r} is not a {'whole ' if kind is int else ''}number") from None

    return (
        tyro.constructors.PrimitiveConstructorSpec(
            nargs=1,
            metavar=metavar or VALUES[kind],
            instance_from_str=parsed,
            is_instance=lambda value: isinstance(value, int | float) or (optional and value is None),
            str_from_instance=lambda value: [str(value)],
        ),
    )


def _value(hint: Any) -> str | None:
    """What a value of a type is called; None where the parser says it best, such as for choices."""
    kind, _ = _kind(hint)
    return None if kind is None else VALUES.get(kind)


def _kind(hint: Any) -> tuple[Any, bool]:
    """The type of a value, and whether it may be None; no type where it is one of several."""
    if typing.get_origin(hint) is Annotated:
        hint, *marks = typing.get_args(hint)
        if tyro.conf.UseCounterAction in marks:
            return None, False
    if typing.get_origin(hint) not in (typing.Union, types.UnionType):
        return hint, False
    kinds = [kind for kind in typing.get_args(hint) if kind is not type(None)]
    return (kinds[0] if len(kinds) == 1 else None), True
