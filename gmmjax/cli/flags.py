"""Records of settings as flags of a command."""

import dataclasses
import typing


def flags_of(settings: type) -> type:
    """A frozen record's fields, defaults and documentation without its checks.

    What the checks raise while the words are parsed would be taken for the parser's own errors; the command makes the
    record itself, and so raises them.
    """
    types = typing.get_type_hints(settings)
    fields = [(field.name, types[field.name], field.default) for field in dataclasses.fields(settings)]
    return dataclasses.make_dataclass("Flags", fields, namespace={"__doc__": settings.__doc__})
