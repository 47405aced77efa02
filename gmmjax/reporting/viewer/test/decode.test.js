import assert from "node:assert/strict";
import { test } from "node:test";
import { deflateSync } from "node:zlib";

import { decodeSide, drawingOrder, fromBase64, inflate, localSpacing, NO_LABEL, octreeLeaves, randomNumbers } from "../src/decode.js";

test("base64 and zlib are undone", async () => {
  const bytes = Uint8Array.from({ length: 5000 }, (_, index) => (index * index) % 251);
  const text = deflateSync(bytes).toString("base64");
  assert.deepEqual(await inflate(fromBase64(text)), bytes);
});

test("the leaves of an octree of two levels", () => {
  // The root has the children 0 and 7; the former the child 1, the latter 6 and 7.
  const { steps, read } = octreeLeaves(Uint8Array.of(0b10000001, 0b10, 0b11000000, 99), 2, 3);
  assert.deepEqual([...steps], [1, 0, 0, 2, 3, 3, 3, 3, 3]);
  assert.equal(read, 3);
});

test("an octree with another number of leaves is refused", () => {
  assert.throws(() => octreeLeaves(Uint8Array.of(0b11), 1, 3), /damaged/);
});

test("no points at all", () => {
  assert.equal(octreeLeaves(new Uint8Array(0), 3, 0).steps.length, 0);
});

test("attributes follow the octree, plane by plane", () => {
  const scene = {
    quantisation: { depth: 1 },
    probabilityLevels: 64,
    distanceLevels: 63,
    colorBits: 8,
    before: { drawn: 2, attributes: ["labelLow", "labelHigh", "unobserved", "probability", "distance", "brightness"] },
  };
  const bytes = Uint8Array.of(0b11, 0xff, 2, 0xff, 1, 1, 0, 63, 0, 0, 63, 10, 250);
  const side = decodeSide(bytes, scene, "before");
  assert.deepEqual([...side.labels], [NO_LABEL, 258]);
  assert.deepEqual([...side.unobserved], [1, 0]);
  assert.deepEqual([...side.probability], [255, 0]);
  assert.deepEqual([...side.distance], [0, 255]);
  // Differences from the point before, modulo 256.
  assert.deepEqual([...side.colors], [10, 10, 10, 4, 4, 4]);
});

test("changes are drawn first, and every beginning is a sample", () => {
  const labels = Uint16Array.from({ length: 10000 }, (_, index) => (index % 10 === 0 ? 3 : NO_LABEL));
  const { order, changed } = drawingOrder(labels);
  assert.equal(changed, 1000);
  assert.equal(new Set(order).size, labels.length);
  assert.ok(order.subarray(0, changed).every((index) => labels[index] === 3));
  const mean = order.subarray(changed, changed + 900).reduce((sum, index) => sum + index, 0) / 900;
  assert.ok(Math.abs(mean - 5000) < 500);
  assert.deepEqual(drawingOrder(labels).order, order);
});

test("the spacing of a dense and of a sparse plane", () => {
  const random = randomNumbers(7);
  const code = ([x, y]) => {
    let mixed = 0n;
    for (let bit = 0; bit < 13; bit++) {
      mixed |= (BigInt((x >> bit) & 1) << BigInt(2 * bit)) | (BigInt((y >> bit) & 1) << BigInt(2 * bit + 1));
    }
    return mixed;
  };
  const plane = (left, spacing, count) => {
    const edge = spacing * Math.sqrt(count);
    return Array.from({ length: count }, () => [left + random() * edge, random() * edge].map(Math.floor));
  };
  const places = [...plane(0, 6, 8000), ...plane(4096, 24, 8000)].map((place) => [code(place), place]);
  places.sort((one, other) => (one[0] < other[0] ? -1 : 1));
  const spacing = localSpacing(Uint16Array.from(places.flatMap(([, [x, y]]) => [x, y, 500])));
  const median = (chosen) => {
    const values = [...spacing].filter((_, index) => chosen(places[index][1][0])).sort((a, b) => a - b);
    return 2 ** (values[values.length >> 1] / 16);
  };
  assert.ok(Math.abs(median((x) => x < 4096) / 6 - 1) < 0.3);
  assert.ok(Math.abs(median((x) => x >= 4096) / 24 - 1) < 0.3);
});

test("the spacing of few points is defined", () => {
  for (const count of [0, 1, 2, 9]) {
    const steps = Uint16Array.from({ length: 3 * count }, (_, index) => 100 * index);
    assert.equal(localSpacing(steps).length, count);
  }
});
