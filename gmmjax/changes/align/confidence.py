"""The confidence in a registration."""

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
        contradiction: what contradicts a transform, as `SurfaceFit.contradiction` counts it, at which the odds are even
            between it and the given frame: midway between displaced rooms of which only the ends show it and reshaped
            ground (the scenes of tests/changes/align).
        contradiction_power: they grow with this power of it.
        unexplained: fraction of the points that do not agree by the transform below which less contradicts it.
        stated: prior odds against the given frame where both files state one reference system; else they are even.
        overlap: overlap at which the odds are even.
        overlap_power: they fall with this power of the overlap.
        agreement: of volumetric clouds: share of the mass whose components agree at which the odds are even.
        agreement_power: they fall with this power of that share.
        mixing: share of the points that the given frame mixes as two samples of one density at which the odds are
            even.
        mixing_power: they fall with this power of that share.
        negligible: odds below which a registration is not in doubt, so that it leaves the probabilities as they are.
    """

    residual: float = 0.01
    residual_power: float = 4.0
    rival_power: float = 12.0
    ambiguity_power: float = 60.0
    contradiction: float = 0.25
    contradiction_power: float = 5.0
    unexplained: float = 0.1
    stated: float = 0.01
    overlap: float = 0.17
    overlap_power: float = 4.0
    agreement: float = 0.3
    agreement_power: float = 8.0
    mixing: float = 0.6
    mixing_power: float = 12.0
    negligible: float = 0.01

    def doubt(self, fit: SurfaceFit, given: SurfaceFit) -> float:
        """The contradiction of a transform, as a multiple of what makes the odds even between it and the given frame.

        A transform by which nearly all agrees, such as that along a hall of which only the ends show it, is right
        although hardly less agrees in the given frame.

        Args:
            fit: how the clouds fit by the transform.
            given: how they fit in the given frame.
        """
        unexplained = min((1 - fit.agreement) / self.unexplained, 1.0)
        return unexplained * fit.contradiction(given) / self.contradiction

    def of_surfaces(
        self, fit: SurfaceFit, rival: float, near_given_frame: bool, doubt: float = 0.0, prior: float = 1.0
    ) -> float:
        """The probability that a transform is right.

        Args:
            fit: how the clouds fit by it.
            rival: ratio of the score of the next best, distinct transform to its own.
            near_given_frame: whether it is the frame that the clouds were given in, but for a fine correction.
            doubt: what speaks for another frame, as a multiple of what makes the odds even.
            prior: odds that another frame is right before how the clouds fit is looked at.
        """
        if not fit.overlap or not np.isfinite(fit.residual):
            return 0.0
        noises = max(fit.residual / max(fit.noise, np.finfo(np.float64).tiny), 1.0)
        odds = self.residual * min(noises, 1e3) ** self.residual_power * rival**self.rival_power
        odds = prior * (odds + min(doubt, 1e3) ** self.contradiction_power)
        odds += (self.overlap / fit.overlap) ** self.overlap_power
        odds += 0.0 if near_given_frame else rival**self.ambiguity_power
        return self._of_odds(odds)

    def of_agreement(self, share: float) -> float:
        """The probability that a displacement is right on which components with this share of the mass agree."""
        return 0.0 if share <= 0 else self._of_odds((self.agreement / share) ** self.agreement_power)

    def of_mixing(self, share: float) -> float:
        """The probability that the given frame is right, where nothing near it mixes the clouds better.

        Args:
            share: of the points, as `Mixing.share` measures it.
        """
        return 0.0 if share <= 0 else self._of_odds((self.mixing / share) ** self.mixing_power)

    def _of_odds(self, odds: float) -> float:
        return 1.0 if odds < self.negligible else float(1 / (1 + odds))
