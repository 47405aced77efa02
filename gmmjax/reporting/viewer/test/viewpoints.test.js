import assert from "node:assert/strict";
import { test } from "node:test";

import { add, dot } from "../src/geometry.js";
import { Items } from "../src/items.js";
import { Pacing } from "../src/pacing.js";
import { checkSettings, keepsPoints } from "../src/settings.js";
import { closeUp, Flight } from "../src/viewpoints.js";
import { EVERYWHERE } from "../src/walls.js";

const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const SCENE = {
  up: [0, 0, 1],
  towardsEye: [0, -0.8, 0.6],
  changes: [
    { label: 0, partner: 1, centre: [0, 0, 0], extent: [2, 2, 2], rotation: AXES, mean: [1, 0, 0], covariance: AXES },
    { label: 1, partner: 0, centre: [4, 0, 0], extent: [2, 2, 2], rotation: AXES, mean: [4, 0, 0], covariance: AXES },
  ],
  rejected: [{ centre: [0, 5, 0], extent: [1, 1, 1], rotation: AXES }],
  stations: [{ side: "after", number: 1, position: [2, 4, 6] }],
};
const items = new Items(SCENE, 0.1);
const empty = { pointsOf: () => [], sampleOfOthers: () => [] };

test("a moved object is both of its changes", () => {
  assert.deepEqual(items.labelsOf(1), [1, 0]);
  assert.ok(Math.hypot(...add(items.clipOf(0, 1).centre, [0.2, 0, 0], -1)) < 1e-9);
  assert.deepEqual(items.labelsOf({ rejected: 0 }), []);
  assert.deepEqual(items.of(null), []);
  assert.throws(() => items.of(2), /no change 2/);
  assert.throws(() => items.of({ rejected: 1 }), /no rejected candidate 1/);
});

test("boxes and Gaussians are in the unit of the drawing", () => {
  assert.deepEqual(items.changes[1].centre, [0.4, 0, 0]);
  assert.ok(Math.abs(items.changes[0].covariance[2][2] - 0.01) < 1e-12);
});

test("a close-up has all of the change in view, also in a narrow one", () => {
  for (const aspect of [0.5, 2]) {
    const { centre, direction, distance } = closeUp(SCENE, items.of(0), [empty], aspect, EVERYWHERE);
    assert.ok(Math.hypot(...add(centre, [0.2, 0, 0], -1)) < 1e-9);
    assert.ok(dot(direction, SCENE.up) > 0);
    const half = Math.atan(Math.tan(Math.PI / 8) * Math.min(1, aspect));
    assert.ok(Math.asin(Math.hypot(0.3, 0.1, 0.1) / distance) < half);
  }
});

test("a flight arrives", () => {
  const [from, to] = [[[0, 0, 0], 1], [[1, 1, 0], 4]].map(([centre, distance]) => ({ centre, direction: [0, -1, 0], distance }));
  const flight = new Flight(from, to, SCENE.up, 1000, 500);
  assert.equal(flight.at(1250).distance, 2);
  assert.equal(flight.at(1250).arrived, false);
  assert.deepEqual(flight.at(1700).centre, to.centre);
  assert.equal(flight.at(1700).arrived, true);
  assert.equal(new Flight(from, to, SCENE.up, 1000, 0).at(1000).arrived, true);
});

test("a slow machine draws fewer points and pixels, a fast one all", () => {
  const paced = (milliseconds) => {
    const pacing = new Pacing();
    for (let frame = 0; frame < 40; frame++) {
      const { share } = pacing.plan(4e6, true);
      pacing.drawn({ took: milliseconds(share * 4e6), now: 20 * frame, share, moving: true });
    }
    return pacing.plan(4e6, true);
  };
  const slow = paced((points) => 5 + points / 1000);
  assert.ok(slow.share * 4e6 > 12000 && slow.share * 4e6 < 45000);
  assert.ok(slow.resolution < 1);
  assert.deepEqual(paced((points) => points / 1e6), { share: 1, resolution: 1 });
});

test("settings are checked, and what is drawn over the points leaves them", () => {
  assert.throws(() => checkSettings({ colour: "kind" }), /no setting "colour"/);
  assert.throws(() => checkSettings({ toString: true }), /no setting/);
  assert.throws(() => checkSettings({ clip: 1 }), /clip is a boolean/);
  assert.throws(() => checkSettings({ color: "red" }), /color is "kind"/);
  checkSettings({ color: "distance", clipScale: 2 });
  assert.ok(keepsPoints({ boxes: false, rejected: true, stations: false }));
  assert.ok(!keepsPoints({ boxes: false, clip: true }));
});
