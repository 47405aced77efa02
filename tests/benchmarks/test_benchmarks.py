"""That the benchmarks compare like with like, on sizes so small that their times mean nothing."""

import json
import re
import sys

import jax
import numpy as np
import pytest

from gmmjax import SensorViews
from gmmjax.changes import FACTS, names_of, shipped_verdicts
from gmmjax.learning import (
    CHANGED,
    LEARNED_FROM,
    UNCHANGED,
    CandidateRows,
    Collected,
    TrainingSettings,
    write_rows,
)
from gmmjax.pair import Pair
from tests.benchmarks import (
    accelerator,
    checkout_process,
    checkouts,
    displacements,
    gradients,
    judged_candidates,
    m3c2,
    numpy_figueiredo_jain,
    other_generators,
    peers,
    repeatability,
    scenes,
    tasks,
    without_facts,
)
from tests.benchmarks.interleaved import Timing
from tests.benchmarks.surveyor import kinds as surveyor_kinds
from tests.mixtures import plain_figueiredo_jain


@pytest.fixture(scope="module")
def cloud():
    return scenes.gaussian_cloud(400, gaussians=4)


def test_the_lean_numpy_fit_is_the_oracle(cloud):
    floor = scenes.noise_floor(cloud)
    means, covariances = numpy_figueiredo_jain.start(cloud, 6, floor)
    length, mixture = numpy_figueiredo_jain.annihilate(cloud, means, covariances, floor)
    mass, weights = np.ones(len(cloud)), np.full(6, 1 / 6)
    expected, oracle = plain_figueiredo_jain.fit(cloud, mass, weights, means, covariances, floor)
    assert length == pytest.approx(expected)
    live = oracle[0] > 0
    for ours, theirs in zip(mixture, oracle, strict=True):
        np.testing.assert_allclose(ours, theirs[live], rtol=1e-6, atol=1e-9)


def test_our_fit_and_the_peer_find_the_same_mixture(cloud):
    ours, theirs = tasks.fit(cloud, max_components=6), peers.figueiredo_jain(cloud, 6)
    assert ours.mixture.count == len(theirs.weights)
    lengths = [scenes.exact_length(mixture, cloud) for mixture in (ours.mixture, theirs)]
    assert lengths[0] == pytest.approx(float(ours.message_length))
    assert lengths[0] == pytest.approx(lengths[1], abs=0.5)


def test_transport_and_its_peers_agree():
    before = scenes.mixtures(6, 8)
    after = scenes.changed_mixtures(before)
    pairs = peers.live_pairs(before, after)
    ours = tasks.batch_of_distances(before, after, "exact")
    np.testing.assert_allclose(ours, [peers.pot_distance(*pair) for pair in pairs], atol=1e-12)
    np.testing.assert_allclose(ours, [peers.linear_programme(*pair) for pair in pairs], atol=1e-9)
    singles = [[jax.tree.map(lambda leaf, i=i: leaf[i], own) for i in range(6)] for own in (before, after)]
    np.testing.assert_allclose(ours, tasks.single_distances(*singles), atol=1e-12)
    removed = tasks.removals(before, after)
    for index, pair in enumerate(pairs):
        gone, new = peers.pot_greedy(*pair)
        assert set(np.flatnonzero(removed.disappeared[index])) == set(gone)
        assert set(np.flatnonzero(removed.appeared[index])) == set(new)


@pytest.mark.slow
def test_entropic_transport_and_ott_agree():
    before, after = scenes.mixtures(3, 18), scenes.mixtures(3, 18, seed=1)
    ours, theirs = tasks.batch_of_distances(before, after, "sinkhorn", 0.2), peers.ott_distances(before, after, 0.2)
    np.testing.assert_allclose(ours, theirs, rtol=1e-5)


@pytest.mark.slow
def test_an_accelerator_is_compared_with_the_cores():
    case = next(case for case in accelerator.cases(quick=True) if case.function is accelerator.transported)
    cells = accelerator.row(case, "cpu", repeats=1).strip("| ").split(" | ")
    assert len(cells) == len(accelerator.COLUMNS)
    assert cells[0] == case.what and cells[6] == "0 of the distance" and cells[7] == "1"


@pytest.mark.slow
def test_the_fused_loop_sums_what_em_sums(cloud):
    fused = pytest.importorskip("tests.benchmarks.fused_loop", exc_type=ImportError)
    blocks, parameters = fused.problem(cloud, 5)
    sums, likelihood = fused.sweep(blocks, parameters)
    features = blocks.reshape(-1, fused.FEATURES, fused.BLOCK).transpose(1, 0, 2).reshape(fused.FEATURES, -1)
    joint = np.exp(parameters.astype(float) @ features)
    np.testing.assert_allclose(sums, joint / joint.sum(axis=0) @ features.T, rtol=1e-3, atol=1e-3)
    assert likelihood == pytest.approx(np.log(joint.sum(axis=0)).sum(), rel=1e-4)


@pytest.mark.slow
def test_implicit_and_unrolled_gradients_agree(cloud):
    ways = gradients.Contenders(cloud, 6)
    implicit = ways.gradient("implicit", 5000)()
    unrolled = ways.gradient("unrolled", 4 * ways.steps)()
    for name in ("noise_floor", "scale", "degrees_of_freedom", "mean_strength"):
        np.testing.assert_allclose(getattr(implicit, name), getattr(unrolled, name), rtol=1e-4, err_msg=name)
    # Of the program that was compiled just now, and of a shorter one.
    assert ways.memory("unrolled", 4 * ways.steps) > 2 * ways.memory("unrolled", ways.steps)


def test_labels_are_compared_after_their_changes_were_matched():
    own = np.array([0, 0, 0, 1, 1, -1, -1])
    other = np.array([2, 2, 0, 1, -1, -1, 3])
    renumbered = repeatability.matching(own, other, 2, 4)
    np.testing.assert_array_equal(renumbered, [0, 0, -2, 1, -1, -1, -2])


def test_another_way_to_give_a_pair_is_undone_before_labels_are_compared(monkeypatch):
    class Found:
        items = ()

        def __init__(self, before, after):
            self.labels_before, self.labels_after = (np.full(len(cloud), -1) for cloud in (before, after))
            self.probability_before, self.probability_after = before[:, 0], after[:, 0]

    def detected(before, after, mode):
        return displacements.Detected(Found(before, after), [], 0.0)

    monkeypatch.setattr(repeatability, "detected", detected)
    random = np.random.default_rng(0)
    scene = repeatability.Scene(random.normal(size=(7, 3)), random.normal(size=(9, 3)))
    found = {way.name: difference for way, difference in repeatability.measured(scene)}
    for name in ("rows permuted", "exchanged", "exchanged, not registered"):
        assert str(found[name]) == "0; 0"
    assert found["mirrored"].probability > 0


def test_given_displacements_are_along_x_and_about_each_axis():
    shift, *rotations = displacements.given_displacements([0.3], [20.0])
    np.testing.assert_array_equal(shift.transform[:3, 3], [0.3, 0, 0])
    for axis, rotation in zip(np.eye(3), rotations, strict=True):
        np.testing.assert_allclose(rotation.transform[:3, :3] @ axis, axis)
        assert np.trace(rotation.transform[:3, :3]) == pytest.approx(1 + 2 * np.cos(np.radians(20)))


def test_the_report_says_what_was_not_reached(tmp_path):
    report = pytest.importorskip("tests.benchmarks.report")
    pytest.importorskip("matplotlib")
    row = {"what": "a fit", "unit": "x", "ours": "1 s", "peer": "9 s", "least": True}
    rows = [{**row, "asked": 40.0, "measured": 9.0}, {**row, "asked": 8.0, "measured": 9.0, "what": "another"}]
    extra = {"rows": rows, "curves": [{"figure": "cores", "line": "fits", "x": [1, 2], "y": [2.0, 1.0]}]}
    extra |= {"contenders": {"ours": {"cpu_s": 1, "wall_s": 1, "compilation_s": 2}}, "load": [0.5, 0.7]}
    extra |= {"quick": True, "cores": 2, "answers": {"components": {"ours": [8]}}}
    machine = {"cpu": {}, "device": "cpu", "python_version": "3", "versions": {}}
    run = {"machine_info": machine, "datetime": "2026-01-01", "benchmarks": [{"name": "one", "extra_info": extra}]}
    page = tmp_path / "benchmarks.md"
    page.write_text("\n".join(["How to read it.", *report.MARKS, "The end."]))
    for _ in range(2):
        report.write_report(json.loads(json.dumps(run)), page)
        text = page.read_text()
        assert "| a fit | ≥ 40 x | 9 x | **no** |" in text and "| another | ≥ 8 x | 9 x | yes |" in text
        assert text.startswith("How to read it.") and text.endswith("The end.") and "--quick" in text
        for image in re.findall(r"\((images/.*)\)", text):
            assert (tmp_path / image).is_file()


def test_the_report_of_a_part_is_printed(tmp_path, monkeypatch, capsys):
    report = pytest.importorskip("tests.benchmarks.report")
    row = {"what": "a fit", "unit": "s", "ours": "1 s", "peer": "", "least": False, "asked": 0.3, "measured": 0.2}
    extra = {"rows": [row], "load": [0.5, 0.7], "quick": False, "cores": 2}
    machine = {"cpu": {}, "device": "cpu", "python_version": "3", "versions": {}}
    run = {"machine_info": machine, "datetime": "2026-01-01", "benchmarks": [{"name": "one", "extra_info": extra}]}
    (tmp_path / "run.json").write_text(json.dumps(run))
    monkeypatch.setattr("sys.argv", ["report", str(tmp_path / "run.json")])
    report.main()
    assert "| a fit | ≤ 0.3 s | 0.2 s | yes | 1 s |  | 0.7 |" in capsys.readouterr().out


def test_a_pair_for_two_checkouts_comes_back_as_it_was(tmp_path):
    clouds = np.arange(12.0).reshape(4, 3), np.ones((2, 3))
    views = SensorViews(np.eye(4)[None], (90.0, 60.0), 8.0), SensorViews(np.stack([np.eye(4)] * 2), (360.0, 30.0), 9.0)
    for given in (views, None):
        checkouts.PairOfScans(clouds, given).save(tmp_path / "pair.npz")
        with np.load(tmp_path / "pair.npz") as arrays:
            back, named = checkout_process.arrays_of(arrays)
        for own, read in zip(clouds, back, strict=True):
            np.testing.assert_array_equal(own, read)
        assert list(named) == (["views_before", "views_after"] if given else [])
        for own, read in zip(given or (), named.values(), strict=True):
            np.testing.assert_array_equal(own.poses, read.poses)
            assert (own.field_of_view, own.max_range) == (read.field_of_view, read.max_range)


def test_a_digest_sees_a_label_a_probability_and_a_fact():
    class Found:
        def __init__(self, label=0, probability=0.5, fact=0.25, seconds=1.0):
            self.labels_before = np.array([label, -1])
            self.probability_before = np.array([probability, 0.0])
            self.labels_after = self.probability_after = self.unobserved_before = self.unobserved_after = np.zeros(2)
            self.record = {"changes": [{"facts": [fact]}], "diagnostics": {"seconds": seconds}}

        def to_dict(self):
            return self.record

    found = [Found(), Found(label=1), Found(probability=0.5 + 1e-12), Found(fact=0.25 + 1e-12)]
    assert len({checkout_process.digest(one) for one in found}) == len(found)
    assert checkout_process.digest(Found(seconds=2.0)) == checkout_process.digest(found[0])


def test_a_row_compares_two_checkouts():
    def timing(cpus, digest, **kinds):
        return Timing(cpus=cpus, answer={"kinds": kinds, "digest": digest})

    pair = checkouts.PairOfScans((np.zeros((1200, 3)), np.zeros((5, 3))))
    timings = {"other": timing([2.0, 4.0, 9.0], "a", appeared=2), "own": timing([1.0, 1.0, 1.0], "b")}
    row = checkouts.row("hall", pair, timings, 1.26)
    assert row == "| hall | 1,200 and 5 | 4.00 | 1.00 | 0.25 | 2 appeared | nothing | no | 1.3 |"
    assert row.count("|") == checkouts.HEADER.splitlines()[0].count("|")


def test_m3c2_is_given_the_same_as_py4dgeo(tmp_path, monkeypatch):
    pytest.importorskip("py4dgeo")
    # It logs to a file in the working directory.
    monkeypatch.chdir(tmp_path)
    for case in (m3c2.Case(4000, 200, 0.8, 2.0), m3c2.Case(4000, 200, 0.8, 3.0, offset=5e6)):
        timings = m3c2.timed(case, 1, {"ours": m3c2.ours, "py4dgeo": m3c2.theirs})
        *_, distance, level, others = m3c2.row(case, timings).strip("| ").split(" | ")
        assert float(distance) < 1e-6 and float(level) < 1e-6 and others == "0"
        assert np.isfinite(timings["ours"].answer.level_of_detection).mean() > 0.9


def unchanged_and_changed(*, poses):
    """Two candidates: no fact of the first speaks for a change, all that can do of the second."""
    names = names_of(poses=poses)
    alike = np.array([FACTS[name].change >= 0 for name in names], float)
    rows = np.stack([np.zeros(len(names)), alike])
    rows[:, names.index("count")] = 100
    return CandidateRows(rows, np.array([UNCHANGED, CHANGED]), np.full(2, 100), np.array([0, 100]))


def test_candidates_are_judged_by_the_verdict():
    families = {"made": unchanged_and_changed(poses=True)}
    probability = judged_candidates.probabilities(shipped_verdicts().poses_given, families["made"])[:, CHANGED]
    assert probability[0] < 0.5 < probability[1]
    table = judged_candidates.table(shipped_verdicts(), families, poses=True)
    assert table.startswith("| family |") and "| made | 2 | 1 | 1.000 | 0 | 0 |" in table


def test_candidates_of_other_generators_are_judged_by_the_verdict(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["judged_candidates", "--others", str(tmp_path)])
    with pytest.raises(SystemExit):
        judged_candidates.main()
    assert f"{tmp_path}: has no candidates" in capsys.readouterr().err
    rows = Pair(unchanged_and_changed(poses=False), unchanged_and_changed(poses=True))
    write_rows(tmp_path / "hall.npz", Collected({"hall": rows}))
    judged_candidates.main()
    unknown, given = capsys.readouterr().out.split("## Poses given")
    assert all("| hall | 2 | 1 |" in table for table in (unknown, given)) and "| 1.000 | 0 | 0 |" in given


@pytest.mark.slow
def test_facts_can_be_left_out_of_what_is_learned(tmp_path):
    """Of facts that are noise but for one, no family is judged without that one."""
    random, names = np.random.default_rng(0), names_of(poses=True)

    def family():
        kind = np.tile([UNCHANGED, CHANGED], 60)
        values = random.uniform(0.4, 0.6, (120, len(names)))
        values[:, names.index("count")] = 100
        values[:, names.index("seen_free")] = kind == CHANGED
        return CandidateRows(values, kind, np.full(120, 100), np.where(kind == CHANGED, 100, 0))

    families = {name: family() for name in LEARNED_FROM[:2]}
    settings = TrainingSettings(penalties=(3.0,))
    with_all, without = (
        list(without_facts.tables(families, [{"other": family()}], facts, poses=True, settings=settings))
        for facts in ((), ["seen_free"])
    )
    assert "| all | 240 | 120 | 1.000 | 0 | 0 |" in with_all[0]
    assert "| other | 120 | 60 | 1.000 | 0 | 0 |" in with_all[1]
    assert all("| 1.000 |" not in table for table in without)


def test_candidates_of_other_generators_are_kept(tmp_path, monkeypatch, capsys):
    """Those that are there are read, and those of other seeds refused."""
    made, tasks_done = Pair(CandidateRows.none(poses=False), CandidateRows.none(poses=True)), []
    monkeypatch.setattr(other_generators, "_of_scene", lambda task, kind, points: tasks_done.append(task) or made)
    arguments = ["other_generators", "--kinds", "street", "hall", "--seeds", "2", "--out", str(tmp_path / "others")]
    monkeypatch.setattr(sys, "argv", arguments)
    other_generators.main()
    other_generators.main()
    assert capsys.readouterr().out.count(": 0 candidates") == 4
    assert tasks_done == [(0, True), (0, False), (1, True), (1, False)] * 2
    monkeypatch.setattr(sys, "argv", [*arguments, "--first-seed", "5"])
    with pytest.raises(SystemExit):
        other_generators.main()
    assert "collected from other seeds" in capsys.readouterr().err


def test_all_points_of_a_scene_where_nothing_changed_are_judged(monkeypatch):
    """Where something changed those that nobody can judge are not."""
    asked = []

    def rows_of_scans(scans, truths):
        asked.append((scans.before.views is not None, truths.before.judged.all()))
        return Pair("unknown", "given")

    monkeypatch.setattr(other_generators, "rows_of_scans", rows_of_scans)
    for changed in (False, True):
        pair = surveyor_kinds.simulated("hall", 0, 5_000, changed=changed)
        assert other_generators._of_survey(pair) == Pair("unknown", "given")
    assert asked == [(False, True), (True, True), (False, False), (True, False)]
