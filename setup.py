"""Builds the compiled kernels where there is a C++ compiler; the rest of the set-up is in pyproject.toml.

Without a compiler, or with one that does not know these flags, the package installs all the same and computes in plain
JAX: the extension is optional.
"""

import sysconfig
from pathlib import Path

import jaxlib
from setuptools import Extension, setup

NATIVE = Path("gmmjax", "native")

kernels = Extension(
    "gmmjax.native._kernels",
    sources=[source.as_posix() for source in sorted(NATIVE.glob("*.cc"))],
    depends=[header.as_posix() for header in sorted(NATIVE.glob("*.h"))],
    # As system headers: their warnings are not ours.
    extra_compile_args=[
        "-std=c++17",
        "-O3",
        "-DNDEBUG",
        "-fvisibility=hidden",
        "-fno-math-errno",
        "-fno-trapping-math",
        # GCC's default: a product and a sum are one operation where the machine has it.
        "-ffp-contract=fast",
        "-Wno-psabi",
        "-isystem",
        str(Path(jaxlib.__file__).parent / "include"),
    ],
    language="c++",
    py_limited_api=True,
    optional=True,
)
limited = {} if sysconfig.get_config_var("Py_GIL_DISABLED") else {"bdist_wheel": {"py_limited_api": "cp311"}}
setup(ext_modules=[kernels], options=limited)
