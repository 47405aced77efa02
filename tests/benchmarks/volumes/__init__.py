"""The volumes of simulated changes beside the true ones: `python -m tests.benchmarks.volumes`."""
