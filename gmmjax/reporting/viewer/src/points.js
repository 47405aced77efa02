// The points of one cloud on the graphics card, in an order of which every beginning is a sample.

import * as three from "three";

import { drawingOrder, NO_LABEL } from "./decode.js";
import { pointFragment, pointVertex } from "./shaders.js";

const KINDS = ["appeared", "disappeared", "moved"];
// So many points of a change are enough to frame it, and to find the side from which it is seen.
const SAMPLES = 400;
// The widest spacing that discs fill, in mean spacings of the cloud.
const WIDEST = 1;
// The grey of scans without colours or intensity.
const PLAIN = 150;

/** One cloud: what it draws with, and samples of the points of each change. */
export class CloudPoints {
  constructor(decoded, scene, side, unitScale) {
    const { order, changed } = drawingOrder(decoded.labels);
    this.count = decoded.count;
    this.changed = changed;
    this.step = scene.quantisation.step * unitScale;
    this.lower = scene.quantisation.lower.map((value) => value * unitScale);
    const places = new Uint16Array(4 * this.count);
    const scan = new Uint8Array(4 * this.count);
    const measured = new Uint8Array(4 * this.count);
    // Single points far from all others are not drawn as large as that.
    const widest = 16 * Math.log2(Math.max(1, (WIDEST * scene[side].spacing) / scene.quantisation.step));
    const kinds = scene.changes.map(({ kind }) => 2 * (KINDS.indexOf(kind) + 1));
    this.places = places;
    this.samples = new Map();
    const { steps, spacing, labels, colors, probability, distance, unobserved } = decoded;
    for (let to = 0; to < this.count; to++) {
      const from = order[to];
      const label = labels[from];
      places[4 * to] = steps[3 * from];
      places[4 * to + 1] = steps[3 * from + 1];
      places[4 * to + 2] = steps[3 * from + 2];
      places[4 * to + 3] = label;
      scan[4 * to] = colors ? colors[3 * from] : PLAIN;
      scan[4 * to + 1] = colors ? colors[3 * from + 1] : PLAIN;
      scan[4 * to + 2] = colors ? colors[3 * from + 2] : PLAIN;
      scan[4 * to + 3] = probability[from];
      measured[4 * to] = distance ? distance[from] : 0;
      measured[4 * to + 1] = (unobserved[from] ? 1 : 0) + (label === NO_LABEL ? 0 : (kinds[label] ?? 0));
      measured[4 * to + 2] = Math.min(spacing[from], widest);
      if (label !== NO_LABEL) this.#keepSample(label, to);
    }
    this.geometry = new three.BufferGeometry();
    this.geometry.setAttribute("position", new three.BufferAttribute(places, 4));
    this.geometry.setAttribute("scan", new three.BufferAttribute(scan, 4, true));
    this.geometry.setAttribute("measured", new three.BufferAttribute(measured, 4));
  }

  #keepSample(label, index) {
    const kept = this.samples.get(label);
    if (!kept) this.samples.set(label, [index]);
    else if (kept.length < SAMPLES) kept.push(index);
  }

  /** Where a point is, in the unit of the drawing. */
  point(index) {
    return [0, 1, 2].map((axis) => this.lower[axis] + (this.places[4 * index + axis] + 0.5) * this.step);
  }

  /** A sample of the points of a change, an array of [x, y, z]. */
  pointsOf(label) {
    return (this.samples.get(label) ?? []).map((index) => this.point(index));
  }

  /** At most so many of the points of no change, flat x, y, z. */
  unchangedSample(most) {
    const end = Math.min(this.count, this.changed + most);
    return Array.from({ length: Math.max(0, end - this.changed) }, (_, index) => this.point(this.changed + index)).flat();
  }

  /** At most so many of the points that are not of these changes, between the corners of a box; flat x, y, z. */
  sampleOfOthers(labels, { lower, upper }, most) {
    const found = [];
    const [low, high] = [lower, upper].map((corner) => corner.map((value, axis) => (value - this.lower[axis]) / this.step - 0.5));
    const { places } = this;
    for (let place = 0; place < 4 * this.count && found.length < 3 * most; place += 4) {
      if (places[place] < low[0] || places[place] > high[0]) continue;
      if (places[place + 1] < low[1] || places[place + 1] > high[1]) continue;
      if (places[place + 2] < low[2] || places[place + 2] > high[2]) continue;
      if (!labels.includes(places[place + 3])) found.push(...this.point(place / 4));
    }
    return found;
  }

  /** The parts of the buffers to draw when only a share of the points is: of the changes more than of the others. */
  parts(most) {
    if (this.count <= most) return [[0, this.count]];
    const changed = Math.min(this.changed, Math.floor(0.7 * most));
    return [[0, changed], [this.changed, Math.min(most - changed, this.count - this.changed)]];
  }
}

/** What all clouds are drawn with; its uniforms change from view to view. */
export function pointMaterial() {
  const value = (initial) => ({ value: initial });
  return new three.RawShaderMaterial({
    glslVersion: three.GLSL3,
    vertexShader: pointVertex,
    fragmentShader: pointFragment,
    blending: three.NoBlending,
    uniforms: {
      lower: value([0, 0, 0]),
      latticeStep: value(1),
      diameter: value(1),
      pixels: value(1),
      sizes: value([1, 30]),
      mode: value(0),
      kinds: value([]),
      scale: value([]),
      greys: value([]),
      unobservedColor: value([0, 0, 0]),
      faded: value([0, 0, 0]),
      focus: value([-1, -1]),
      isolating: value(false),
      clipping: value(false),
      clipCentre: value([0, 0, 0]),
      clipHalf: value([0, 0, 0]),
      drawnLower: value([0, 0, 0]),
      drawnUpper: value([0, 0, 0]),
      showUnchanged: value(true),
      showUnobserved: value(true),
      fading: value(false),
      plain: value(false),
      hiddenOnly: value(false),
    },
  });
}
