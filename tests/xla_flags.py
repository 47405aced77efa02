"""How the tests have their programs compiled.

Half of the suite's time is LLVM's and XLA's: what a program computes is not optimised further than it must be, to
rounding the same.
"""

import os
import subprocess
import sys

UNOPTIMISED = "--xla_backend_optimization_level=0"
# The emitters that XLA had first take two thirds of the time of those that it has now.
FIRST_EMITTERS = "--xla_cpu_use_fusion_emitters=false"


def quickest_to_compile() -> str:
    """The flags that JAX starts with: a process with a flag that its jaxlib does not know ends at once."""
    both = f"{UNOPTIMISED} {FIRST_EMITTERS}"
    environment = {**os.environ, "XLA_FLAGS": both}
    started = subprocess.run([sys.executable, "-c", "import jax; jax.devices()"], env=environment, capture_output=True)
    return both if started.returncode == 0 else UNOPTIMISED
