// Reads what gmmjax/reporting/packed_points.py writes.

export const NO_LABEL = 0xffff;

/** The bytes of base64 text. */
export function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let index = 0; index < bytes.length; index++) bytes[index] = characters.charCodeAt(index);
  return bytes;
}

/** Undoes zlib.compress. */
export async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * The leaves of an octree that is given breadth first, a byte for each node: bit i says whether there is a child i.
 * Returns their coordinates on the lattice, x, y, z in turn, and how many bytes the octree had.
 */
export function octreeLeaves(bytes, depth, count) {
  let nodes = new Uint16Array(count ? 3 : 0);
  let read = 0;
  for (let level = 0; level < depth && count; level++) {
    const parents = nodes.length / 3;
    const children = new Uint16Array(3 * Math.min(count, 8 * parents));
    let end = 0;
    for (let parent = 0; parent < parents; parent++) {
      const occupied = bytes[read++];
      const x = 2 * nodes[3 * parent];
      const y = 2 * nodes[3 * parent + 1];
      const z = 2 * nodes[3 * parent + 2];
      for (let child = 0; child < 8; child++) {
        if (!(occupied & (1 << child))) continue;
        children[end++] = x + (child & 1);
        children[end++] = y + ((child >> 1) & 1);
        children[end++] = z + (child >> 2);
      }
    }
    nodes = children.subarray(0, end);
  }
  if (nodes.length !== 3 * count) throw new Error(`the page is damaged: ${nodes.length / 3} points instead of ${count}`);
  return { steps: nodes, read };
}

function summed(differences, signed) {
  const values = signed ? new Int8Array(differences.length) : new Uint8Array(differences.length);
  let value = 0;
  for (let index = 0; index < values.length; index++) {
    value += differences[index];
    values[index] = value;
  }
  return values;
}

/** From 1 to a number of levels to 1 to 255; 0 stays. */
function stretched(plane, levels) {
  return plane.map((level) => (level ? 1 + Math.round(((level - 1) * 254) / (levels - 1)) : 0));
}

/** Red, green and blue, three bytes for each point, or null where the scan has neither colours nor intensity. */
function scanColors(planes, bits) {
  if (!planes.brightness) return null;
  const shift = 8 - bits;
  const half = shift ? 1 << (shift - 1) : 0;
  const brightness = summed(planes.brightness, false);
  const orange = planes.orange && summed(planes.orange, true);
  const green = planes.green && summed(planes.green, true);
  const colors = new Uint8ClampedArray(3 * brightness.length);
  for (let index = 0; index < brightness.length; index++) {
    // The inverse of: brightness (r + 2 g + b) / 4, orange (r - b) / 2, green (2 g - r - b) / 4.
    const middle = (brightness[index] << shift) + half;
    const toOrange = orange ? (orange[index] << shift) + half : 0;
    const toGreen = green ? (green[index] << shift) + half : 0;
    colors[3 * index] = middle - toGreen + toOrange;
    colors[3 * index + 1] = middle + toGreen;
    colors[3 * index + 2] = middle - toGreen - toOrange;
  }
  return colors;
}

/**
 * The points of one cloud: `steps` on the lattice, `spacing` (see localSpacing), `labels`, `unobserved` (0 or 1), `probability` (0 to 255),
 * `distance` (1 for minus the limit to 255 for the limit, 0 for none; or null), `colors` (or null).
 */
export function decodeSide(bytes, scene, side) {
  const { drawn, attributes } = scene[side];
  const { steps, read } = octreeLeaves(bytes, scene.quantisation.depth, drawn);
  const planes = {};
  attributes.forEach((name, index) => {
    planes[name] = bytes.subarray(read + index * drawn, read + (index + 1) * drawn);
  });
  const labels = new Uint16Array(drawn);
  const probability = new Uint8Array(drawn);
  const scale = 255 / (scene.probabilityLevels - 1);
  for (let index = 0; index < drawn; index++) {
    labels[index] = planes.labelLow[index] | (planes.labelHigh[index] << 8);
    probability[index] = Math.round(planes.probability[index] * scale);
  }
  return {
    count: drawn,
    steps,
    spacing: localSpacing(steps),
    labels,
    probability,
    unobserved: planes.unobserved,
    distance: planes.distance ? stretched(planes.distance, scene.distanceLevels) : null,
    colors: scanColors(planes, scene.colorBits),
  };
}

// The smallest cell of the octree that holds so many points in succession has about twice as many.
const GROUP = 8;
const IN_CELL = 2 * GROUP;
// In the order of the octree, over which the spacing is averaged.
const NEIGHBOURS = 24;

/**
 * The spacing around each point of a scan, which is denser near the scanner: `16 * log2` of it in steps of the lattice,
 * 0 to 255. Taken from points that follow each other in the order of the octree.
 */
export function localSpacing(steps) {
  const count = steps.length / 3;
  const bits = new Float32Array(count);
  const group = Math.min(GROUP, count - 1);
  for (let first = 0; first < count; first++) {
    const a = 3 * Math.min(first, count - 1 - group);
    const b = a + 3 * group;
    const differing = (steps[a] ^ steps[b]) | (steps[a + 1] ^ steps[b + 1]) | (steps[a + 2] ^ steps[b + 2]);
    bits[first] = 32 - Math.clz32(differing);
  }
  const logarithms = new Uint8Array(count);
  // Groups that lie across the border of a large cell say nothing: of those that hold the point, the smallest counts.
  const least = new Float64Array(count + 1);
  for (let index = 0; index < count; index++) {
    let smallest = bits[index];
    for (let back = 1; back <= group && back <= index; back++) smallest = Math.min(smallest, bits[index - back]);
    least[index + 1] = least[index] + smallest;
  }
  const shift = Math.log2(IN_CELL) / 2;
  for (let index = 0; index < count; index++) {
    const [begin, end] = [Math.max(0, index - NEIGHBOURS), Math.min(count, index + NEIGHBOURS + 1)];
    const mean = (least[end] - least[begin]) / (end - begin);
    logarithms[index] = Math.max(0, Math.min(255, Math.round(16 * (mean - shift))));
  }
  return logarithms;
}

/** Numbers from 0 to 1 that are the same at each call (mulberry32). */
export function randomNumbers(seed) {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}

/** An order of the points in which every beginning is a sample of them: those of changes first, then the others. */
export function drawingOrder(labels) {
  const order = new Uint32Array(labels.length);
  let changed = 0;
  for (const label of labels) changed += label !== NO_LABEL;
  let [nextChanged, nextOther] = [0, changed];
  for (let index = 0; index < labels.length; index++) {
    order[labels[index] !== NO_LABEL ? nextChanged++ : nextOther++] = index;
  }
  const random = randomNumbers(1);
  for (const [begin, end] of [[0, changed], [changed, labels.length]]) {
    for (let last = end - 1; last > begin; last--) {
      const other = begin + Math.floor(random() * (last - begin + 1));
      const moved = order[last];
      order[last] = order[other];
      order[other] = moved;
    }
  }
  return { order, changed };
}
