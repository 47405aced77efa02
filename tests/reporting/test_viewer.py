"""The script that draws the points of a report, by Node where it is there."""

import json
import shutil
import subprocess

import numpy as np
import pytest

from gmmjax.reporting import asset
from gmmjax.reporting.packed_points import packed_scene
from tests.browser import VIEWER
from tests.reporting.test_packed_points import decoded, labels_of, surveyed

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="Node is not installed")

DECODE = """
import { readFileSync } from "node:fs";
import { decodeSide, fromBase64, inflate } from "./src/decode.js";
const [scene, points] = JSON.parse(readFileSync(0, "utf8"));
const side = decodeSide(await inflate(fromBase64(points)), scene, "before");
const plain = Object.entries(side).map(([name, values]) => [name, values?.length === undefined ? values : [...values]]);
console.log(JSON.stringify(Object.fromEntries(plain)));
"""


def by_node(*arguments, **options):
    done = subprocess.run(
        [NODE, *arguments], cwd=VIEWER, capture_output=True, text=True, encoding="utf-8", timeout=120, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_bundle_can_stand_in_a_page():
    script = asset("viewer.js")
    assert "</script" not in script.lower()
    assert "<!--" not in script
    assert "The MIT License" in script[:1500]
    assert "three.js authors" in script[:1500]
    assert "var GmmjaxViewer=" in script


@needs_node
def test_decoder_and_camera():
    by_node("--test", "test/")


@needs_node
def test_what_python_packs_the_viewer_reads(pair):
    clouds, changes = surveyed(pair, distance=True)
    packed = packed_scene(clouds, changes)
    read = json.loads(
        by_node("--input-type=module", "-e", DECODE, input=json.dumps([packed.scene, packed.points.before]))
    )
    points, planes = decoded(packed, "before")
    scene = packed.scene
    places = (np.reshape(read["steps"], (-1, 3)) + 0.5) * scene["quantisation"]["step"]
    np.testing.assert_allclose(places + scene["quantisation"]["lower"] + np.array(scene["origin"]), points, atol=1e-9)
    labels = np.array(read["labels"])
    np.testing.assert_array_equal(np.where(labels == 65_535, -1, labels), labels_of(planes))
    np.testing.assert_array_equal(read["unobserved"], planes["unobserved"])
    np.testing.assert_allclose(np.array(read["probability"]) / 255, planes["probability"] / 31, atol=0.003)
    assert np.ptp(read["distance"]) > 100
    from scipy.spatial import cKDTree

    index = cKDTree(clouds.before.points).query(points)[1]
    difference = np.reshape(read["colors"], (-1, 3)) - clouds.before.colors[index].astype(int)
    assert np.abs(difference).max() <= 8


@needs_node
@pytest.mark.skipif(not (VIEWER / "node_modules" / "esbuild").exists(), reason="`npm ci` was not run")
def test_bundle_is_built_from_the_sources(tmp_path):
    """The committed script is that of `npm ci && npm run build`."""
    by_node("build.js", "--out", str(tmp_path / "viewer.js"))
    assert (tmp_path / "viewer.js").read_text(encoding="utf-8") == asset("viewer.js")


def test_versions_are_pinned():
    package = json.loads((VIEWER / "package.json").read_text(encoding="utf-8"))
    locked = json.loads((VIEWER / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    for name, version in {**package["dependencies"], **package["devDependencies"]}.items():
        assert locked[f"node_modules/{name}"]["version"] == version
        assert locked[f"node_modules/{name}"]["integrity"].startswith("sha512-")
