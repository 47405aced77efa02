// How points look: the uniforms of their shader.

import { Vector3 } from "three";

import { rgb, scaleColors, themeColors, UNOBSERVED } from "./colors.js";
import { MODES } from "./shaders.js";
import { HALF_HEIGHT } from "./viewpoints.js";
import { EVERYWHERE, withoutNearWalls } from "./walls.js";

// Of a point's disc, in spacings: few gaps are left between points at random places. And in pixels, at least and at most.
const DIAMETER = 1.7;
const PIXELS = [1.2, 24];

const vector = (color) => new Vector3(...rgb(color));

/**
 * look: `{ settings, theme, focus, labels, clip, walls, eye }` of the viewer; magnified: how much larger discs are where
 * only some of the points are drawn; resolution: of the picture, in that of the canvas.
 */
export function uniformsOf(scene, look, view, cloud, magnified, resolution) {
  const { settings, clip, labels } = look;
  const theme = themeColors(look.theme);
  const drawn = settings.cutaway ? withoutNearWalls(look.walls, look.eye) : EVERYWHERE;
  return {
    lower: cloud.lower,
    latticeStep: cloud.step,
    diameter: DIAMETER * magnified * cloud.step,
    pixels: (view.canvas.height * resolution) / 2 / HALF_HEIGHT,
    sizes: PIXELS.map((size) => Math.max(1, size * view.pixelRatio * resolution)),
    mode: MODES[settings.color],
    kinds: ["appeared", "disappeared", "moved"].map((kind) => vector(scene.kindColors[kind])),
    scale: scaleColors(settings.color, look.theme).map(vector),
    greys: [theme.dark, theme.bright].map(vector),
    unobservedColor: rgb(UNOBSERVED[0]),
    faded: rgb(theme.faded),
    focus: [labels[0] ?? -1, labels[1] ?? -1],
    isolating: look.focus !== null,
    clipping: clip !== null,
    clipCentre: clip?.centre ?? [0, 0, 0],
    clipHalf: clip?.half ?? [0, 0, 0],
    drawnLower: drawn.lower,
    drawnUpper: drawn.upper,
    showUnchanged: settings.unchanged,
    showUnobserved: settings.unobserved,
    fading: settings.opacityByProbability,
  };
}
