"""JAX's compilation cache by one call, as a script uses it."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

import gmmjax
from gmmjax import InputError

SCRIPT = """
import sys
import jax
print(jax.jit(lambda x: x + 1)(1.0))  # Compiled before the cache is switched on.
import gmmjax
for number, folder in enumerate(sys.argv[1:]):
    print(gmmjax.use_compilation_cache(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    print(jax.jit(lambda x: x * 3 + number)(2.0))
"""


@pytest.fixture
def jax_settings(monkeypatch):
    """Without a cache at first; JAX's settings are as before when the test ends."""
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
    before = {name: jax.config.values[name] for name in names}
    jax.config.update("jax_compilation_cache_dir", None)
    yield
    for name, value in before.items():
        jax.config.update(name, value)


def test_programs_are_kept_in_the_latest_folder(tmp_path):
    root = Path(__file__).parents[1]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    environment["PYTHONPATH"] = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    folders = [tmp_path / "pro grams", tmp_path / "others"]
    command = [sys.executable, "-c", SCRIPT, *folders]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.stdout.split() == ["2.0", *str(folders[0]).split(), "6.0", str(folders[1]), "7.0"], done.stderr
    assert all(list(folder.iterdir()) for folder in folders)


@pytest.mark.usefixtures("jax_settings")
@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="the folder is another one there")
def test_the_folder_is_that_of_the_command_line(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert gmmjax.use_compilation_cache() == tmp_path / "gmmjax" / "compiled"
    assert jax.config.values["jax_compilation_cache_dir"] == str(tmp_path / "gmmjax" / "compiled")


@pytest.mark.usefixtures("jax_settings")
def test_what_the_user_has_set_stays(tmp_path, monkeypatch):
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    assert gmmjax.use_compilation_cache() == tmp_path
    jax.config.update("jax_compilation_cache_dir", None)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    assert gmmjax.use_compilation_cache() is None
    assert jax.config.values["jax_compilation_cache_dir"] is None
    assert gmmjax.use_compilation_cache(tmp_path / "own") == tmp_path / "own"


@pytest.mark.usefixtures("jax_settings")
def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file.sub: cannot keep compiled programs there: Not a directory"):
        gmmjax.use_compilation_cache(tmp_path / "file" / "sub")
    assert jax.config.values["jax_compilation_cache_dir"] is None
