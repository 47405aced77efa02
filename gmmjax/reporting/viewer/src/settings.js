// What can be set in the viewer, and with what it begins; index.js says what each does.

export const SIDES = ["before", "after"];
export const DEFAULTS = {
  before: true,
  after: true,
  unchanged: true,
  unobserved: true,
  boxes: true,
  gaussians: false,
  rejected: false,
  stations: true,
  color: "kind",
  opacityByProbability: false,
  blink: false,
  cutaway: true,
  clip: false,
  clipScale: 1.8,
};
const COLORS = ["kind", "scan", "probability", "distance"];
// What is drawn over the points, which stay as they are.
const DRAWN_OVER = ["boxes", "gaussians", "rejected", "stations"];

/** Throws an error unless these are settings. */
export function checkSettings(changed) {
  for (const [name, value] of Object.entries(changed)) {
    if (!Object.hasOwn(DEFAULTS, name)) throw new Error(`the viewer has no setting ${JSON.stringify(name)}`);
    if (typeof value !== typeof DEFAULTS[name]) throw new Error(`${name} is a ${typeof DEFAULTS[name]}`);
  }
  if (changed.color !== undefined && !COLORS.includes(changed.color)) {
    throw new Error(`color is "kind", "scan", "probability" or "distance", not ${JSON.stringify(changed.color)}`);
  }
}

/** Whether the points look the same after a change of these settings. */
export function keepsPoints(changed) {
  return Object.keys(changed).every((name) => DRAWN_OVER.includes(name));
}
