"""Scores of `detect_changes` with tuned settings, which decide whether they are kept."""

from collections.abc import Callable, Sequence

from gmmjax.changes import DetectionConfig, detect_changes
from gmmjax.evaluation import Scores, score_pair
from gmmjax.tuning.scan_pairs import ScanPair

# A difference of segment or point F1 on the pairs that says nothing.
NEGLIGIBLE = 0.002


def detection_scores(
    pairs: Sequence[ScanPair], configs: Sequence[DetectionConfig], progress: Callable[[str, float], None]
) -> Scores:
    """The scores of `detect_changes` over some labelled pairs.

    Args:
        pairs: with truth.
        configs: one for each pair.
        progress: called with what is being done and the share of the pairs that is done.
    """
    total = Scores()
    for number, (pair, config) in enumerate(zip(pairs, configs, strict=True)):
        progress(f"Detecting: {pair.name}", number / len(pairs))
        changes = detect_changes(
            pair.before, pair.after, config=config, views_before=pair.views_before, views_after=pair.views_after
        )
        assert pair.truth_before is not None and pair.truth_after is not None
        total += score_pair(changes.labels_before, changes.labels_after, pair.truth_before, pair.truth_after)
    return total


def gained(before: Scores, after: Scores) -> tuple[bool, bool]:
    """True if the tuned settings find more, and nowhere less.

    What counts are segment and point F1; where nothing changed in any pair, the number of false segments.

    Args:
        before: of the settings as they were given.
        after: of the tuned settings.
    """
    if not before.changes:
        fewer = before.false_segments - after.false_segments
        return fewer >= 0, fewer > 0
    gains = after.f1 - before.f1, after.point_f1 - before.point_f1
    return min(gains) >= -NEGLIGIBLE, max(gains) > NEGLIGIBLE
