"""Errors, warnings and notes of the command line, on standard error."""

import shutil
import sys
import textwrap

from gmmjax.errors import printable


def print_message(text: str) -> None:
    """Prints a message as one line that begins with the program's name; a terminal breaks it between words.

    Args:
        text: the message; what a terminal would take for a command is escaped.
    """
    line = printable(f"gmmjax: {text}")
    stream = sys.stderr
    if stream is not None and stream.isatty():
        width = max(shutil.get_terminal_size().columns, 20)
        line = textwrap.fill(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    print(line, file=stream)
