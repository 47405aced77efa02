"""The verdict on scans, tuned on a few pairs whose changes are known, or of places where nothing changed."""

import dataclasses
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int

from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.changes import DetectionConfig, Scan, Verdict, Verdicts, read_verdicts, shipped_verdicts, write_verdicts
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.errors import InputError, warn
from gmmjax.evaluation import Scores
from gmmjax.learning import CHANGED, CandidateRows, PointTruth, rows_of_scans
from gmmjax.pair import Pair, each
from gmmjax.tuning.detection_scores import detection_scores, gained
from gmmjax.tuning.scan_pairs import ScanPair, point_count
from gmmjax.tuning.settings import TuningSettings
from gmmjax.tuning.verdict_fit import WeightedRows, padded_rows, tuned_verdict


class VerdictState(NamedTuple):
    """State of the verdict's tuning.

    Attributes:
        measured: of each pair that is done the candidates: those whose other survey has no views, and those whose other
            survey has.
    """

    measured: tuple[Pair[CandidateRows], ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class VerdictCourse:
    """Course of the tuning of one verdict: that without poses, or that with them.

    Attributes:
        candidates: number of candidates of all pairs.
        changes: number of those that are changes.
        draws: towards the start that were tried, the strongest first; with an infinite one it stays as it was.
        losses: for each draw the log score of the probability of a change, mean over the candidates, each judged by
            what was tuned on other pairs; nats. NaN without candidates.
        false_alarms: for each draw the number of candidates that are no change and were taken for one.
        wrong: for each draw the number of candidates that were judged wrongly: false alarms and missed changes.
        tried: the draw with which the pairs held back are judged best.
        clear: whether it corrects clearly more candidates of the pairs held back than it spoils.
        start: the verdict as it was given.
        tuned: with the chosen draw, from all pairs.
        held_back: for each fold of the pairs, with the chosen draw, from all other folds.
    """

    candidates: int
    changes: int
    draws: tuple[float, ...]
    losses: tuple[float, ...]
    false_alarms: tuple[int, ...]
    wrong: tuple[int, ...]
    tried: float
    clear: bool
    start: Verdict
    tuned: Verdict
    held_back: tuple[Verdict, ...]

    @property
    def draw(self) -> float:
        """The chosen draw: that which was tried where its gain is clear, else an infinite one."""
        return self.tried if self.clear else np.inf

    @property
    def chosen(self) -> int:
        """The place of the chosen draw."""
        return self.draws.index(self.draw)

    def moved_weights(self) -> list[tuple[str, float, float]]:
        """Name of each fact with its mean slope for a change before and after tuning, largest difference first."""
        before, after = (np.reshape(own.weights[0], (2, -1)).mean(axis=0) for own in (self.start, self.tuned))
        order = np.argsort(-np.abs(after - before), kind="stable")
        return [(self.start.names[place], float(before[place]), float(after[place])) for place in order]

    def to_dict(self) -> dict[str, Any]:
        """As plain values; None in place of what is not finite."""
        return {
            "candidates": self.candidates,
            "changes": self.changes,
            "draw": _plain(self.draw),
            "tried": _plain(self.tried),
            "clear": self.clear,
            "draws": [_plain(draw) for draw in self.draws],
            "losses": [_plain(loss) for loss in self.losses],
            "false_alarms": list(self.false_alarms),
            "wrong": list(self.wrong),
            "weights": {name: {"before": before, "after": after} for name, before, after in self.moved_weights()},
        }


@dataclasses.dataclass(frozen=True, eq=False)
class VerdictResult:
    """Result of tuning the verdict.

    Attributes:
        config: as it was given. To use the tuned verdicts, `write_verdicts` and name their file in `verdict`.
        improved: whether the verdicts were tuned, and are better.
        verdicts: the tuned ones; those that were given where they are no better.
        poses_unknown: how the verdict on places without the other survey's views was tuned.
        poses_given: how that with them was.
        pairs: names of the pairs; each was held back once.
        before: scores of `detect_changes` over all pairs, with the verdicts as they were given; None where no other
            ones were chosen.
        after: the same, each pair by verdicts that were tuned without it.
        state: the candidates of all pairs.
    """

    config: DetectionConfig
    improved: bool
    verdicts: Verdicts
    poses_unknown: VerdictCourse
    poses_given: VerdictCourse
    pairs: tuple[str, ...]
    before: Scores | None
    after: Scores | None
    state: VerdictState

    @property
    def courses(self) -> dict[str, VerdictCourse]:
        """Both courses, by the names of the verdicts, those that have candidates."""
        both = {"poses_unknown": self.poses_unknown, "poses_given": self.poses_given}
        return {name: course for name, course in both.items() if course.candidates}

    @property
    def made(self) -> dict[str, Any]:
        """Provenance of the verdicts, for their file."""
        draws = {name: _plain(course.draw) for name, course in self.courses.items()}
        return {"tuned_from": self.config.verdict or "shipped", "pairs": list(self.pairs), "draws": draws}

    def to_dict(self) -> dict[str, Any]:
        """The result as plain values; None in place of what is not finite."""
        return {
            "improved": self.improved,
            "config": self.config.to_dict(),
            "parameters": ["verdict"],
            "pairs": list(self.pairs),
            "detection_before": _plain_scores(self.before),
            "detection_after": _plain_scores(self.after),
            **{name: course.to_dict() for name, course in self.courses.items()},
        }


def tune_verdict(
    pairs: Sequence[ScanPair],
    *,
    config: DetectionConfig = DetectionConfig(),
    settings: TuningSettings = TuningSettings(),
    resume: VerdictState | None = None,
    checkpoint: Callable[[VerdictState], None] = lambda state: None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> VerdictResult:
    """Tunes the parameters by which a difference between two scans is a change.

    The candidates of every pair are measured once. The parameters maximise their log likelihood, drawn towards the
    config's (or the shipped ones). How strongly is chosen by pairs that are held back, each once: it is the strongest
    draw with which the log score of their candidates is within one standard error of the least, and where nothing
    changed in any pair, the strongest with which the fewest candidates are taken for changes. The tuned verdict is kept
    only if it corrects clearly more candidates of the pairs held back than it spoils, and if `detect_changes` finds
    more in them: neither segment nor point F1 less, one of them more; where nothing changed, fewer false segments.

    Args:
        pairs: of scans with truth; of `unchanged_pair` where nothing changed. With views the verdict with poses is
            tuned, without them that without.
        config: all settings of the detection.
        settings: which draws are tried, and how pairs are held back.
        resume: of an earlier call with the same pairs and settings that was interrupted.
        checkpoint: called with the state after every pair.
        progress: called with what is being done and the share of the work that is done.

    Returns:
        The tuned verdicts and how they were found.

    Raises:
        InputError: pairs without truth, or that cannot be compared, named; a file of verdicts that cannot be used; a
            config whose changes the verdict does not decide.

    Warns:
        InputWarning: a single pair, which none can be held back of.
    """
    _check(pairs, config)
    given = shipped_verdicts() if config.verdict is None else read_verdicts(config.verdict)
    state = _measured(pairs, config, resume or VerdictState(), checkpoint, progress)
    folds = _folds(len(pairs), settings)
    progress("Tuning the verdict", 0.6)
    starts = Pair(given.poses_unknown, given.poses_given)
    rows = Pair([own.before for own in state.measured], [own.after for own in state.measured])
    courses = each(lambda start, own: _course(start, own, folds, config.threshold, settings), starts, rows)
    names = tuple(pair.name for pair in pairs)
    result = VerdictResult(config, False, given, courses.before, courses.after, names, None, None, state)
    if not all(np.isinf(course.draw) for course in courses):
        result = _judged_by_detection(result, pairs, folds, lambda stage, share: progress(stage, 0.65 + 0.35 * share))
    progress("Done", 1.0)
    return result


def _check(pairs: Sequence[ScanPair], config: DetectionConfig) -> None:
    if config.method != "joint" or not config.evidence:
        raise InputError(
            "parameters: the verdict decides only with method='joint' and evidence=True; set these, or tune other "
            "parameters"
        )
    if without := [pair.name for pair in pairs if not pair.labelled]:
        raise InputError(
            f"pairs {', '.join(without)}: have no truth, which tuning the verdict needs; give it, or, where nothing "
            "changed, say so: unchanged_pair in Python, --unchanged on the command line"
        )


def _measured(
    pairs: Sequence[ScanPair],
    config: DetectionConfig,
    state: VerdictState,
    checkpoint: Callable[[VerdictState], None],
    progress: Callable[[str, float], None],
) -> VerdictState:
    """The candidates of all pairs."""
    for number in range(len(state.measured), len(pairs)):
        pair = pairs[number]
        progress(f"Looking for candidates: {pair.name}", 0.6 * number / len(pairs))
        try:
            rows = rows_of_scans(_scans(pair), _truths(pair), config)
        except InputError as error:
            raise InputError(f"{pair.name}: {error}") from error
        state = VerdictState((*state.measured, rows))
        checkpoint(state)
    return state


def _scans(pair: ScanPair) -> Pair[Scan]:
    """Both clouds, with their own views where no others are given."""

    def scan(cloud: ArrayLike | PointCloud, views: SensorViews | None) -> Scan:
        return Scan(cloud, cloud.views if views is None and isinstance(cloud, PointCloud) else views)

    return each(scan, Pair(pair.before, pair.after), Pair(pair.views_before, pair.views_after))


def _truths(pair: ScanPair) -> Pair[PointTruth]:
    """Truth of the points. Places that the other survey could not observe are judged too: the verdict can say so."""

    def of_cloud(
        name: str, cloud: Any, truth: np.ndarray | None, ignored: np.ndarray | None, unseen: np.ndarray | None
    ) -> PointTruth:
        truth = np.asarray(truth)
        if truth.shape != (count := point_count(cloud),) or truth.dtype.kind not in "iu":
            raise InputError(
                f"truth_{name} must hold whole numbers (-1, or the id of a change) for each of the {count} points"
            )
        judged = truth >= -1
        if ignored is not None:
            judged &= ~ignored if unseen is None else ~ignored | unseen
        return PointTruth(judged, truth >= 0, unseen)

    return each(
        of_cloud,
        Pair("before", "after"),
        Pair(pair.before, pair.after),
        Pair(pair.truth_before, pair.truth_after),
        Pair(pair.ignored_before, pair.ignored_after),
        Pair(pair.unseen_before, pair.unseen_after),
    )


def _folds(pairs: int, settings: TuningSettings) -> Int[np.ndarray, " n"]:
    """The fold of each pair: one pair each, where they are few."""
    if pairs == 1:
        warn("1 pair is too few to hold one back: the tuned verdict is judged by the pair that it was tuned on")
    order = np.random.default_rng(settings.seed).permutation(pairs)
    return order % min(pairs, settings.folds)


def _course(
    start: Verdict,
    measured: list[CandidateRows],
    folds: Int[np.ndarray, " n"],
    threshold: float,
    settings: TuningSettings,
) -> VerdictCourse:
    """One verdict, tuned with the draw that is best for the pairs held back."""
    draws = (np.inf, *sorted(set(settings.draws), reverse=True))
    of_pair = np.repeat(np.arange(len(measured)), [len(own.kind) for own in measured])
    rows = _weighted(start, measured)
    count = len(rows.kind)
    if not count:
        same = (start,) * (int(folds.max()) + 1)
        losses, none = (np.nan,) * len(draws), (0,) * len(draws)
        return VerdictCourse(0, 0, draws, losses, none, none, np.inf, False, start, start, same)
    fold_of = folds[of_pair]
    alone = folds.max() == 0
    held_back = [
        tuple(
            tuned_verdict(start, rows if alone else rows.without(fold_of == fold), draw)
            for fold in range(int(folds.max()) + 1)
        )
        for draw in draws
    ]
    probability = np.array([_by_folds(own, rows.facts, fold_of) for own in held_back])
    changed = rows.kind == CHANGED
    log_score = -np.log(np.clip(np.where(changed, probability, 1 - probability), 1e-12, None))
    wrong = (probability >= threshold) != changed
    false_alarms = (wrong & ~changed).sum(axis=1)
    tried = _best(log_score * rows.weight, of_pair) if changed.any() else int(false_alarms.argmin())
    clear = _clearly_corrected(wrong[0].astype(int) - wrong[tried], of_pair, settings)
    chosen = tried if clear else 0
    return VerdictCourse(
        candidates=count,
        changes=int(changed.sum()),
        draws=draws,
        losses=tuple((log_score @ rows.weight / rows.weight.sum()).tolist()),
        false_alarms=tuple(false_alarms.tolist()),
        wrong=tuple(wrong.sum(axis=1).tolist()),
        tried=draws[tried],
        clear=clear,
        start=start,
        tuned=tuned_verdict(start, rows, draws[chosen]),
        held_back=held_back[chosen],
    )


def _weighted(start: Verdict, measured: list[CandidateRows]) -> WeightedRows:
    """All candidates; those of a pair together weigh the root of their number, for they share its registration."""
    weight = np.concatenate([np.full(len(own.kind), max(len(own.kind), 1) ** -0.5) for own in measured])
    return WeightedRows(
        np.concatenate([own.scaled(start.names) for own in measured]),
        np.concatenate([own.kind for own in measured]),
        weight / weight.mean() if len(weight) else weight,
    )


def _by_folds(
    verdicts: tuple[Verdict, ...], facts: Float[np.ndarray, "n f"], fold_of: Int[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """The probability of a change of each candidate, by the verdict that was tuned without its fold."""
    padded = padded_rows(facts)
    with jax.enable_x64(True):
        every = [np.asarray(_changed(verdict, jnp.asarray(padded)))[: len(facts)] for verdict in verdicts]
    return np.choose(fold_of, every)


@lru_jit
def _changed(verdict: Verdict, facts: Float[Array, "n f"]) -> Float[Array, " n"]:
    return jax.vmap(verdict.probabilities)(facts)[:, 0]


def _best(losses: Float[np.ndarray, "d n"], of_pair: Int[np.ndarray, " n"]) -> int:
    """The strongest draw that is within one standard error of the one with the least loss."""
    best = int(losses.sum(axis=1).argmin())
    return next(
        place
        for place, own in enumerate(losses)
        if place == best or (own - losses[best]).sum() <= _standard_error(own - losses[best], of_pair)
    )


def _clearly_corrected(gains: Int[np.ndarray, " n"], of_pair: Int[np.ndarray, " n"], settings: TuningSettings) -> bool:
    """True if more candidates are classified correctly than before, by more than chance.

    A log score does not tell: it falls where a verdict that is right already becomes surer, which needs no tuning.

    Args:
        gains: of each candidate: 1 where it was corrected, -1 where it was spoilt, else 0.
        of_pair: the pair of each: what is wrong in one pair often has one cause.
        settings: what is clear.
    """
    clear = settings.clear_errors * _standard_error(gains, of_pair)
    return bool(gains.sum() >= settings.min_corrected and gains.sum() > clear)


def _standard_error(gains: Float[np.ndarray, " n"] | Int[np.ndarray, " n"], of_pair: Int[np.ndarray, " n"]) -> float:
    """That of the sum of the candidates' gains, from their differences between pairs; 0 for a single pair."""
    of_pairs = np.bincount(of_pair, gains)[np.unique(of_pair)]
    return float(np.sqrt(len(of_pairs)) * of_pairs.std(ddof=1)) if len(of_pairs) > 1 else 0.0


def _judged_by_detection(
    result: VerdictResult,
    pairs: Sequence[ScanPair],
    folds: Int[np.ndarray, " n"],
    progress: Callable[[str, float], None],
) -> VerdictResult:
    """The result with what `detect_changes` finds, each pair by the verdicts that were tuned without it."""
    unknown, given = result.poses_unknown, result.poses_given
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{fold}.json" for fold in range(int(folds.max()) + 1)]
        for file, *own in zip(files, unknown.held_back, given.held_back, strict=True):
            write_verdicts(file, Verdicts(*own), result.made)
        before = detection_scores(pairs, [result.config] * len(pairs), lambda stage, share: progress(stage, share / 2))
        tuned = [dataclasses.replace(result.config, verdict=str(files[fold])) for fold in folds]
        after = detection_scores(pairs, tuned, lambda stage, share: progress(stage, 0.5 + share / 2))
    no_less, more = gained(before, after)
    improved = no_less and more
    verdicts = Verdicts(unknown.tuned, given.tuned) if improved else result.verdicts
    return dataclasses.replace(result, improved=improved, verdicts=verdicts, before=before, after=after)


def _plain(number: float) -> float | None:
    return float(number) if np.isfinite(number) else None


def _plain_scores(scores: Scores | None) -> dict[str, float] | None:
    if scores is None:
        return None
    return {"f1": scores.f1, "point_f1": scores.point_f1, "false_segments": scores.false_segments}
