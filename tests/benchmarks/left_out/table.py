"""The table of families that were left out: the verdict, what it is held against, and every peer at its best."""

from collections.abc import Iterator, Mapping, Sequence

from gmmjax.evaluation import Scores
from tests.benchmarks.left_out.jobs import LEARNED, OTHER, POSES, FamilyResult, OfPair

PEERS = ("c2c", "voxels", "m3c2")


def to_markdown(results: Sequence[FamilyResult]) -> str:
    """A table for each of poses unknown and given; where a peer is better, and at one setting; the peers' settings."""
    bests = {found.family: best(found.summed()) for found in results}
    parts = []
    for poses in POSES:
        names = [name for name in columns(poses) if all(name in own for own in bests.values())]
        headings = ["family", *(name.removesuffix(f", poses {poses}") for name in names)]
        lines = [f"*Poses {poses}*", "", _row(headings), _row(["---"] * len(headings))]
        for family, own in bests.items():
            lines.append(_row([family, *(cell(own[name][1]) for name in names)]))
        totals = [sum((own[name][1] for own in bests.values()), Scores()) for name in names]
        lines.append(_row(["all", *map(cell, totals)]))
        parts.append("\n".join(lines))
        parts.append("\n".join(_better(bests, poses)))
        parts.append("\n".join(_for_all(results, poses)))
    parts.append("\n".join(_settings(bests)))
    parts.append("\n".join(f"- failed: {failure}" for found in results for failure in found.failures))
    return "\n\n".join(part for part in parts if part) + "\n"


def columns(poses: str) -> list[str]:
    """The detectors that are compared, ours first."""
    peers = [name for peer in PEERS for name in (peer, f"{peer}+evidence, poses {poses}")]
    return [f"{LEARNED}, poses {poses}", f"{OTHER}, poses {poses}", *peers]


def best(scores: OfPair) -> dict[str, tuple[str, Scores]]:
    """Of each detector the setting with the best F1 of the segments, then of the points, then the fewest false ones."""
    return {name: _best_setting(settings) for name, settings in scores.items()}


def _best_setting(settings: Mapping[str, Scores]) -> tuple[str, Scores]:
    def goodness(setting: tuple[str, Scores]) -> tuple[float, float, int]:
        own = setting[1]
        return own.f1, own.point_f1, -own.false_segments

    return max(settings.items(), key=goodness)


def shown(scores: Scores) -> tuple[float, float]:
    """What detectors are compared by: segment F1, then point F1, as the table shows them."""
    return round(scores.f1, 2), round(scores.point_f1, 2)


def cell(scores: Scores) -> str:
    """Segment F1 / point F1 over all pairs, and the false segments in those in which nothing changed."""
    segments, points = shown(scores)
    return f"{segments:.2f} / {points:.2f}, {scores.false_in_unchanged}"


def _better(bests: dict[str, dict[str, tuple[str, Scores]]], poses: str) -> Iterator[str]:
    """A line for each peer that is better than the verdict on a family, with what the difference consists of."""
    for family, own in bests.items():
        ours = own[f"{LEARNED}, poses {poses}"][1]
        for name in columns(poses)[2:]:
            if name in own and shown(own[name][1]) > shown(ours):
                theirs = own[name][1]
                yield f"- {family}: {name.split(', ')[0]} {_counts(theirs)}; the verdict {_counts(ours)}"


def _for_all(results: Sequence[FamilyResult], poses: str) -> Iterator[str]:
    """A line for each peer: the one setting that is the best over all families, as a user has to choose it."""
    families = [found.summed() for found in results]
    for name in columns(poses)[2:]:
        if not all(name in own for own in families):
            continue
        total = {text: sum((own[name][text] for own in families), Scores()) for text in families[0][name]}
        text, scores = _best_setting(total)
        yield f"- {name.split(', ')[0]} at one setting for all families ({text}): {_counts(scores)}"


def _counts(scores: Scores) -> str:
    found = f"finds {scores.found} of {scores.changes}, {scores.false_segments} false"
    return f"{found} ({scores.f1:.2f} / {scores.point_f1:.2f})"


def _settings(bests: dict[str, dict[str, tuple[str, Scores]]]) -> Iterator[str]:
    """The setting of each peer that is the best for each family."""
    names = [name for poses in POSES for name in columns(poses)[2:]]
    run = [name for name in dict.fromkeys(names) if all(name in own for own in bests.values())]
    if not run:
        return
    yield "*Best settings of the peers*\n"
    yield _row(["family", *run])
    yield _row(["---"] * (len(run) + 1))
    for family, own in bests.items():
        yield _row([family, *(own[name][0] for name in run)])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
