import assert from "node:assert/strict";
import { test } from "node:test";

import { randomNumbers } from "../src/decode.js";
import { EVERYWHERE, walls, withoutNearWalls } from "../src/walls.js";

/** Points on the faces of a box, flat x, y, z; faces: [axis, side, share of the points]. */
function room(extent, faces, count = 12000) {
  const random = randomNumbers(3);
  const points = [];
  for (const [axis, side, share] of faces) {
    for (let index = 0; index < share * count; index++) {
      const point = extent.map((edge) => (random() - 0.5) * edge);
      point[axis] = side * 0.5 * extent[axis];
      points.push(...point);
    }
  }
  return points;
}

test("a closed room is open towards the eye", () => {
  const faces = [0, 1, 2].flatMap((axis) => [[axis, -1, 1 / 6], [axis, 1, 1 / 6]]);
  const found = walls(room([1, 0.6, 0.3], faces));
  assert.ok(found.upper[2] < 0.15 && found.upper[2] > 0.1);
  assert.ok(found.lower[1] > -0.3 && found.lower[1] < -0.25);
  const fromAbove = withoutNearWalls(found, [0.2, 0.1, 2]);
  assert.equal(fromAbove.upper[2], found.upper[2]);
  assert.deepEqual(fromAbove.lower, EVERYWHERE.lower);
  assert.deepEqual(withoutNearWalls(found, [0, 0, 0]), EVERYWHERE);
});

test("terrain, and a table with things on it, lose nothing to an eye above", () => {
  const random = randomNumbers(4);
  const hill = Array.from({ length: 8000 }, () => [random() - 0.5, random() - 0.5]).flatMap(([x, y]) => [x, y, 0.3 * x * x]);
  assert.ok(walls(hill).upper[2] > 1);
  const table = room([1, 0.8, 0.3], [[2, -1, 0.9], [0, 1, 0.05], [1, 1, 0.05]]);
  assert.ok(walls(table).upper[2] > 1);
});

test("a few points have no walls", () => {
  assert.deepEqual(walls([0, 0, 0, 1, 1, 1]), EVERYWHERE);
});
