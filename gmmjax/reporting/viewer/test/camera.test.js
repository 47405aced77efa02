import assert from "node:assert/strict";
import { test } from "node:test";

import { add, bestDirection, between, bounds, clipBox, corners, dot, framed, screenAxes, unit } from "../src/geometry.js";
import { principalAxes } from "../src/overlay.js";

const UP = [0, 0, 1];
const FRONT = unit([1, -1.5, 1]);

/** A grid of points on the rectangle that two vectors span about its middle. */
function plate(middle, across, along, count = 25) {
  const points = [];
  for (let i = 0; i < count; i++) {
    for (let j = 0; j < count; j++) {
      points.push(...add(add(middle, across, i / (count - 1) - 0.5), along, j / (count - 1) - 0.5));
    }
  }
  return points;
}

test("what must be seen is in the framed view", () => {
  const whole = corners({ centre: [3, 1, 0], extent: [2, 1, 4], rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] });
  const points = Array.from({ length: 500 }, (_, index) => [Math.sin(index), Math.cos(3 * index), Math.sin(7 * index)]);
  for (const halfSizes of [[0.7, 0.4], [0.2, 0.4]]) {
    const { centre, distance } = framed(points, whole, FRONT, UP, halfSizes);
    const axes = screenAxes(FRONT, UP);
    for (const corner of whole) {
      const [x, y, z] = axes.map((axis) => dot(add(corner, centre, -1), axis));
      assert.ok(distance > z);
      assert.ok(Math.abs(x) / (distance - z) <= 1.02 * halfSizes[0]);
      assert.ok(Math.abs(y) / (distance - z) <= 1.02 * halfSizes[1]);
    }
  }
});

test("a single point is framed from a positive distance", () => {
  const { centre, distance } = framed([[0, 0, 0]], [], FRONT, UP, [0.4, 0.4]);
  assert.ok(distance > 0);
  assert.deepEqual(centre.map(Math.abs), [0, 0, 0]);
});

test("a change on a wall is looked at from the side where the wall does not hide it", () => {
  const change = plate([0, 0.05, 0], [1, 0, 0], [0, 0, 1]);
  const wall = plate([0, 0, 0], [4, 0, 0], [0, 0, 4], 100);
  const direction = bestDirection(change, wall, 0.12, FRONT, UP);
  assert.ok(direction[1] > 0.3, `looked at from ${direction}`);
  assert.ok(dot(direction, UP) > 0, "from above");
});

test("what nothing hides is looked at from about where one looks first", () => {
  const change = plate([0, 0, 0], [1, 0, 0], [0, 1, 0]);
  assert.ok(dot(bestDirection(change, [], 0.1, FRONT, UP), FRONT) > 0.8);
});

test("a flight turns the short way, keeps its length and ends where it should", () => {
  const [from, to] = [unit([1, 0.2, 0.5]), unit([0.9, -0.6, 0.1])];
  assert.ok(dot(between(from, to, UP, 0), from) > 1 - 1e-12);
  assert.ok(dot(between(from, to, UP, 1), to) > 1 - 1e-12);
  for (let step = 0; step <= 10; step++) {
    const direction = between(from, to, UP, step / 10);
    assert.ok(Math.abs(Math.hypot(...direction) - 1) < 1e-12);
    assert.ok(dot(direction, from) > dot(to, from) - 0.05);
  }
});

test("a flight between views straight from above is defined", () => {
  for (const value of between(UP, UP, UP, 0.5)) assert.ok(Number.isFinite(value));
});

test("the clipping box holds the change, also a flat one, with a margin", () => {
  const { centre, half } = clipBox(bounds([[0, 0, 0], [3, 1, 0]]), 1.5);
  assert.deepEqual(centre, [1.5, 0.5, 0]);
  assert.deepEqual(half, [2.25, 0.75, 0.75]);
});

test("the corners of a turned box", () => {
  const turned = corners({ centre: [1, 1, 1], extent: [4, 2, 0], rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]] });
  assert.deepEqual(bounds(turned), { lower: [0, -1, 1], upper: [2, 3, 1] });
});

test("the principal axes give the covariance again", () => {
  const covariance = [[2, 0.7, -0.3], [0.7, 1, 0.2], [-0.3, 0.2, 0.5]];
  const axes = principalAxes(covariance);
  for (const row of [0, 1, 2]) {
    for (const column of [0, 1, 2]) {
      const sum = axes.reduce((total, axis) => total + axis[row] * axis[column], 0);
      assert.ok(Math.abs(sum - covariance[row][column]) < 1e-9);
    }
  }
  assert.ok(Math.abs(dot(axes[0], axes[1])) < 1e-9);
});
