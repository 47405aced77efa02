"""Large halls and slopes as surveyors scan them, with the truth, from a generator that nothing was trained on."""

from tests.benchmarks.surveyor.kinds import HELD_OUT as HELD_OUT
from tests.benchmarks.surveyor.kinds import KINDS as KINDS
from tests.benchmarks.surveyor.kinds import hall_scene as hall_scene
from tests.benchmarks.surveyor.kinds import simulated as simulated
from tests.benchmarks.surveyor.kinds import slope_scene as slope_scene
