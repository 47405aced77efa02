"""The record beside the result of a pair: of what it was made, and its rows of the summary."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gmmjax import __version__
from gmmjax.batch.fingerprint import Fingerprint
from gmmjax.batch.rows import ChangeRow, PairRow
from gmmjax.changes import DetectionConfig
from gmmjax.clouds import atomic_write, read_json_record
from gmmjax.errors import InputError, one_line

PAIR_SCHEMA = 1
PAIR_FILE = "pair.json"
REMEDY = "start the run again, which computes the pair anew"


def chosen_settings(config: DetectionConfig) -> dict[str, Any]:
    """The settings of a config that are not the default, as JSON has them; without the restarts."""
    default = DetectionConfig().to_dict()
    chosen = {name: own for name, own in config.to_dict().items() if own != default.get(name) and name != "restarts"}
    plain: dict[str, Any] = json.loads(json.dumps(chosen))
    return plain


@dataclasses.dataclass(frozen=True)
class Request:
    """A request for the result of a pair, apart from its scans.

    Attributes:
        settings: of the detection, by name, those that are not the default; without the restarts.
        restarts: that were asked for, at the most with `until_stable`; None: the default.
        until_stable: difference of probabilities below which no more restarts are made; None: all are made.
        files: how the result is written, the name of a function.
    """

    settings: Mapping[str, Any]
    restarts: int | None
    until_stable: float | None
    files: str

    @classmethod
    def of(cls, config: DetectionConfig, until_stable: float | None, files: str) -> "Request":
        """The request by a config. A verdict's file is known by its content, among the inputs."""
        settings = chosen_settings(config)
        settings.pop("verdict", None)
        return cls(settings, config.restarts, until_stable, files)


@dataclasses.dataclass(frozen=True)
class PairRecord:
    """A pair that is done.

    Attributes:
        request: what was asked for.
        inputs: of what it was made, by what each is to the pair: "before", "views_after", "verdict", ...
        files: what was written, by name.
        pair: its row of the summary.
        changes: the rows of its changes.
        seconds: of reading, detecting and writing, and of the stages of the detection.
        finished: when it was done, seconds since 1970.
        version: of gmmjax.
    """

    request: Request
    inputs: Mapping[str, Fingerprint]
    files: Mapping[str, Fingerprint]
    pair: PairRow
    changes: tuple[ChangeRow, ...]
    seconds: Mapping[str, float]
    finished: float
    version: str = __version__

    def is_of(self, inputs: Mapping[str, Path | Fingerprint]) -> bool:
        """True where it was made of these inputs, by this version.

        Args:
            inputs: files, or the fingerprints of what is in memory, by what each is to the pair.
        """
        return (
            self.version == __version__
            and self.inputs.keys() == inputs.keys()
            and all(
                known.matches(given) if isinstance(given := inputs[role], Path) else known.sha256 == given.sha256
                for role, known in self.inputs.items()
            )
        )

    def is_whole(self, folder: Path) -> bool:
        """True where all that was written is there as it was written."""
        return all(known.matches(folder / name) for name, known in self.files.items())

    def write(self, path: Path) -> None:
        """Writes it as JSON.

        Raises:
            InputError, OSError: the file cannot be written.
        """
        content = {"schema_version": PAIR_SCHEMA, "name": self.pair.name, **dataclasses.asdict(self)}
        with atomic_write(path) as file:
            file.write(json.dumps(content, indent=1, allow_nan=False).encode())

    @classmethod
    def read(cls, path: Path) -> "PairRecord":
        """Reads what `write` wrote.

        Raises:
            InputError: the file is missing or damaged, or of another schema version.
        """
        content = read_json_record(path, PAIR_SCHEMA, REMEDY)
        try:
            return cls(
                Request(**content["request"]),
                {role: Fingerprint(**own) for role, own in content["inputs"].items()},
                {name: Fingerprint(**own) for name, own in content["files"].items()},
                PairRow(**content["pair"]),
                tuple(ChangeRow(**row) for row in content["changes"]),
                {stage: float(seconds) for stage, seconds in content["seconds"].items()},
                float(content["finished"]),
                str(content["version"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"{path}: is not the whole record of a pair ({type(error).__name__}: {one_line(error)}); {REMEDY}"
            ) from error
