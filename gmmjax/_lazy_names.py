"""Public names of a package that are imported when they are first asked for (PEP 562)."""

import ast
import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """What makes a package import its public names when they are first asked for: its `__getattr__` and `__dir__`.

    The names are those that the package imports for type checkers, so that they are written down once:

        if TYPE_CHECKING:
            from package.module import Name as Name

        __getattr__, __dir__ = lazy_names(__name__)

    No module of the package may have the name of one of them: once imported, it would be found in its place.

    Args:
        package: its full name; it is being imported.
    """
    module = sys.modules[package]
    homes = _homes(inspect.getsource(module))

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        own_module = homes[name] == package
        value = import_module(f"{package}.{name}") if own_module else getattr(import_module(homes[name]), name)
        setattr(module, name, value)
        return value

    return get, lambda: sorted({*vars(module), *homes})


def _homes(source: str) -> dict[str, str]:
    """The module of each name that is imported in an `if TYPE_CHECKING:` of a source."""
    blocks = [node for node in ast.parse(source).body if isinstance(node, ast.If)]
    lines = [line for block in blocks for line in block.body if isinstance(line, ast.ImportFrom)]
    return {name.asname or name.name: line.module or "" for line in lines for name in line.names}
