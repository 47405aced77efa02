"""Records of settings as flags of a command."""

import dataclasses
import typing
from collections.abc import Mapping

from gmmjax.cli.help_texts import described, with_help, with_options


def flags_of(settings: type, values: Mapping[str, str] | None = None, texts: Mapping[str, str] | None = None) -> type:
    """A frozen record's fields, defaults and documentation without its checks.

    What the checks raise while the words are parsed would be taken for the parser's own errors; the command makes the
    record itself, and so raises them.

    Args:
        settings: the record.
        values: what the value of a field is called in the help, where that is not by its type.
        texts: of fields that are other ones on the command line, such as those that are switched off by a flag.
    """
    hints = typing.get_type_hints(settings)
    _, documentation = described(settings.__doc__ or "")
    documentation |= texts or {}
    fields = []
    for field in dataclasses.fields(settings):
        name, hint = field.name, hints[field.name]
        text = with_options(documentation[name], set(hints))
        fields.append((name, with_help(hint, text, field.default, (values or {}).get(name)), field.default))
    return dataclasses.make_dataclass("Flags", fields, namespace={"__doc__": settings.__doc__})
