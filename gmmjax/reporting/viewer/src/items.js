// The changes, the rejected candidates and the stations of the scene, in the unit of the drawing.

import { bounds, clipBox, corners } from "./geometry.js";

export class Items {
  /** scale: from the unit of the clouds to that of the drawing. */
  constructor(scene, scale) {
    this.changes = scene.changes.map((change) => scaled(change, scale));
    this.rejected = scene.rejected.map((candidate) => scaled(candidate, scale));
    this.stations = scene.stations.map((own) => ({ ...own, position: own.position.map((value) => value * scale) }));
  }

  /** What a focus is on: a moved object is two changes. */
  of(focus) {
    if (focus === null) return [];
    const item = typeof focus === "object" ? this.rejected[focus.rejected] : this.changes[focus];
    if (!item) {
      const missing = typeof focus === "object" ? `rejected candidate ${JSON.stringify(focus.rejected)}` : `change ${JSON.stringify(focus)}`;
      throw new Error(`there is no ${missing}`);
    }
    return (item.partner ?? null) === null ? [item] : [item, this.changes[item.partner]];
  }

  /** The labels of these changes; a rejected candidate has none. */
  labelsOf(focus) {
    return this.of(focus).flatMap((item) => item.label ?? []);
  }

  /** The box around a focus, so many times its size; null where there is none. */
  clipOf(focus, size) {
    return focus === null ? null : clipBox(bounds(cornersOf(this.of(focus))), size);
  }
}

/** The corners of the boxes of all of them. */
export function cornersOf(items) {
  return items.flatMap(corners);
}

function scaled(item, scale) {
  const by = (values, factor = scale) => values.map((value) => value * factor);
  const box = { ...item, centre: by(item.centre), extent: by(item.extent) };
  if (!item.covariance) return box;
  return { ...box, mean: by(item.mean), covariance: item.covariance.map((row) => by(row, scale * scale)) };
}
