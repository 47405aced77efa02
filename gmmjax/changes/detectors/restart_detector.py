"""The base of the detectors that average over random restarts: more restarts can be added to earlier ones."""

import abc
import dataclasses
import logging
from collections.abc import Callable
from typing import ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from gmmjax.changes.consensus import Consensus, Doubling, doublings, largest_difference
from gmmjax.changes.detectors.detector import AbstractChangeDetector, Scan
from gmmjax.changes.fit.restart_fits import Layout, RestartFits
from gmmjax.changes.progress import Clock, Progress, silent
from gmmjax.changes.record import Changes
from gmmjax.errors import ComputationError, InputError
from gmmjax.pair import Pair

logger = logging.getLogger(__name__)

Prepared = TypeVar("Prepared")


class Outcome(NamedTuple):
    """The record of a detection.

    Attributes:
        changes: the record.
        standard_errors: computes those of the changes; see `Consensus`.
    """

    changes: Changes
    standard_errors: Callable[[], tuple[float | None, ...]]


class _Averaged(NamedTuple):
    """A record, and the restarts that it is the average of.

    Attributes:
        outcome: the record.
        restarts: how many.
        computed: the fits of all restarts that were computed.
        settled: as of `Consensus`.
        convergence: as of `Consensus`.
    """

    outcome: Outcome
    restarts: int
    computed: RestartFits
    settled: bool | None = None
    convergence: tuple[Doubling, ...] = ()


@dataclasses.dataclass(frozen=True)
class AbstractRestartDetector(AbstractChangeDetector, Generic[Prepared]):
    """Three stages: what does not depend on the fits, the fits of random restarts, and what is found with them.

    Attributes:
        fits_begin: share of the work that is done before the fits.
        fits_end: share of the work that is done after them.
        layout: of the arrays of its fits.
    """

    layout: ClassVar[Layout]
    fits_begin: ClassVar[float]
    fits_end: ClassVar[float]

    @abc.abstractmethod
    def prepared(self, scans: Pair[Scan], clock: Clock) -> Prepared:
        """All that does not depend on the fits.

        Args:
            scans: at the earlier and at the later time, in one unit.
            clock: is told of the stages.
        """

    @abc.abstractmethod
    def restarts_of(self, prepared: Prepared) -> int:
        """The number of restarts that the config asks for."""

    @abc.abstractmethod
    def slots_of(self, prepared: Prepared) -> int:
        """The number of slots of the fitted mixtures."""

    @abc.abstractmethod
    def fitted(self, prepared: Prepared, restarts: range, report: Callable[[float], None]) -> dict[str, np.ndarray]:
        """The fits of some restarts.

        Args:
            prepared: both scans.
            restarts: the numbers of those that are computed; each is the same whatever the others.
            report: called with the share of them that is done, from any thread.

        Returns:
            The arrays of `RestartFits`.
        """

    @abc.abstractmethod
    def found(self, prepared: Prepared, fits: RestartFits, clock: Clock) -> Outcome:
        """Find what changed, by the fits.

        Args:
            prepared: both scans.
            fits: of the restarts that are averaged over.
            clock: is told of the stages.

        Raises:
            ComputationError: no fit can be used.
        """

    def changes(self, scans: Pair[Scan], report: Progress = silent) -> Changes:
        """The record of what changed; see `AbstractChangeDetector`."""
        clock = Clock(report)
        changes = self.changes_of(self.prepared(scans, clock), clock)
        clock.finish()
        return changes

    def changes_of(self, prepared: Prepared, clock: Clock) -> Changes:
        """The record of what changed between scans that are prepared.

        Args:
            prepared: both scans.
            clock: is told of the stages.
        """
        return self._averaged(prepared, self._no_fits, clock).outcome.changes

    def consensus(
        self,
        scans: Pair[Scan],
        *,
        earlier: RestartFits | None = None,
        until_stable: float | None = None,
        report: Progress = silent,
    ) -> Consensus:
        """The record with its restarts; see `detect_consensus`.

        Args:
            scans: at the earlier and at the later time, in one unit.
            earlier: fits of the first restarts, which are not computed again.
            until_stable: as of `detect_consensus`.
            report: called with the name of the stage and the share of the work that is done, from any thread.
        """
        clock = Clock(report)
        prepared = self.prepared(scans, clock)
        computed = self._no_fits if earlier is None else self._usable(earlier, prepared)
        if until_stable is None:
            averaged = self._averaged(prepared, computed, clock)
        else:
            averaged = self._settled(prepared, computed, until_stable, clock)
        changes, standard_errors = averaged.outcome
        errors = standard_errors()
        clock.finish()
        return Consensus(changes, averaged.restarts, averaged.computed, errors, averaged.settled, averaged.convergence)

    def _averaged(self, prepared: Prepared, computed: RestartFits, clock: Clock) -> _Averaged:
        """The record of all restarts."""
        restarts = self.restarts_of(prepared)
        computed = self._extended(prepared, computed, restarts, restarts, clock)
        return _Averaged(self.found(prepared, computed.first(restarts), clock), restarts, computed)

    def _settled(self, prepared: Prepared, computed: RestartFits, tolerance: float, clock: Clock) -> _Averaged:
        """The record of the first restarts with which it has settled, or of all."""
        most, latest, convergence = self.restarts_of(prepared), None, list[Doubling]()
        settled = False
        for restarts in doublings(most):
            computed = self._extended(prepared, computed, restarts, most, clock)
            earlier, latest = latest, self._found_by_few(prepared, computed.first(restarts), most, clock)
            if earlier is not None and latest is not None:
                convergence.append(Doubling(restarts, largest_difference(earlier.changes, latest.changes)))
                settled = convergence[-1].difference < tolerance
            if settled:
                break
        assert latest is not None
        # As of a plain detection with as many restarts.
        config = dataclasses.replace(self.config, restarts=restarts)
        latest = latest._replace(changes=dataclasses.replace(latest.changes, config=config))
        return _Averaged(latest, restarts, computed, settled, tuple(convergence))

    def _found_by_few(self, prepared: Prepared, fits: RestartFits, most: int, clock: Clock) -> Outcome | None:
        """The outcome; None where no fit can be used, and there will be more of them."""
        try:
            return self.found(prepared, fits, clock)
        except ComputationError:
            if len(fits) < most:
                return None
            raise

    def _extended(
        self, prepared: Prepared, computed: RestartFits, restarts: int, most: int, clock: Clock
    ) -> RestartFits:
        """The fits with those of as many restarts at least."""
        done, work = len(computed), self.fits_end - self.fits_begin
        shares = [self.fits_begin + work * fits / most for fits in (done, restarts)]
        if done < restarts:
            message, part = "Fitting the mixtures", shares[1] - shares[0]
            clock.start("fits", message, shares[0])
            more = range(done, restarts)
            logger.info("fitting restarts %d to %d of %d", done + 1, restarts, most)
            arrays = self.fitted(prepared, more, lambda share: clock.tell(message, shares[0] + part * share))
            computed = computed.followed_by(RestartFits(self.config.method, arrays))
        clock.most = 1.0 if restarts == most else shares[1]
        return computed

    @property
    def _no_fits(self) -> RestartFits:
        return RestartFits(self.config.method, {})

    def _usable(self, earlier: RestartFits, prepared: Prepared) -> RestartFits:
        """Earlier fits, if they are of this method and these settings, as far as can be told.

        Raises:
            InputError: they are not.
        """
        slots = self.slots_of(prepared)
        if len(earlier) and (earlier.method != self.config.method or set(earlier.arrays) != set(self.layout)):
            raise InputError(
                f"earlier: these are no fits of method {self.config.method} (they are marked as of {earlier.method}); "
                "detect without them"
            )
        if len(earlier) and earlier.slots != slots:
            raise InputError(
                f"earlier: the fits have mixtures of {earlier.slots} slots, not {slots}, so they are of other clouds "
                "or settings; detect without them"
            )
        return earlier
