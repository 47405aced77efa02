// Walls and ceilings of a room that is looked at from outside.

// Of the longest edge of the room: how thick a wall is, with what leans and hangs on it.
const THICKNESS = 0.025;
// A wall covers this share of the cells of its side of the room, and has less than this share of all points: a scene
// that is flat is no wall.
const COVERED = 0.65;
const LARGEST = 0.4;
const CELLS = 10;
// Far outside of the drawing, whose longest edge is 1; shaders need not know infinity.
const FAR = 1e6;
export const EVERYWHERE = Object.freeze({ lower: [-FAR, -FAR, -FAR], upper: [FAR, FAR, FAR] });
// Of the points may lie further out, on either side, along each axis.
const STRAY = 0.002;

/**
 * Where walls end inwards: `{ lower, upper }`, along each axis the place from which on outwards there is a wall, far
 * outside where there is none. Only those along the axes of the clouds are found, which ceilings always are.
 *
 * points: a sample of all that is unchanged, flat x, y, z.
 */
export function walls(points) {
  if (points.length < 3 * CELLS * CELLS) return EVERYWHERE;
  const found = { lower: [...EVERYWHERE.lower], upper: [...EVERYWHERE.upper] };
  const ranges = [0, 1, 2].map((axis) => innerRange(points, axis));
  const thickness = THICKNESS * Math.max(...ranges.map(([low, high]) => high - low));
  for (const axis of [0, 1, 2]) {
    const [low, high] = ranges[axis];
    if (high - low < 6 * thickness) continue;
    if (isWall(points, axis, (value) => value < low + thickness, ranges)) found.lower[axis] = low + thickness;
    if (isWall(points, axis, (value) => value > high - thickness, ranges)) found.upper[axis] = high - thickness;
  }
  return found;
}

/** The part of space that is drawn from an eye: without the walls between it and the room. */
export function withoutNearWalls({ lower, upper }, eye) {
  return {
    lower: lower.map((place, axis) => (eye[axis] < place ? place : -FAR)),
    upper: upper.map((place, axis) => (eye[axis] > place ? place : FAR)),
  };
}

function innerRange(points, axis) {
  const values = Float64Array.from({ length: points.length / 3 }, (_, index) => points[3 * index + axis]).sort();
  const stray = Math.floor(STRAY * values.length);
  return [values[stray], values[values.length - 1 - stray]];
}

function isWall(points, axis, outside, ranges) {
  const [first, second] = [0, 1, 2].filter((other) => other !== axis);
  const cells = new Set();
  let count = 0;
  const cell = (value, [low, high]) => Math.floor((CELLS * (value - low)) / (high - low));
  for (let index = 0; index < points.length; index += 3) {
    if (!outside(points[index + axis])) continue;
    count++;
    const [column, row] = [first, second].map((other) => cell(points[index + other], ranges[other]));
    if (column >= 0 && column < CELLS && row >= 0 && row < CELLS) cells.add(column * CELLS + row);
  }
  return cells.size >= COVERED * CELLS * CELLS && 3 * count < LARGEST * points.length;
}
