"""How many changes are found, by the kind of scene: `python -m tests.benchmarks.accuracy --log accuracy.jsonl`.

The scenes are held-out ones (`--kinds`), families of the training by a verdict that was learned on all others
(`python -m gmmjax.learning --rows rows --left-out LEFT_OUT`, then `--left-out LEFT_OUT`), or real pairs (`--pairs
FOLDER`). Each is compared with the sensors' poses and without. With `--peers` c2c, voxels and M3C2 run on the same
registered clouds at many settings, and the best one for the kind stands in the table: one that a user cannot know.

A cell has segment F1 / point F1 over all scenes of the kind, and the false segments in those that did not change; below
the tables stands how far the probabilities can be trusted.
"""

import dataclasses
import itertools
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax import DetectionConfig
from gmmjax.errors import InputWarning
from gmmjax.evaluation import LabelledPair, PairSource, Reliability, Scores, detector, find_pairs, score_labelled_pair
from gmmjax.evaluation.scores import NEITHER, segment_truth
from gmmjax.learning import LEARNED_FROM, training_sources
from gmmjax.pair import Pair
from tests.benchmarks.best_peers import peer_labels
from tests.benchmarks.harness import Line, Log, cpu_seconds, options, put, table
from tests.benchmarks.held_out import KINDS, held_out_sources

POSES = ("unknown", "given")
COLUMNS = ("scenes", "gmmjax", "found", "false in changed", "moved found, + false", "CPU seconds")
# Seeds of a family are so far apart that the laboratory's survey and condition change from each to the next.
STEP = 5


@dataclasses.dataclass(frozen=True)
class Scene:
    """A scene with what judges it.

    Attributes:
        kind: what is summed up together.
        source: of the pair, with poses.
        verdict: file that the detection is given; None: the one of the package.
    """

    kind: str
    source: PairSource
    verdict: str | None = None


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=[], metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--left-out", type=Path, help="folder of FAMILY.json, each learned without that family")
    parser.add_argument("--families", nargs="+", choices=LEARNED_FROM, default=list(LEARNED_FROM), metavar="FAMILY")
    parser.add_argument("--pairs", type=Path, help="folder of labelled pairs")
    parser.add_argument("--seeds", type=int, default=4, help="changed scenes, and as many that are not")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--points", type=int, default=400_000, help="a side, of halls and slopes")
    parser.add_argument("--poses", nargs="+", choices=POSES, default=list(POSES))
    parser.add_argument("--peers", action="store_true", help="peers at their best, alone and with our evidence")
    parser.add_argument("--place", default="accuracy", help="name of the place in the page")
    arguments = parser.parse_args()
    log, lines = Log(arguments.log), []
    for scene, poses in itertools.product(scenes(arguments), arguments.poses):
        own = {"kind": scene.kind, "scene": scene.source.label, "poses": poses, "points": arguments.points}
        lines.append(log.measure({**own, "peers": False}, lambda s=scene, p=poses: detected(s, p)))
        if arguments.peers:
            lines.append(log.measure({**own, "peers": True}, lambda s=scene, p=poses: by_peers(s, p)))
    put(arguments.page, arguments.place, f"{accuracy_table(lines)}\n\n{calibration_table(lines)}")


def scenes(arguments: Any) -> Iterator[Scene]:
    """All that is asked for; nothing is simulated yet."""
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    for kind in arguments.kinds:
        sources = held_out_sources([kind], seeds, ["given"], arguments.points)
        yield from (Scene(kind, source) for source in sources)
    if arguments.left_out:
        for family in arguments.families:
            verdict = str(arguments.left_out / f"{family}.json")
            sources = training_sources(family, [STEP * seed for seed in seeds])
            yield from (Scene(family, source, verdict) for source in sources)
    if arguments.pairs:
        yield from (Scene(source.name, source) for source in find_pairs(arguments.pairs))


def loaded(scene: Scene, poses: str) -> LabelledPair:
    """The pair of a scene."""
    pair = scene.source.load()
    return pair if poses == "given" else pair.without_views()


def detected(scene: Scene, poses: str) -> dict[str, Any]:
    """The scores of our detection, and of each change its probability and whether it is one."""
    pair, began = loaded(scene, poses), cpu_seconds()
    with warnings.catch_warnings():
        # Registrations in doubt, and candidates unlike those of all other families.
        warnings.simplefilter("ignore", InputWarning)
        found = detector("joint", DetectionConfig(verdict=scene.verdict))(pair)
    spent = cpu_seconds() - began
    scores = score_labelled_pair(pair, found.labels_before, found.labels_after, found.moved)
    changes = []
    for cloud, labels in ((pair.before, found.labels_before), (pair.after, found.labels_after)):
        truths = segment_truth(labels, cloud)
        items = [(found.changes.items[segment], truth) for segment, truth in truths.items() if truth != NEITHER]
        changes += [[change.probability, bool(truth >= 0)] for change, truth in items]
    return {"cpu": spent, "changes": changes, "scores": {"gmmjax": dataclasses.asdict(scores)}}


def by_peers(scene: Scene, poses: str) -> dict[str, Any]:
    """The scores of every setting of every peer."""
    pair = loaded(scene, poses)
    config = DetectionConfig(verdict=scene.verdict, registration="never")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        found: dict[str, Pair[np.ndarray]] = dict(peer_labels(pair, config))
    scores = {name: dataclasses.asdict(score_labelled_pair(pair, *labels)) for name, labels in found.items()}
    return {"cpu": None, "changes": [], "scores": scores}


def accuracy_table(lines: Sequence[Line]) -> str:
    """A table for either knowledge of the poses: a row for each kind, and one for all; of a peer its best setting."""
    parts = []
    for poses in dict.fromkeys(line["poses"] for line in lines):
        groups: dict[str, list[Line]] = {}
        for line in lines:
            if line["poses"] == poses:
                groups.setdefault(line["kind"], []).append(line)
        found = {kind: best(own) for kind, own in groups.items()}
        peers = [name for name in next(iter(found.values())) if name != "gmmjax"]
        rows = [[kind, *_cells(own, groups[kind]), *(cell(own[name]) for name in peers)] for kind, own in found.items()]
        if len(found) > 1:
            total = {name: sum((own[name] for own in found.values()), Scores()) for name in ("gmmjax", *peers)}
            rows.append(
                ["all", *_cells(total, list(itertools.chain(*groups.values()))), *(cell(total[name]) for name in peers)]
            )
        parts.append(f"*Poses {poses}*\n\n{table((*COLUMNS, *peers), rows)}")
    return "\n\n".join(parts)


def best(lines: Iterable[Line]) -> dict[str, Scores]:
    """The scores of each detector, added; of its settings those with the best segment F1, then point F1."""
    summed: dict[str, Scores] = {}
    for line in lines:
        for name, scores in line["scores"].items():
            summed[name] = summed.get(name, Scores()) + Scores(**scores)
    found: dict[str, Scores] = {}
    for name, scores in summed.items():
        bare = name.split(":")[0]
        known = found.get(bare, scores)
        found[bare] = max(known, scores, key=lambda own: (own.f1, own.point_f1))
    return found


def cell(scores: Scores) -> str:
    """Segment F1 / point F1, and the false segments where nothing changed."""
    return f"{scores.f1:.2f} / {scores.point_f1:.2f}, {scores.false_in_unchanged}"


def calibration_table(lines: Sequence[Line]) -> str:
    """How often changes that are reported with a probability are true, over all kinds."""
    rows = []
    for poses in POSES:
        pairs = [change for line in lines if line["poses"] == poses for change in line["changes"]]
        if not pairs:
            continue
        probability, truth = np.array([own[0] for own in pairs]), np.array([own[1] for own in pairs])
        curve = Reliability.of(probability, truth)
        for part in curve.to_dict()["bins"]:
            said = f"{part['from']:.1f} to {part['to']:.1f}"
            rows.append([poses, said, part["count"], f"{part['mean_probability']:.3f}", f"{part['share_true']:.3f}"])
        rows.append([poses, "calibration error", len(pairs), f"{curve.calibration_error:.3f}", ""])
    return table(("poses", "probability", "changes", "mean", "true"), rows)


def _cells(found: dict[str, Scores], lines: Sequence[Line]) -> list[str]:
    own, spent = found["gmmjax"], [line["cpu"] for line in lines if line["cpu"] is not None]
    moved = f"{own.moved_found}/{own.moved}, +{own.moved_false}" if own.moved or own.moved_false else ""
    false = str(own.false_segments - own.false_in_unchanged)
    return [cell(own), f"{own.found} of {own.changes}", false, moved, f"{np.median(spent):.1f}"]


if __name__ == "__main__":
    main()
