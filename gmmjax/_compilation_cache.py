"""JAX's compiled programs kept from one run of the command line to the next."""

import os
import sys
from pathlib import Path

# Programs that compile faster than this are not worth a file.
LEAST_SECONDS = 0.3


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


def use_compilation_cache() -> None:
    """Switches JAX's persistent compilation cache on, unless the user has set JAX's own variable for it.

    A folder that cannot be written is passed over: everything works without, and compiles anew.
    """
    import jax

    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: the user has no home folder.
        return
    if os.access(folder, os.W_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", LEAST_SECONDS)
