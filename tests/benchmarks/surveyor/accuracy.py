"""How many changes are found in halls and on slopes, and how many that are none."""

import dataclasses
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Literal

from gmmjax import DetectionConfig
from gmmjax.evaluation import Scores
from gmmjax.pair import Pair
from gmmjax.reporting.explanations import displaced_text
from tests.benchmarks.surveyor.kinds import simulated
from tests.benchmarks.surveyor.peers import peer_labels
from tests.benchmarks.surveyor.scoring import mistakes, of_unjudged_changes, scores
from tests.benchmarks.surveyor.surveys import SurveyedPair

Views = Literal["given", "unknown"]
HEADINGS = (
    "scenes",
    "detector",
    "segment F1 / point F1",
    "segment precision, recall",
    "point precision, recall",
    "false in changed (of changes that are not judged)",
    "false in unchanged",
    "CPU seconds (median)",
)


@dataclasses.dataclass(frozen=True)
class Line:
    """What one detector found in the scenes of one kind.

    Attributes:
        kind: of the scenes.
        detector: its name, and whether it had the stations' poses.
        changed: scores over the scenes that changed.
        unchanged: over those that did not.
        seconds: CPU time of each detection.
        failed: why a detection gave no result, of each that did not.
        unjudged: false segments that are mostly of changes which are not judged.
    """

    kind: str
    detector: str
    changed: Scores = Scores()
    unchanged: Scores = Scores()
    seconds: tuple[float, ...] = ()
    failed: tuple[str, ...] = ()
    unjudged: int = 0

    def with_scores(self, own: Scores, unjudged: int, *, changed: bool, seconds: tuple[float, ...] = ()) -> "Line":
        """With the scores of one more pair, its false segments that are not judged, and the CPU time that it took."""
        field = "changed" if changed else "unchanged"
        scored: dict[str, Any] = {field: getattr(self, field) + own}
        return dataclasses.replace(self, **scored, seconds=(*self.seconds, *seconds), unjudged=self.unjudged + unjudged)

    @property
    def goodness(self) -> tuple[float, float]:
        """F1 of the segments of all scenes, and that of the points: by which a setting is the best."""
        both = self.changed + self.unchanged
        return both.f1, both.point_f1

    def cells(self) -> tuple[str, ...]:
        """One for each of `HEADINGS`."""
        own, still = self.changed, self.unchanged
        return (
            self.kind,
            self.detector + (f" ({len(self.failed)} failed)" if self.failed else ""),
            f"{own.f1:.3f} / {own.point_f1:.3f}",
            f"{own.precision:.3f}, {own.recall:.3f} of {own.changes}",
            f"{own.point_precision:.3f}, {own.point_recall:.3f}",
            f"{own.false_segments} of {own.segments} ({self.unjudged})",
            f"{still.false_in_unchanged} in {still.unchanged_pairs}",
            f"{sorted(self.seconds)[len(self.seconds) // 2]:.1f}" if self.seconds else "",
        )


@dataclasses.dataclass(frozen=True)
class Job:
    """The scenes of one kind, and what is asked of them.

    Attributes:
        kind: see `kinds`.
        seeds: a scene of either condition for each.
        points: about so many a side.
        views: whether the detection is given the stations' poses; each of these.
        ours: whether `detect_changes` is run.
        peers: whether the peers are.
        verdict: file that the detection is given; None: ours.
    """

    kind: str
    seeds: Sequence[int]
    points: int
    views: Sequence[Views]
    ours: bool = True
    peers: bool = False
    verdict: str | None = None


def accuracy(job: Job) -> list[Line]:
    """A line for each detector; of each peer that of its best setting. What each scene gave is told as it comes."""
    ours = {views: Line(job.kind, f"gmmjax, poses {views}") for views in (job.views if job.ours else ())}
    theirs: dict[tuple[str, str], Line] = {}
    for pair, changed in scenes(job):
        for views, line in ours.items():
            if views == "given" and pair.views.before is None:
                continue
            ours[views] = _detected(pair, line, views, changed, DetectionConfig(verdict=job.verdict))
        for setting, labels in peer_labels(job.kind, pair) if job.peers else ():
            line = theirs.get(setting) or Line(job.kind, f"{setting.name}: {setting.text}")
            unjudged = of_unjudged_changes(pair, labels)
            theirs[setting] = line.with_scores(scores(pair, labels), unjudged, changed=changed)
    return [*(line for line in ours.values() if line.seconds or line.failed), *_best(theirs)]


def scenes(job: Job) -> Iterator[tuple[SurveyedPair, bool]]:
    """Each seed's scene that changed, and its twin that did not."""
    for seed in job.seeds:
        for changed in (True, False):
            yield simulated(job.kind, seed, job.points, changed=changed), changed


def to_markdown(lines: Iterable[Line]) -> str:
    """The lines as a table, with what failed below it."""
    lines = list(lines)
    rows = [HEADINGS, ("---",) * len(HEADINGS), *(line.cells() for line in lines)]
    text = "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"
    return text + "".join(f"\n- failed: {failure}" for line in lines for failure in line.failed)


def _detected(pair: SurveyedPair, line: Line, views: Views, changed: bool, config: DetectionConfig) -> Line:
    from gmmjax import detect_changes

    known = pair.views if views == "given" else Pair(None, None)
    start = _cpu_seconds()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = detect_changes(*pair.points, config=config, views_before=known.before, views_after=known.after)
    # Whatever is wrong with this scene, there are the others.
    except Exception as error:
        failure = f"{pair.name}, {line.detector}: {type(error).__name__}: {error}"
        return dataclasses.replace(line, failed=(*line.failed, failure))
    seconds = _cpu_seconds() - start
    labels = Pair(found.labels_before, found.labels_after)
    own = scores(pair, labels)
    state = "changed" if changed else "unchanged"
    print(
        f"{pair.name} {state}, {line.detector}: {own.f1:.3f} / {own.point_f1:.3f}, "
        f"{own.found} of {own.changes} found, {own.false_segments} false, {seconds:.1f} s",
        *mistakes(pair, labels),
        *filter(None, [displaced_text(found)]),
        sep="\n  ",
        file=sys.stderr,
        flush=True,
    )
    return line.with_scores(own, of_unjudged_changes(pair, labels), changed=changed, seconds=(seconds,))


def _cpu_seconds() -> float:
    """Of this process and of those that it started and that ended."""
    return sum(os.times()[:4])


def _best(lines: dict[tuple[str, str], Line]) -> list[Line]:
    names = dict.fromkeys(name for name, _ in lines)
    return [
        max((line for (own, _), line in lines.items() if own == name), key=lambda line: line.goodness) for name in names
    ]
