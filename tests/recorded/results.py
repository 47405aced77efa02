"""Results as they are recorded: labels of all points, and the table of the changes.

    python -m tests.recorded.results            what differs from the recorded results, point by point
    python -m tests.recorded.results --write    records the results of this code

Run it on one machine before and after a change of the code that must not change an answer. Across machines a few labels
differ by rounding.
"""

import argparse
import hashlib
import json
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmmjax import Changes, InputWarning, detect_changes, read_cloud
from tests.recorded.scenes import SCENES, Recorded

FOLDER = Path(__file__).parent / "results"
LABELS_FILE, TABLE_FILE = FOLDER / "labels.npz", FOLDER / "changes.json"


class Result(NamedTuple):
    """The labels [n0] and [n1], the table of the changes, and what is warned of."""

    before: np.ndarray
    after: np.ndarray
    table: list[list[object]]
    warnings: list[str]


def detected(scene: Recorded) -> Result:
    """What is found in a scene."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        changes = detect_changes(scene.before, scene.after, **scene.arguments)
    return Result(
        changes.labels_before.astype(np.int16),
        changes.labels_after.astype(np.int16),
        _table(changes),
        [str(warning.message).split(" (")[0][:60] for warning in caught],
    )


def _table(changes: Changes) -> list[list[object]]:
    labels = np.concatenate([changes.labels_before, changes.labels_after])
    return [
        [
            change.kind,
            int((labels == number).sum()),
            round(change.probability, 3),
            *np.round(change.box.centre, 2).tolist(),
        ]
        for number, change in enumerate(changes.items)
    ]


def recorded(name: str) -> Result:
    """What was found once."""
    with np.load(LABELS_FILE) as labels:
        sides = [labels[f"{name}/{side}"] for side in ("before", "after")]
    content = recorded_table()[name]
    return Result(*sides, content["changes"], content["warnings"])


def recorded_table() -> dict[str, Any]:
    """The changes and warnings that were found once, by the name of what they were found in."""
    return dict(json.loads(TABLE_FILE.read_text()))


def real_pairs() -> dict[str, Path]:
    """The real pairs in the folder that `GMMJAX_DATA` names, if it does."""
    folder = Path(os.environ.get("GMMJAX_DATA", "")) / "pairs"
    usable = "GMMJAX_DATA" in os.environ and folder.is_dir()
    return {path.name: path for path in sorted(folder.iterdir())} if usable else {}


def of_real_pair(path: Path) -> Result:
    """What is found in a real pair without poses."""
    clouds = [read_cloud(next(path.glob(f"{side}.*"))) for side in ("before", "after")]
    return detected(Recorded(clouds[0].points, clouds[1].points, {}))


def digest(result: Result) -> str:
    """One word for the labels, which differs where one of them does."""
    return hashlib.blake2b(result.before.tobytes() + result.after.tobytes(), digest_size=12).hexdigest()


def results() -> Iterator[tuple[str, Result]]:
    """All that is recorded, one after the other."""
    for name, scene in SCENES.items():
        yield name, detected(scene())
    for name, path in real_pairs().items():
        yield f"real: {name}", of_real_pair(path)


def _write() -> None:
    labels, content = {}, {}
    for name, result in results():
        content[name] = {"changes": result.table, "warnings": result.warnings, "labels": digest(result)}
        # Of real scans no point is kept.
        if name in SCENES:
            labels |= {f"{name}/before": result.before, f"{name}/after": result.after}
        print(f"{name}: {len(result.table)} changes", flush=True)
    if not real_pairs():
        # What was recorded of them where they are stays.
        content |= {name: own for name, own in recorded_table().items() if name.startswith("real: ")}
    np.savez_compressed(LABELS_FILE, **labels)
    TABLE_FILE.write_text(json.dumps(content, indent=1) + "\n")


def _compare() -> int:
    content, differing = recorded_table(), 0
    for name, result in results():
        same = digest(result) == content[name]["labels"] and result.table == content[name]["changes"]
        differing += not same
        print(f"{name}: {'equal' if same else 'DIFFERS'}", flush=True)
        if not same:
            print(f"  was {content[name]['changes']}\n  is  {result.table}")
    print(f"{differing} differ")
    return int(differing > 0)


def main() -> int:
    """Writes or compares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="record the results of this code")
    if parser.parse_args().write:
        _write()
        return 0
    return _compare()


if __name__ == "__main__":
    raise SystemExit(main())
