"""How sure a registration is."""

from typing import NamedTuple

import numpy as np

from gmmjax.changes.align.surface_fit import SurfaceFit


class ConfidenceModel(NamedTuple):
    """The odds that a transform is wrong, as a sum of what speaks against it. Set by hand, not calibrated.

    Attributes:
        residual: odds at a residual of one noise, where another transform fits as well.
        residual_power: they grow with this power of the residual in noises,
        rival_power: and with this power of the ratio of the rival's score to its own.
        ambiguity_power: transforms away from the given frame: odds are this power of the ratio of the scores.
        overlap: overlap at which the odds are even.
        overlap_power: they fall with this power of the overlap.
        agreement: of volumetric clouds: share of the mass whose components agree at which the odds are even.
        agreement_power: they fall with this power of that share.
        negligible: odds below which a registration is not in doubt, so that it leaves the probabilities as they are.
    """

    residual: float = 0.01
    residual_power: float = 4.0
    rival_power: float = 12.0
    ambiguity_power: float = 60.0
    overlap: float = 0.17
    overlap_power: float = 4.0
    agreement: float = 0.3
    agreement_power: float = 8.0
    negligible: float = 0.01

    def of_surfaces(self, fit: SurfaceFit, rival: float, from_given_frame: bool) -> float:
        """The probability that a transform is right.

        Args:
            fit: how the clouds fit by it.
            rival: ratio of the score of the next best, distinct transform to its own.
            from_given_frame: whether it was found from the frame that the clouds were given in.
        """
        if not fit.overlap or not np.isfinite(fit.residual):
            return 0.0
        noises = max(fit.residual / max(fit.noise, np.finfo(np.float64).tiny), 1.0)
        odds = self.residual * min(noises, 1e3) ** self.residual_power * rival**self.rival_power
        odds += (self.overlap / fit.overlap) ** self.overlap_power
        odds += 0.0 if from_given_frame else rival**self.ambiguity_power
        return self._of_odds(odds)

    def of_agreement(self, share: float) -> float:
        """The probability that a displacement is right on which components with this share of the mass agree."""
        return 0.0 if share <= 0 else self._of_odds((self.agreement / share) ** self.agreement_power)

    def _of_odds(self, odds: float) -> float:
        return 1.0 if odds < self.negligible else float(1 / (1 + odds))
