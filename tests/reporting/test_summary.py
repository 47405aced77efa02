import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.registration import Registration
from gmmjax.geometry.rigid import rigid_transform, rotation_about
from gmmjax.reporting.quantities import percent
from gmmjax.reporting.summary import (
    HEADINGS,
    answer,
    dropped_rows,
    headings,
    measures_text,
    object_rows,
    poses_text,
    registration_text,
    unobserved_text,
    volumes_text,
)
from tests.changes.explained import explanation, rejected


def moved(pair, transform, unit=None):
    """The record with a single object, which was the first change and became the second one."""
    items = pair[2].items
    before = dataclasses.replace(items[0], kind="moved", partner=1, transform=transform, volume=0.3)
    after = dataclasses.replace(items[1], kind="moved", partner=0, transform=transform, volume=0.0042)
    return dataclasses.replace(pair[2], items=(before, after), unit=unit)


def posed(changes, before, after, *items, candidates=()):
    """The record with these changes and numbers of views."""
    diagnostics = {"before": {"views": before}, "after": {"views": after}}
    return dataclasses.replace(changes, diagnostics=diagnostics, items=items, rejected=candidates)


def test_answer_counts_each_kind(pair):
    assert answer(pair[2]) == "3 changes: 1 appeared, 1 disappeared, 1 moved"


def test_a_moved_object_counts_once(pair):
    before, after = (dataclasses.replace(pair[2].items[1], partner=partner) for partner in (1, 0))
    assert answer(dataclasses.replace(pair[2], items=(before, after))) == "1 change: 1 moved"


def test_a_moved_object_is_one_row_with_both_labels(pair):
    turn = Rotation.from_euler("z", 6, degrees=True).as_matrix()
    centre = pair[2][0].box.centre
    rows = object_rows(moved(pair, rotation_about(turn, centre, centre + np.array([0.06, 0.08, 0])), "m"))
    assert [(row.labels, row.label, row.text) for row in rows] == [((0, 1), "0, 1", "moved 0.10 m, turned 6°")]
    assert rows[0].points == "60" and rows[0].volume == "0.0042 m³"
    straight = rotation_about(np.eye(3), centre, centre + np.array([0.06, 0.08, 0]))
    assert object_rows(moved(pair, straight))[0].text == "moved 0.10"


def test_the_place_in_the_before_scan_comes_first(pair):
    """Whichever of the two changes is the more probable one."""
    labels_before, labels_after = np.full(400, -1), np.full(500, -1)
    labels_before[:50], labels_after[:60] = 1, 0
    record = dataclasses.replace(moved(pair, np.eye(4)), labels_before=labels_before, labels_after=labels_after)
    assert [row.labels for row in object_rows(record)] == [(1, 0)]


def test_coordinates_have_their_unit_in_the_heading(pair):
    assert headings(pair[2]) == HEADINGS
    assert headings(dataclasses.replace(pair[2], unit="mm"))[4:6] == ("Centre (mm)", "Size (mm)")


def measured(change, volume, error, gain_or_loss):
    return dataclasses.replace(
        change,
        area=12.0,
        volume=volume,
        volume_error=error,
        volume_registration_error=0.6 * error,
        volume_method="surface",
        gain_or_loss=gain_or_loss,
    )


def test_what_was_gained_and_lost_is_told_with_its_uncertainty(pair):
    items = pair[2].items
    gains, loss = measured(items[0], 17.29, 0.4, "gain"), measured(items[1], 107.4, 3.0, "loss")
    other = dataclasses.replace(items[2], volume_counted_in=1)
    record = dataclasses.replace(pair[2], items=(gains, loss, other), unit="m")
    assert [row.volume for row in object_rows(record)] == ["+17.3 ± 0.4 m³", "−107 ± 3 m³", "in 1"]
    both = dataclasses.replace(loss, opposite_volume=96.2, opposite_volume_error=2.0)
    row = object_rows(dataclasses.replace(record, items=(both,)))[0]
    assert row.volume == "−107 ± 3 m³, +96 ± 2 m³"
    text = "Volume: 17.3 ± 0.4 m³ gained, 107 ± 3 m³ lost, net −90 ± 3 m³ (95 % intervals)."
    assert volumes_text(record) == text
    only = dataclasses.replace(record, items=(gains, gains))
    assert volumes_text(only) == "Volume: 34.6 ± 0.7 m³ gained (95 % interval)."
    assert volumes_text(pair[2]) is None


def test_a_volume_without_a_known_side_has_no_sign_and_the_sentence_says_why(pair):
    items = pair[2].items
    either = measured(items[0], 17.29, 0.4, None)
    record = dataclasses.replace(pair[2], items=(either,), unit="m", diagnostics={"outer_side": "unknown"})
    assert [row.volume for row in object_rows(record)] == ["17.3 ± 0.4 m³"]
    text = volumes_text(record)
    assert text.startswith(
        "Volume: 17.3 ± 0.4 m³ gained or lost (95 % interval). Of these, nothing tells from which side"
    )
    assert "--sensor-before X Y Z" in text and "point high above" in text
    on_wall = dataclasses.replace(
        record, items=(either, measured(items[1], 2.0, 0.4, "gain")), diagnostics={"outer_side": "up"}
    )
    text = volumes_text(on_wall)
    assert "2.0 ± 0.4 m³ gained, 17.3 ± 0.4 m³ gained or lost (95 % intervals; z taken for the height)" in text
    assert "Of walls and ceilings" in text and "net" not in text


def test_all_volumes_have_one_unit(pair):
    """Beside cubic metres, 8,000 cm³ read as if they were much."""
    items = pair[2].items
    small, great = measured(items[0], 0.008, 0.006, "gain"), measured(items[1], 0.2, 0.05, "loss")
    record = dataclasses.replace(pair[2], items=(small, great), unit="m")
    assert [row.volume for row in object_rows(record)] == ["+0.008 ± 0.006 m³", "−0.20 ± 0.05 m³"]
    assert volumes_text(record).startswith("Volume: 0.008 ± 0.006 m³ gained, 0.20 ± 0.05 m³ lost")
    assert measures_text(record, small) == "area 12.0 m², volume +0.008 ± 0.006 m³ between both surfaces"
    alone = dataclasses.replace(record, items=(small,))
    assert [row.volume for row in object_rows(alone)] == ["+8,000 ± 6,000 cm³"]


def test_the_volume_of_a_hull_says_that_it_is_one_and_has_no_interval(pair):
    hull = dataclasses.replace(measured(pair[2].items[0], 0.25, 0.0, "gain"), volume_method="hull", volume_error=None)
    record = dataclasses.replace(pair[2], items=(hull,), unit="m")
    assert [row.volume for row in object_rows(record)] == ["+0.25 m³ (hull)"]
    assert volumes_text(record) == "Volume: 0.25 m³ gained (without an interval where a hull is in it)."


def test_no_change(pair):
    assert answer(dataclasses.replace(pair[2], items=())) == "No change found"


@pytest.mark.parametrize(
    ("probability", "text"), [(1.0, "100 %"), (0.9999, "99 %"), (0.995, "99 %"), (0.505, "50 %"), (0.75, "75 %")]
)
def test_only_certainty_is_a_hundred_percent(probability, text):
    assert percent(probability) == text


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        (0, None),
        (1, "Not observed by the other survey: under 1 % of the before cloud."),
        (3, "Not observed by the other survey: under 1 % of the before cloud."),
        (4, "Not observed by the other survey: 1 % of the before cloud."),
        (399, "Not observed by the other survey: 99 % of the before cloud."),
    ],
)
def test_what_was_not_observed_is_never_none_where_there_is_some(pair, rows, text):
    unobserved = {"unobserved_before": np.arange(400) < rows, "unobserved_after": np.zeros(500, bool)}
    assert unobserved_text(dataclasses.replace(pair[2], **unobserved)) == text


def test_headings_name_no_unit():
    assert not any("(" in heading for heading in HEADINGS)


@pytest.mark.parametrize(
    ("unit", "size"), [(1, "2.00 × 1.00 × 0.50"), (0.01, "0.0200 × 0.0100 × 0.0050"), (1000, "2000 × 1000 × 500")]
)
def test_sizes_have_three_digits_in_any_unit(pair, unit, size):
    box = dataclasses.replace(pair[2].items[0].box, extent=np.array([2, 1, 0.5]) * unit)
    item = dataclasses.replace(pair[2].items[0], box=box)
    assert object_rows(dataclasses.replace(pair[2], items=(item,)))[0].size == size


def test_dropped_rows_are_those_of_the_diagnostics(pair):
    assert dropped_rows(pair[2]) == {"before": 1}
    assert dropped_rows(dataclasses.replace(pair[2], diagnostics={})) == {}


def test_the_registration_is_told_in_words(pair):
    turn = Rotation.from_euler("z", 0.4, degrees=True).as_matrix()
    record = Registration(rigid_transform(turn), True, 0.3, 0.0013, 0.0033, 0.96)
    assert registration_text(pair[2]) is None
    registered = dataclasses.replace(pair[2], registration=record)
    assert registration_text(dataclasses.replace(registered, unit="m")) == (
        "The after scan was moved by 30 cm and 0.4°; residual 3.3 to 1.3 mm; overlap 96 %."
    )
    assert registration_text(registered) == (
        "The after scan was moved by 0.3 and 0.4°; residual 0.0033 to 0.0013; overlap 96 %."
    )
    doubtful = dataclasses.replace(record, applied=False, transform=np.eye(4), confidence=0.4)
    assert registration_text(dataclasses.replace(pair[2], registration=doubtful, unit="mm")) == (
        "The after scan was kept in the frame that it was given in; residual 0.0013 mm; overlap 96 %; confidence 40 %."
    )
    config = dataclasses.replace(pair[2].config, registration="never")
    assert registration_text(dataclasses.replace(pair[2], registration=doubtful, config=config)) == (
        "The scans were compared as they are, without registration; residual 0.0013; overlap 96 %; confidence 40 %."
    )


def test_what_rests_on_unknown_poses_names_the_option(pair):
    gone, _, new = (dataclasses.replace(item, explanation=explanation()) for item in pair[2].items)
    hidden = rejected("appeared", "not observed", 0.1, 0.2)
    assert poses_text(pair[2]) is None
    assert poses_text(posed(pair[2], 1, 4, gone, new)) == "Sensor poses: known for both scans."
    assert poses_text(posed(pair[2], 0, 0, *pair[2].items)) == "Sensor poses: not known."
    text = poses_text(posed(pair[2], 0, 0, gone, new, candidates=(hidden,)))
    assert text is not None and text.startswith(
        "Sensor poses: not known; 2 changes rest on shape alone and 1 candidate was rejected as not observed."
    )
    assert all(option in text for option in ("--sensor-at-origin", "--sensor-before X Y Z", "--views-before FILE"))


def test_a_change_is_judged_by_the_poses_of_the_other_survey(pair):
    gone, _, new = (dataclasses.replace(item, explanation=explanation()) for item in pair[2].items)
    assert poses_text(posed(pair[2], 1, 0, new)) == "Sensor poses: known for the before scan only."
    text = poses_text(posed(pair[2], 1, 0, gone))
    assert text is not None and "1 change rests on shape alone" in text and "--sensor-after X Y Z" in text
    assert "before X" not in text


def test_stations_that_were_recognised_are_told(pair):
    """And which poses were given, or are not known."""
    gone, _, new = (dataclasses.replace(item, explanation=explanation()) for item in pair[2].items)

    def text(before, after, stations_before, stations_after):
        changes = posed(pair[2], before, after, gone, new)
        numbers = {"before": stations_before, "after": stations_after}
        diagnostics = {
            side: {**own, "recognised_stations": [[0.0, 0.0, 1.5]] * numbers[side]}
            for side, own in changes.diagnostics.items()
        }
        return poses_text(dataclasses.replace(changes, diagnostics=diagnostics))

    assert text(2, 1, 2, 1) == (
        "Sensor poses: 2 stations in the before scan and 1 station in the after scan, recognised by the density of the "
        "ground."
    )
    assert text(4, 1, 0, 1) == (
        "Sensor poses: 1 station in the after scan, recognised by the density of the ground; known for the before scan."
    )
    missing = text(2, 0, 2, 0)
    assert missing.startswith(
        "Sensor poses: 2 stations in the before scan, recognised by the density of the ground; not known for the after "
        "scan; 1 change rests on shape alone."
    )
    assert "--sensor-after X Y Z" in missing and "before X" not in missing
    assert text(2, 3, 0, 0) == "Sensor poses: known for both scans."


def test_nothing_rests_on_shape_where_all_poses_are_known(pair):
    """What moved is judged by both."""
    items = tuple(dataclasses.replace(item, explanation=explanation()) for item in pair[2].items)
    assert "moved" in {item.kind for item in items}
    assert poses_text(posed(pair[2], 1, 4, *items)) == "Sensor poses: known for both scans."
