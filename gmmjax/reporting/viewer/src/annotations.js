// Which boxes, Gaussians, arrows, numbers and stations a view has.

import { lineColor, themeColors } from "./colors.js";
import { Overlay, principalAxes } from "./overlay.js";

// Of the lines of changes that are not looked at.
const DIMMED = 0.25;

/** Draws them; look: as in appearance.js; sides: the clouds that the view shows. */
export function annotate(scene, items, look, view, sides) {
  const overlay = new Overlay(view.context, view.projector(), view.pixelRatio, themeColors(look.theme));
  view.numbers = [];
  for (const change of items.changes.filter(({ side }) => sides.includes(side))) {
    const own = look.focus === null || look.labels.includes(change.label);
    if (look.clip && !own) continue;
    view.context.globalAlpha = own ? 1 : DIMMED;
    drawChange(scene, look.settings, overlay, view, change, own);
  }
  view.context.globalAlpha = 1;
  if (view.name === "main") drawArrows(items, look, overlay);
  drawRejected(items, look, overlay, sides);
  drawStations(items, look, overlay, sides);
}

function drawChange(scene, { boxes, gaussians }, overlay, view, change, own) {
  const color = lineColor(scene.kindColors[change.kind], overlay.theme);
  if (boxes) overlay.box(change, color);
  if (gaussians) overlay.gaussian(change.mean, principalAxes(change.covariance), color);
  if (!own || !(boxes || gaussians)) return;
  const place = overlay.number(String(change.label), change, scene.up, color);
  if (place) view.numbers.push([change.label, place]);
}

// From where each moved object was to where it is.
function drawArrows(items, look, overlay) {
  for (const change of items.changes) {
    if (change.partner === null || change.side !== "before") continue;
    if (look.focus !== null && !look.labels.includes(change.label)) continue;
    overlay.arrow(change.centre, items.changes[change.partner].centre);
  }
}

function drawRejected(items, look, overlay, sides) {
  items.rejected.forEach((candidate, index) => {
    const own = look.focus?.rejected === index;
    if (!own && (!look.settings.rejected || look.focus !== null)) return;
    if (!sides.includes(candidate.side)) return;
    overlay.box(candidate, overlay.theme.line, { width: own ? 2 : 1.2, dashed: true });
  });
}

// Not in the surroundings of a change: what is drawn there is of the change.
function drawStations(items, look, overlay, sides) {
  if (!look.settings.stations || look.clip) return;
  overlay.context.globalAlpha = look.focus === null ? 1 : DIMMED;
  for (const { side, number, position } of items.stations.filter((station) => sides.includes(station.side))) {
    overlay.station(position, `${side} ${number}`, side === "before");
  }
  overlay.context.globalAlpha = 1;
}
