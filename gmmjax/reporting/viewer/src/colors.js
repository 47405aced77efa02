// The colours of the points, and the legends that explain them. All can be told apart by colour-blind readers.

// Of probabilities what is certainly unchanged has the grey of the background; of distances (ColorBrewer's RdBu, which
// colour-blind readers can tell apart) what lies where it lay.
const SCALES = {
  light: {
    probability: ["#cfd1d4", "#f3d9a0", "#fdb863", "#f08a24", "#d25c0a", "#9c3d06", "#5e2305"],
    distance: ["#2166ac", "#4393c3", "#92c5de", "#cfd1d4", "#f4a582", "#d6604d", "#b2182b"],
  },
  dark: {
    probability: ["#454b53", "#6d5030", "#9a5c1c", "#cc7415", "#f09a35", "#fdc777", "#fff0c4"],
    distance: ["#5aa9f5", "#4682bd", "#3a5f86", "#4a5058", "#8f5a45", "#c96f4a", "#f58a5a"],
  },
};
export const UNOBSERVED = ["#8d7fa8", "#6f6289"];

const THEMES = {
  light: { dark: "#70767e", bright: "#d3d6da", faded: "#e4e6e9", line: "#3c444d", halo: "#ffffff", lifted: 0 },
  dark: { dark: "#4a5058", bright: "#a9aeb5", faded: "#2c3137", line: "#c3c9d0", halo: "#15181c", lifted: 0.45 },
};

/** Red, green and blue from 0 to 1. */
export function rgb(color) {
  return [1, 3, 5].map((start) => parseInt(color.slice(start, start + 2), 16) / 255);
}

/** A colour for thin lines and numbers, which on a dark page must be brighter. */
export function lineColor(color, theme) {
  const lifted = rgb(color).map((value) => Math.round(255 * (value + theme.lifted * (1 - value))));
  return `rgb(${lifted.join(",")})`;
}

export function themeColors(name) {
  const theme = THEMES[name];
  if (!theme) throw new Error(`the theme is "light" or "dark", not ${JSON.stringify(name)}`);
  return theme;
}

/** Seven colours of a scale from its lowest to its highest value; of modes without one those of the probability. */
export function scaleColors(mode, theme) {
  return SCALES[theme][mode === "distance" ? "distance" : "probability"];
}

/**
 * What the colours mean: `{ type: "scale", min, max, unit, colors }` from the lowest to the highest value,
 * `{ type: "kinds", entries: [{ name, color }] }`, or `{ type: "scan" }` where they are the scan's own.
 */
export function legend(mode, scene, theme) {
  if (mode === "probability") return { type: "scale", min: 0, max: 1, unit: null, colors: scaleColors(mode, theme) };
  if (mode === "distance") {
    const limit = scene.distanceLimit;
    return { type: "scale", min: -limit, max: limit, unit: scene.unit, colors: scaleColors(mode, theme) };
  }
  if (mode === "scan") return { type: "scan" };
  const present = Object.entries(scene.kindColors).filter(([kind]) => scene.changes.some((one) => one.kind === kind));
  const entries = present.map(([name, color]) => ({ name, color }));
  entries.push({ name: "unchanged", color: themeColors(theme).bright });
  if (scene.has.unobserved) entries.push({ name: "not observed", color: UNOBSERVED[0] });
  return { type: "kinds", entries };
}
