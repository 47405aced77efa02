"""The peers at their best: for each kind of scene the setting, of a coarse series, that suits it best."""

import dataclasses
from collections.abc import Sequence

from gmmjax.changes import DetectionConfig, JointDetector
from gmmjax.evaluation import LabelledPair, PairSource, Scores
from tests.benchmarks.best_peers import peer_scores, registered
from tests.benchmarks.held_out.kinds import CHANGED
from tests.benchmarks.held_out.table import Line


def best_peers(sources: Sequence[PairSource]) -> tuple[list[Line], list[str]]:
    """Each peer, with our evidence and without it, at the setting that is best on these very pairs.

    The clouds are registered as ours are, so that what is compared is how changes are found.

    Args:
        sources: pairs of one group.

    Returns:
        A line for each peer, and what failed: those pairs are left out.
    """
    lines: dict[tuple[str, str], Line] = {}
    failures = []
    for source in sources:
        try:
            scored = _scored(source.load())
        # Whatever is wrong with this pair, there are the others.
        except Exception as error:
            failures.append(f"{source.label}, peers: {type(error).__name__}: {error}")
            continue
        for name, text, scores in scored:
            line = lines.get((name, text)) or Line(source.group, f"{name}: {text}", Scores(), Scores())
            field = "changed" if source.condition == CHANGED else "unchanged"
            lines[name, text] = dataclasses.replace(line, **{field: getattr(line, field) + scores})
    names = dict.fromkeys(name for name, _ in lines)
    of_name = ([line for (own, _), line in lines.items() if own == name] for name in names)
    return [max(own, key=lambda line: line.goodness) for own in of_name], failures


def _scored(pair: LabelledPair) -> list[tuple[str, str, Scores]]:
    """The scores of all settings, without evidence and with it."""
    scans = registered(pair)
    evident = JointDetector(DetectionConfig(registration="never")).evidence_on(scans)
    return list(peer_scores(pair, scans, {"evidence": evident}))
