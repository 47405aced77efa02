"""How many changes are found, by the kind of scene: `python -m tests.benchmarks.accuracy --log accuracy.jsonl`.

The scenes are held-out ones (`--kinds`), families of the training by a verdict that was learned on all others
(`python -m gmmjax.learning --rows rows --left-out LEFT_OUT`, then `--left-out LEFT_OUT`), or real pairs (`--pairs
FOLDER`). Each is compared with the sensors' poses and without. With `--peers` c2c, voxels and M3C2 run on the same
registered clouds at many settings, and the best one for the kind stands in the table: one that a user cannot know.

A row has segment F1 / point F1 over the scenes that changed, what was found and what is false; below it stands how far
the probabilities can be trusted.
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
COLUMNS = (
    *("scenes", "poses", "detector", "segment F1 / point F1", "found", "false in changed", "false in unchanged"),
    *("moved found, + false", "CPU seconds", "load"),
)
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
    arguments = parser.parse_args()
    log, lines = Log(arguments.log), []
    for scene, poses in itertools.product(scenes(arguments), arguments.poses):
        own = {"kind": scene.kind, "scene": scene.source.label, "poses": poses, "points": arguments.points}
        lines.append(log.measure({**own, "peers": False}, lambda s=scene, p=poses: detected(s, p)))
        if arguments.peers:
            lines.append(log.measure({**own, "peers": True}, lambda s=scene, p=poses: by_peers(s, p)))
    put(arguments.page, "accuracy", f"{accuracy_table(lines)}\n\n{calibration_table(lines)}")


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
    """A row for each kind, poses and detector, and one for all kinds together; of a peer its best setting."""
    rows, groups = [], _grouped(lines)
    totals: dict[tuple[str, str], Scores] = {}
    for (kind, poses), own in groups.items():
        spent = [line["cpu"] for line in own if line["cpu"] is not None]
        cells = [f"{np.median(spent):.1f}", f"{max(line['load'] for line in own):.1f}"]
        for name, scores in best(own).items():
            rows.append([kind, poses, name, *_cells(scores), *(cells if name == "gmmjax" else ["", cells[1]])])
            bare = name.split(":")[0]
            totals[poses, bare] = totals.get((poses, bare), Scores()) + scores
    if len({kind for kind, _ in groups}) > 1:
        rows += [["all", poses, name, *_cells(scores), "", ""] for (poses, name), scores in totals.items()]
    return table(COLUMNS, rows)


def best(lines: Iterable[Line]) -> dict[str, Scores]:
    """The scores of each detector, added; of its settings the one with the best segment F1, then point F1."""
    summed: dict[str, Scores] = {}
    for line in lines:
        for name, scores in line["scores"].items():
            summed[name] = summed.get(name, Scores()) + Scores(**scores)
    found: dict[str, str] = {}
    for name, scores in summed.items():
        bare = name.split(":")[0]
        known = summed.get(found.get(bare, ""), None)
        if known is None or (scores.f1, scores.point_f1) > (known.f1, known.point_f1):
            found[bare] = name
    return {name: summed[name] for name in found.values()}


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


def _grouped(lines: Sequence[Line]) -> dict[tuple[str, str], list[Line]]:
    groups: dict[tuple[str, str], list[Line]] = {}
    for line in lines:
        groups.setdefault((line["kind"], line["poses"]), []).append(line)
    return groups


def _cells(scores: Scores) -> list[str]:
    moved = f"{scores.moved_found}/{scores.moved}, +{scores.moved_false}" if scores.moved or scores.moved_false else ""
    return [
        f"{scores.f1:.2f} / {scores.point_f1:.2f}",
        f"{scores.found} of {scores.changes}",
        str(scores.false_segments - scores.false_in_unchanged),
        f"{scores.false_in_unchanged} in {scores.unchanged_pairs}",
        moved,
    ]


if __name__ == "__main__":
    main()
