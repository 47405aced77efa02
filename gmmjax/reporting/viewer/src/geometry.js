// Where the camera stands. Plain arrays and numbers, so that Node can test it.

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const add = (a, b, factor = 1) => a.map((value, axis) => value + factor * b[axis]);
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const unit = (a) => a.map((value) => value / Math.hypot(...a));

/** To the right on the screen, upwards on it, and towards the eye. */
export function screenAxes(towardsEye, up) {
  const across = unit(cross(up, towardsEye));
  return [across, cross(towardsEye, across), towardsEye];
}

function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.min(sorted.length - 1, Math.max(0, Math.round(share * (sorted.length - 1))))];
}

/**
 * What to look at, and from how far, so that all but the outermost hundredth of the points fill the view, and the
 * corners in `whole` are in it as well: `PlotCamera.framed` of gmmjax/reporting/camera.py.
 *
 * points, whole: arrays of [x, y, z]; halfSizes: half the width and height of the view at the distance 1 from the eye.
 */
export function framed(points, whole, towardsEye, up, halfSizes) {
  const axes = screenAxes(towardsEye, up);
  let centre = [0, 0, 0];
  let distance = 1e-6;
  const seenFrom = (all) => all.map((point) => axes.map((axis) => dot(add(point, centre, -1), axis)));
  const needed = ([x, y, z]) => Math.max(Math.abs(x) / halfSizes[0], Math.abs(y) / halfSizes[1]) + z;
  for (let round = 0; round < 3; round++) {
    const [seen, kept] = [seenFrom(points), seenFrom(whole)];
    const outermost = [...(seen.length ? [quantile(seen.map(needed), 0.99)] : []), ...kept.map(needed)];
    distance = Math.max(1.05 * Math.max(...outermost), 1e-6);
    for (const axis of [0, 1]) {
      const slopes = (all) => all.map((point) => point[axis] / Math.max(distance - point[2], 0.1 * distance));
      const inner = seen.length ? [quantile(slopes(seen), 0.01), quantile(slopes(seen), 0.99)] : [];
      const bounds = [...inner, ...slopes(kept)];
      const shift = (distance * (Math.min(...bounds) + Math.max(...bounds))) / 2;
      centre = add(centre, axes[axis], shift);
    }
  }
  return { centre, distance };
}

/** The eight corners of a box with `centre`, `extent` and its axes as the columns of `rotation`. */
export function corners({ centre, extent, rotation }) {
  return Array.from({ length: 8 }, (_, corner) => {
    const inside = [0, 1, 2].map((axis) => (((corner >> axis) & 1) - 0.5) * extent[axis]);
    return rotation.map((row, axis) => centre[axis] + dot(row, inside));
  });
}

/** The box along the axes around points. */
export function bounds(points) {
  const lower = [0, 1, 2].map((axis) => Math.min(...points.map((point) => point[axis])));
  const upper = [0, 1, 2].map((axis) => Math.max(...points.map((point) => point[axis])));
  return { lower, upper };
}

/** The box around a change in which points are drawn: scaled about its middle, nowhere thinner than a third of itself. */
export function clipBox({ lower, upper }, scale) {
  const half = lower.map((low, axis) => (upper[axis] - low) / 2);
  const longest = Math.max(...half);
  const centre = lower.map((low, axis) => low + half[axis]);
  return { centre, half: half.map((value) => scale * Math.max(value, longest / 3)) };
}

/** Directions from which things are looked at: around, from a little above and from well above. */
export function directions(towardsEye, up) {
  const level = add(towardsEye, up, -dot(towardsEye, up));
  const front = Math.hypot(...level) > 0.1 ? unit(level) : unit(cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
  const side = cross(up, front);
  const all = [];
  for (const elevation of [22, 42]) {
    const [high, wide] = [Math.sin((elevation * Math.PI) / 180), Math.cos((elevation * Math.PI) / 180)];
    for (let step = 0; step < 16; step++) {
      const angle = (step * Math.PI) / 8;
      const around = add(front.map((value) => value * Math.cos(angle)), side, Math.sin(angle));
      all.push(add(around.map((value) => value * wide), up, high));
    }
  }
  return all;
}

/**
 * From where most of a change is seen: the direction whose picture shows the most cells with a point of the change that
 * nothing hides. Of nearly equal ones, that nearest to where one looks from first.
 *
 * change, others: samples of the points of the change and of what may hide them, flat x, y, z; gap: the size of a cell,
 * somewhat above the spacing of the samples.
 */
export function bestDirection(change, others, gap, towardsEye, up) {
  let best = { direction: towardsEye, score: -Infinity };
  for (const direction of directions(towardsEye, up)) {
    const score = visibleCells(change, others, gap, screenAxes(direction, up)) * (1 + 0.35 * dot(direction, towardsEye));
    if (score > best.score) best = { direction, score };
  }
  return best.direction;
}

function visibleCells(change, others, gap, axes) {
  const nearest = new Map();
  const cell = (points, index) => {
    const point = [points[index], points[index + 1], points[index + 2]];
    const [x, y] = [Math.floor(dot(point, axes[0]) / gap), Math.floor(dot(point, axes[1]) / gap)];
    return [x * 8192 + y, dot(point, axes[2])];
  };
  for (let index = 0; index < change.length; index += 3) {
    const [key, depth] = cell(change, index);
    if (!(nearest.get(key) > depth)) nearest.set(key, depth);
  }
  const hidden = new Set();
  for (let index = 0; index < others.length; index += 3) {
    const [key, depth] = cell(others, index);
    if (depth > nearest.get(key) + 0.3 * gap) hidden.add(key);
  }
  return nearest.size - hidden.size;
}

/** A direction between two, turned about `up` the short way and lifted in step; share from 0 to 1. */
export function between(from, to, up, share) {
  const lift = (direction) => Math.asin(Math.max(-1, Math.min(1, dot(direction, up))));
  const level = (direction) => {
    const flat = add(direction, up, -dot(direction, up));
    return Math.hypot(...flat) > 1e-6 ? unit(flat) : null;
  };
  const end = level(to) ?? level(from) ?? [1, 0, 0];
  const start = level(from) ?? end;
  const angle = Math.atan2(dot(cross(start, end), up), dot(start, end)) * share;
  const elevation = lift(from) + (lift(to) - lift(from)) * share;
  const around = add(start.map((value) => value * Math.cos(angle)), cross(up, start), Math.sin(angle));
  return add(around.map((value) => value * Math.cos(elevation)), up, Math.sin(elevation));
}
