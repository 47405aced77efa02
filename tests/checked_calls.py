"""The check of types, which is built when a function is called first: a process calls a part of them."""

import functools

import beartype


def checked(function):
    """Check the types of the arguments and of the result from the first call on."""
    check = None

    @functools.wraps(function)
    def call(*arguments, **named):
        nonlocal check
        if check is None:
            check = beartype.beartype(function)
        return check(*arguments, **named)

    return call
