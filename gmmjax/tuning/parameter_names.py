"""The names of the settings that can be tuned."""

from typing import Literal, get_args

ParameterName = Literal[
    "noise_floor", "tolerance", "concentration", "noise_share", "covariance_scale", "degrees_of_freedom"
]
PARAMETERS: tuple[ParameterName, ...] = get_args(ParameterName)
# The parameters of the verdict on scans, all together.
Verdict = Literal["verdict"]
VERDICT: Verdict = "verdict"
Tunable = ParameterName | Verdict
TUNABLE: tuple[Tunable, ...] = (VERDICT, *PARAMETERS)
