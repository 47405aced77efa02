"""JAX's compiled programs kept from one run to the next."""

import os
import sys
from pathlib import Path

from gmmjax.errors import InputError

# To read a compiled program back takes 20 ms and more: what compiles faster is not worth a file.
MIN_SECONDS = 0.02


def cache_folder() -> Path:
    """The folder for the programs, in the user's cache folder of this platform."""
    home = Path.home()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "gmmjax" / "compiled"


def use_compilation_cache(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keeps the programs that JAX compiles, so that the next run of a script need not compile them again.

    The command line calls it by itself. It sets two of JAX's global settings, `jax_compilation_cache_dir` and
    `jax_persistent_cache_min_compile_time_secs`, and so applies to all programs that JAX compiles in this process from
    then on, those of other libraries included. Results are the same. JAX trusts what is in the folder: choose one that
    nobody else can write to.

    Args:
        folder: for the programs; is made where needed. None: `gmmjax/compiled` in the user's cache folder, which the
            command line uses too (`~/.cache/gmmjax/compiled` on Linux), unless JAX has a folder already, or its own
            variable `JAX_COMPILATION_CACHE_DIR` is set; an empty one disables the cache.

    Returns:
        The folder that is used. None where the cache is disabled, or the user's cache folder cannot be written:
        everything works without, and compiles anew.

    Raises:
        InputError: a folder was given, and cannot be made or written.
    """
    import jax

    used = jax.config.values["jax_compilation_cache_dir"]
    if folder is None and (used or "JAX_COMPILATION_CACHE_DIR" in os.environ):
        return Path(used) if used else None
    try:
        # Of a user without a home folder, Python raises a RuntimeError.
        target = cache_folder() if folder is None else Path(folder).resolve()
        target.mkdir(parents=True, exist_ok=True)
        if not os.access(target, os.W_OK):
            raise PermissionError(None, "it may not be written")
    except (OSError, RuntimeError) as error:
        if folder is None:
            return None
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{folder}: cannot keep compiled programs there: {reason}; choose another folder") from error
    _keep_in(target)
    return target


def _keep_in(folder: Path) -> None:
    import jax
    from jax.experimental.compilation_cache import compilation_cache

    if jax.config.values["jax_compilation_cache_dir"] != str(folder):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        # JAX goes on with the folder that it has opened, whatever its setting says since.
        compilation_cache.reset_cache()
    jax.config.update("jax_persistent_cache_min_compile_time_secs", MIN_SECONDS)
