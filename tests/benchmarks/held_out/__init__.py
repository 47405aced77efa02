"""Scenes of a generator that nothing was trained on or settled on: triangle meshes, terrain, sensors of their own."""

from tests.benchmarks.held_out.kinds import KINDS as KINDS
from tests.benchmarks.held_out.kinds import held_out_pair as held_out_pair
from tests.benchmarks.held_out.kinds import held_out_sources as held_out_sources
