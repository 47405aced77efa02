"""The answer in words and in rows, the same on the terminal and in the report."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gmmjax.changes import NAMES, Change, Changes, Kind, RejectedCandidate, object_motion
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair, each
from gmmjax.reporting.quantities import area_text, degrees_text, length_text, metric_text, percent, share, volume_text

HEADINGS = ("Label", "Kind", "Probability", "Points", "Centre", "Size", "Volume")


class ObjectRow(NamedTuple):
    """One object that changed, as text. Of a moved object all but the labels is about its place in the after scan.

    Attributes:
        labels: index of its change, or of both changes of a moved object, that in the before scan first; they are also
            the labels of its points in the files.
        kind: of change.
        label: the labels, "0" or "0, 3".
        text: the kind, of a moved object with its motion: "moved 0.10 m, turned 6°".
        probability, points, centre, size: with the unit in `headings`.
        volume: with a sign for what was gained or lost, unless the object moved; empty where it was not measured.
        area: likewise, without a sign.
    """

    labels: tuple[int, ...]
    kind: Kind
    label: str
    text: str
    probability: str
    points: str
    centre: str
    size: str
    volume: str
    area: str

    @property
    def cells(self) -> tuple[str, ...]:
        """One text for each of `HEADINGS`."""
        return self[2:-1]


def answer(changes: Changes) -> str:
    """Give the answer in a sentence: "2 changes: 1 appeared, 1 disappeared". A moved object counts once."""
    counts = changes.object_counts()
    total = sum(counts.values())
    if total == 0:
        return "No change found"
    parts = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    return f"{total} change{'s' * (total != 1)}: {parts}"


def headings(changes: Changes) -> tuple[str, ...]:
    """Return `HEADINGS`, those of coordinates with the unit, where it is known."""
    unit = f" ({changes.unit})" if changes.unit else ""
    return tuple(heading + unit * (heading in ("Centre", "Size")) for heading in HEADINGS)


def object_rows(changes: Changes) -> list[ObjectRow]:
    """List the objects that changed, in the order of their first change; coordinates all have as many decimals."""
    decimals = [_decimals(change.box.extent) for change in changes.items]
    # At least three digits of the largest object, and two of the smallest.
    digits = max(min(decimals), max(decimals) - 1) if decimals else 0
    return [_object_row(changes, labels, digits) for labels in object_labels(changes)]


def object_labels(changes: Changes) -> list[tuple[int, ...]]:
    """List the labels of each object: one, or both of a moved object, that in the before scan first."""
    found: list[tuple[int, ...]] = []
    for label, change in enumerate(changes.items):
        partner = change.partner
        if partner is None or changes[partner].partner != label:
            found.append((label,))
        elif label < partner:
            found.append((label, partner) if (changes.labels_before == label).any() else (partner, label))
    return found


def motion_text(changes: Changes, labels: tuple[int, int]) -> str:
    """Describe the motion of an object: "moved 0.10 m, turned 6°"; that it turned is left out where it did not."""
    distance, degrees = object_motion(changes, labels)
    turned = "" if degrees is None or degrees < 0.5 else f", turned {degrees:.0f}°"
    return f"moved {length_text(distance, changes.unit)}{turned}"


def dropped_rows(changes: Changes) -> dict[str, int]:
    """Count the rows of each cloud that had NaN or infinite coordinates, for the clouds that had any."""
    sides = {side: changes.diagnostics.get(side) for side in ("before", "after")}
    counts = {side: int(found.get("rows_dropped", 0)) for side, found in sides.items() if isinstance(found, dict)}
    return {side: count for side, count in counts.items() if count}


def dropped_text(side: str, count: int) -> str:
    """Say what `dropped_rows` counts."""
    rows, were = ("row", "was") if count == 1 else ("rows", "were")
    return f"{count:,} {rows} of the {side} cloud had no finite position and {were} left out."


def point_counts(changes: Changes, clouds: Pair[PointCloud]) -> Pair[int]:
    """Count the points that were compared: more than the clouds that are shown have, where these are thinned."""
    compared = NAMES.map(lambda side: int(changes.diagnostics.get(side, {}).get("points", 0)))
    return each(max, compared, clouds.map(len))


def unobserved_text(changes: Changes) -> str | None:
    """Say how much of each cloud the other survey did not see; None where it saw all or nothing is known."""
    shares = {"before": changes.unobserved_before.mean(), "after": changes.unobserved_after.mean()}
    parts = [f"{share(float(part))} of the {side} cloud" for side, part in shares.items() if part > 0]
    return f"Not observed by the other survey: {' and '.join(parts)}." if parts else None


def own_volume_text(changes: Changes, change: Change, *, signed: bool = True) -> str:
    """Give the volume of a change: "+17.3 ± 0.4 m³", "+0.03 m³ (hull)", "in 3" where it is another one's; else "".

    Of a change of which a part was gained and the rest lost it is both: "−170 ± 4 m³, +96 ± 2 m³". It has a sign where
    it is to be `signed` and is known to be gained or lost. All volumes of a record have one unit.
    """
    if change.volume_counted_in is not None:
        return f"in {change.volume_counted_in}"
    if change.volume is None:
        return ""
    sign = {"gain": "+", "loss": "−", None: ""}[change.gain_or_loss if signed else None]
    of_hull = " (hull)" if change.volume_method == "hull" else ""
    text = f"{sign}{_volume_text(changes, change.volume, change.volume_error)}{of_hull}"
    if change.opposite_volume is None or not signed:
        return text
    opposite = _volume_text(changes, change.opposite_volume, change.opposite_volume_error)
    return f"{text}, {opposite} the other way" if not sign else f"{text}, {'−' if sign == '+' else '+'}{opposite}"


def measures_text(changes: Changes, change: Change) -> str | None:
    """Give area and volume of a change and how they were measured; None where they were not."""
    if change.volume_counted_in is not None:
        return f"the other surface of change {change.volume_counted_in}, whose volume it is"
    if change.area is None or change.volume is None:
        return None
    how = " between both surfaces" if change.volume_method == "surface" else ""
    return f"area {area_text(change.area, changes.unit)}, volume {own_volume_text(changes, change)}{how}"


def volumes_text(changes: Changes) -> str | None:
    """Say what volume was gained and lost in all; None where no change has one."""
    totals = changes.volume_totals()
    if totals is None:
        return None
    parts = []
    if totals.gained:
        parts.append(f"{_volume_text(changes, totals.gained, totals.gained_error)} gained")
    if totals.lost:
        parts.append(f"{_volume_text(changes, totals.lost, totals.lost_error)} lost")
    if len(parts) == 2 and not totals.unsigned:
        sign = "+" if totals.net > 0 else ""
        parts.append(f"net {sign}{_volume_text(changes, totals.net, totals.net_error)}")
    if totals.unsigned:
        parts.append(f"{_volume_text(changes, totals.unsigned, totals.unsigned_error)} gained or lost")
    if not parts:
        return None
    height = "; z taken for the height" if changes.diagnostics.get("outer_side") == "up" else ""
    if any(change.volume is not None and change.volume_error is None for change in changes):
        interval = "without an interval where a hull is in it"
    else:
        interval = f"95 % interval{'s' * (len(parts) > 1)}"
    text = f"Volume: {', '.join(parts)} ({interval}{height})."
    return f"{text} {_why_unsigned(changes)}" if totals.unsigned else text


def _why_unsigned(changes: Changes) -> str:
    """Say why volumes have no sign, and the remedy."""
    if changes.diagnostics.get("outer_side") == "up":
        return (
            "Of walls and ceilings height does not tell on which side the free space is: give the sensor's position "
            "(--sensor-before X Y Z)."
        )
    return (
        "Of these, nothing tells from which side the surfaces were seen: give the sensor's position (--sensor-before X "
        "Y Z; for scans from the air a point high above, for a depth frame --sensor-at-origin)."
    )


def registration_text(changes: Changes) -> str | None:
    """Say how far the after scan was moved and how well it fits; None where nothing is known."""
    registration, unit = changes.registration, changes.unit
    if registration.overlap is None:
        return None
    what = "cloud" if changes.diagnostics.get("volumetric") else "scan"
    if registration.applied:
        moved = metric_text((registration.displacement,), unit)
        parts = [f"The after {what} was moved by {moved} and {degrees_text(registration.rotation_degrees)}"]
    elif registration.in_doubt and changes.config.registration != "never":
        parts = [f"The after {what} was kept in the frame that it was given in"]
    elif changes.config.registration == "never":
        parts = [f"The {what}s were compared as they are, without registration"]
    else:
        parts = [f"The {what}s needed no registration"]
    # The residual of volumetric clouds is a standard error, and that of clouds left alone is the one before.
    if registration.residual and not changes.diagnostics.get("volumetric"):
        before = registration.residual_before if registration.applied else None
        residuals = (registration.residual,) if before is None else (before, registration.residual)
        parts.append(f"residual {metric_text(residuals, unit)}")
    parts.append(f"overlap {percent(registration.overlap)}")
    if percent(registration.confidence) != "100 %" and registration.confidence < 0.99:
        parts.append(f"confidence {percent(registration.confidence)}")
    return f"{'; '.join(parts)}."


def poses_text(changes: Changes) -> str | None:
    """Say whether the poses of the sensor were known and what rests on that; None where they play no part.

    A change rests on its shape alone where the poses of the other survey are not known: that of an object that appeared
    on those of the before scan.
    """
    used = _views_used(changes)
    if used is None:
        return None
    known = [side for side, own in used.items() if own]
    missing = [side for side in used if side not in known]
    text = f"Sensor poses: {_known_text(changes, known, missing)}"
    resting = _resting(changes, missing) if missing else ""
    if not resting:
        return f"{text}."
    return f"{text}; {resting}. {_how_to_give_poses(changes, missing)}"


def _how_to_give_poses(changes: Changes, missing: list[str]) -> str:
    """Name the options that give the poses of these sides."""
    options = " or ".join(option for side in missing for option in (f"--sensor-{side} X Y Z", f"--views-{side} FILE"))
    if len(missing) == 2:
        # What lies below the origin is no depth frame.
        at_origin = "" if changes.diagnostics.get("outer_side") == "up" else "--sensor-at-origin, "
        options = f"{at_origin}--sensor-before X Y Z or --views-before FILE (likewise for after)"
    return f"Give the sensor's position with {options}."


def _views_used(changes: Changes) -> dict[str, int] | None:
    """Count the views that were used of each side; None where no method asks for them."""
    sides = {side: changes.diagnostics.get(side) for side in ("before", "after")}
    if changes.diagnostics.get("volumetric"):
        return None
    counts = {side: found["views"] for side, found in sides.items() if isinstance(found, dict) and "views" in found}
    return counts if len(counts) == 2 else None


def _known_text(changes: Changes, known: list[str], missing: list[str]) -> str:
    """Say of which sides the poses are known, and how: given, or recognised in the scan."""
    recognised = changes.recognised_stations()
    stations = {side: len(getattr(recognised, side)) for side in known}
    given = [side for side in known if not stations[side]]
    if given == known:
        return (
            "known for both scans" if not missing else f"known for the {known[0]} scan only" if known else "not known"
        )
    found = " and ".join(
        f"{count} {'station' if count == 1 else 'stations'} in the {side} scan"
        for side, count in stations.items()
        if count
    )
    others = [f"known for the {side} scan" for side in given] + [f"not known for the {side} scan" for side in missing]
    return "; ".join([f"{found}, recognised by the density of the ground", *others])


def _resting(changes: Changes, missing: list[str]) -> str:
    """Say what was judged without the poses of these sides; "" where nothing was."""
    # What appeared is in the after scan, and was judged by what the before survey saw in its place.
    judge = {"appeared": "before", "disappeared": "after"}
    shapes = 0
    for labels in object_labels(changes):
        own = [changes[label] for label in labels if changes[label].explanation is not None]
        shapes += any(change.kind == "moved" or judge[change.kind] in missing for change in own)
    rejected = [one for one in changes.rejected if one.reason == "not observed" and judge[one.kind] in missing]
    parts = []
    if shapes:
        parts.append(f"{shapes} change{'s rest' if shapes != 1 else ' rests'} on shape alone")
    if rejected:
        were = "candidate was" if len(rejected) == 1 else "candidates were"
        parts.append(f"{len(rejected):,} {were} rejected as not observed")
    return " and ".join(parts)


def place_cells(found: Change | RejectedCandidate, decimals: int | None = None) -> tuple[str, str, str]:
    """Give the number of points, centre and size, as in `HEADINGS`."""
    return (f"{found.point_count:,}", *place_text(found.mean, found.box.extent, decimals))


def place_text(
    centre: Float[np.ndarray, "3"], extent: Float[np.ndarray, "3"], decimals: int | None = None
) -> tuple[str, str]:
    """Give a centre and a size, in decimals that show the longest edge in three digits unless they are given."""
    digits = _decimals(extent) if decimals is None else decimals
    return ", ".join(f"{value:.{digits}f}" for value in centre), " × ".join(f"{value:.{digits}f}" for value in extent)


def _object_row(changes: Changes, labels: tuple[int, ...], decimals: int) -> ObjectRow:
    own = [changes[label] for label in labels]
    text = motion_text(changes, (labels[0], labels[1])) if len(labels) == 2 else own[0].kind
    volume = own_volume_text(changes, own[-1], signed=len(labels) == 1)
    area = "" if own[-1].area is None else area_text(own[-1].area, changes.unit)
    probability = percent(max(change.probability for change in own))
    label = ", ".join(map(str, labels))
    return ObjectRow(labels, own[0].kind, label, text, probability, *place_cells(own[-1], decimals), volume, area)


def _volume_text(changes: Changes, value: float, error: float | None) -> str:
    """Give a volume in the unit that all volumes of a record have."""
    greatest = max((change.volume for change in changes if change.volume is not None), default=0.0)
    return volume_text(value, changes.unit, error, greatest=greatest)


def _decimals(extent: np.ndarray) -> int:
    """Return the decimals that show the longest edge in three digits."""
    longest = float(extent.max())
    return 3 if longest <= 0 else min(max(2 - math.floor(math.log10(longest)), 0), 9)
