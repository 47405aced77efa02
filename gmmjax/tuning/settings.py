"""Settings of the tuning: one frozen record with documented defaults."""

import dataclasses
from typing import Literal, get_args

from gmmjax.errors import InputError, check_choice, check_seed
from gmmjax.tuning.parameter_names import VERDICT, ParameterName, Tunable

# What is tuned where the verdict does not decide.
DEFAULT: tuple[ParameterName, ...] = ("noise_floor", "tolerance")
LossChoice = Literal["auto", "f1", "brier", "log", "likelihood"]


@dataclasses.dataclass(frozen=True)
class TuningSettings:
    """Settings of the tuning.

    Attributes:
        parameters: what is tuned: "verdict", by which a difference between scans is a change, alone; or settings of the
            mixture: noise_floor, tolerance, concentration, noise_share, covariance_scale, degrees_of_freedom. None: the
            verdict on labelled scans of surfaces, else noise_floor and tolerance.
        loss: of the mixture's settings: "f1" (1 less the expected F1 of the points), "brier" or "log" score of their
            probabilities, all against truth; "likelihood" of held-out points, without. "auto": "f1" where all pairs
            have truth, else "likelihood".
        steps: of the mixture's optimiser at the most.
        learning_rate: of Adam, where no other optimiser is given: about the factor, less 1, by which a setting changes
            in a step.
        pairs_per_step: drawn at random for each step; all, where there are no more.
        starts: the first from the config's settings (or those derived from the data), the others up to a factor of 5
            beside them; after a few steps the best alone goes on.
        validation_share: of the pairs, which are held back: not trained on.
        patience: steps without a lower loss of the pairs held back after which it ends.
        max_points: that each fit sees, and that are judged of each cloud.
        seed: of all that is random.
        draws: towards the verdict as it was, as if it had judged so many candidates like those that it was learned
            from; the one is chosen by which pairs that were held back are judged best. Infinite: it stays. Near 0: what
            a few candidates have in common by chance is learned, and what was known is forgotten.
        folds: of the pairs, each held back once for the verdict; as many as pairs, where these are fewer.
        min_corrected: candidates of the pairs held back, at least, that a tuned verdict must judge rightly more than
            the one before. Chosen: five of five for the better are chance once in 32. 1: one lucky candidate of a
            sensor that is known already replaces a verdict from many hundred scenes.
        clear_errors: standard errors over the pairs, by which that number must exceed 0. 0: one odd pair may decide.
    """

    parameters: tuple[Tunable, ...] | None = None
    loss: LossChoice = "auto"
    steps: int = 40
    learning_rate: float = 0.2
    pairs_per_step: int = 4
    starts: int = 3
    validation_share: float = 0.4
    patience: int = 12
    max_points: int = 4096
    seed: int = 0
    draws: tuple[float, ...] = (1000.0, 300.0, 100.0, 30.0, 10.0)
    folds: int = 10
    min_corrected: int = 5
    clear_errors: float = 2.0

    def __post_init__(self) -> None:
        """Checks every setting.

        Raises:
            InputError: a setting out of its range, by name.
        """
        check_choice("loss", self.loss, get_args(LossChoice))
        least = {"steps": 1, "pairs_per_step": 1, "starts": 1, "patience": 1, "max_points": 100, "seed": 0, "folds": 2}
        least |= {"min_corrected": 1}
        for name, lowest in least.items():
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < lowest:
                raise InputError(f"{name}={value!r} must be a whole number of at least {lowest}")
        check_seed("seed", self.seed)
        if not (isinstance(self.learning_rate, int | float) and 0 < self.learning_rate < float("inf")):
            raise InputError(f"learning_rate={self.learning_rate!r} must be a positive number")
        if not (isinstance(self.validation_share, int | float) and 0 < self.validation_share < 1):
            raise InputError(f"validation_share={self.validation_share!r} must lie between 0 and 1")
        if not (isinstance(self.clear_errors, int | float) and 0 <= self.clear_errors < float("inf")):
            raise InputError(f"clear_errors={self.clear_errors!r} must be a number of at least 0")
        if not self.draws or not all(isinstance(draw, int | float) and draw > 0 for draw in self.draws):
            raise InputError(f"draws={self.draws!r} must be positive numbers, at least one")

    @property
    def of_mixture(self) -> tuple[ParameterName, ...]:
        """The mixture's settings that are tuned."""
        return DEFAULT if self.parameters is None else tuple(name for name in self.parameters if name != VERDICT)
