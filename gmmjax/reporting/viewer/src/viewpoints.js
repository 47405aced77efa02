// From where everything, or a change, is looked at: what is in the middle, the direction to the eye and its distance.

import { add, bestDirection, between, bounds, framed, unit } from "./geometry.js";
import { cornersOf } from "./items.js";

// Degrees, from the upper to the lower edge of the view.
export const FIELD_OF_VIEW = 45;
export const HALF_HEIGHT = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
// Points of each cloud that are framed, and that may hide a change.
const FRAMED = 1500;
const OCCLUDERS = 6000;
// Around everything, and around the sphere that holds a change.
const MARGIN = 0.97;
const CLOSE_UP = 1.25;

/** Everything, from where one looks first. aspect: width to height of the view. */
export function overview(scene, items, clouds, aspect) {
  const samples = clouds.flatMap((cloud) => cloud.unchangedSample(FRAMED));
  const points = Array.from({ length: samples.length / 3 }, (_, index) => samples.slice(3 * index, 3 * index + 3));
  const whole = cornersOf(items.changes);
  if (!points.length && !whole.length) points.push([0, 0, 0]);
  const halfSizes = [MARGIN * HALF_HEIGHT * aspect, MARGIN * HALF_HEIGHT];
  const { centre, distance } = framed(points, whole, scene.towardsEye, scene.up, halfSizes);
  return { centre, direction: scene.towardsEye, distance };
}

/**
 * A change from the side from which most of it is seen. visible: `{ lower, upper }` of what is drawn beside it, which may
 * hide it.
 */
export function closeUp(scene, chosen, clouds, aspect, visible) {
  const boxes = cornersOf(chosen);
  const { lower, upper } = bounds(boxes);
  const centre = lower.map((low, axis) => (low + upper[axis]) / 2);
  const radius = Math.max(Math.hypot(...lower.map((low, axis) => (upper[axis] - low) / 2)), 1e-5);
  const distance = (CLOSE_UP * radius) / Math.sin(Math.atan(HALF_HEIGHT * Math.min(1, aspect)));
  const labels = chosen.map((item) => item.label ?? -1);
  const own = clouds.flatMap((cloud) => labels.flatMap((label) => cloud.pointsOf(label))).flat();
  // What is farther than the eye will be hides nothing.
  const near = {
    lower: visible.lower.map((low, axis) => Math.max(low, centre[axis] - distance)),
    upper: visible.upper.map((high, axis) => Math.min(high, centre[axis] + distance)),
  };
  const others = clouds.flatMap((cloud) => cloud.sampleOfOthers(labels, near, OCCLUDERS));
  const points = own.length ? own : boxes.flat();
  return { centre, direction: bestDirection(points, others, radius / 9, scene.towardsEye, scene.up), distance };
}

/** The way of the camera from one viewpoint to another. */
export class Flight {
  constructor(from, to, up, begin, duration) {
    Object.assign(this, { from, to, up, begin, duration });
  }

  /** Where it is at this time, and whether it has arrived. */
  at(now) {
    const passed = this.duration ? Math.min(1, (now - this.begin) / this.duration) : 1;
    const share = passed * passed * (3 - 2 * passed);
    const { from, to } = this;
    return {
      centre: from.centre.map((value, axis) => value + share * (to.centre[axis] - value)),
      direction: between(from.direction, to.direction, this.up, share),
      distance: from.distance * (to.distance / from.distance) ** share,
      arrived: passed === 1,
    };
  }
}

/** The viewpoint of a camera. */
export function viewpointOf(camera, target, fallback) {
  const [position, centre] = [camera.position.toArray(), target.toArray()];
  const offset = add(position, centre, -1);
  const distance = Math.hypot(...offset);
  return distance > 0 ? { centre, direction: unit(offset), distance } : fallback;
}
