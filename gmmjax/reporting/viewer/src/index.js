// GmmjaxViewer: draws what gmmjax/reporting/packed_points.py packs into a page.
//
//   const viewer = await GmmjaxViewer.create({
//     scene,                            // the parsed JSON of the scene
//     points: { before, after },        // base64
//     canvases: { main, before, after } // <canvas> elements; before and after may be null
//     onPick(label) {},                 // a click on a point or on the number of a change
//   });
//   viewer.set({ color: "scan", clip: true });
//   viewer.focus(label | null | { rejected: index });  // looks at it, and dims all else; null: at everything
//   viewer.resetCamera(); viewer.setTheme("dark"); viewer.state; viewer.legend; await viewer.settled;
//
// Settings, with their first values:
//   before, after: true               the clouds of the main view
//   unchanged, unobserved: true       points that are drawn at all; those of changes always are
//   boxes: true, gaussians: false     of the changes, with their numbers
//   rejected: false                   boxes of the candidates that were turned down
//   stations: true                    where the sensors stood, as far as that was recognised
//   color: "kind"                     or "scan", "probability", "distance"; `viewer.legend` says what the colours mean
//   opacityByProbability: false       the less probable, the fewer points
//   blink: false                      the main view shows the two clouds in turn, once a second; every four seconds
//                                     where the system asks for less motion
//   cutaway: true                     walls and ceilings between the eye and the inside of a room are not drawn
//   clip: false, clipScale: 1.8       only a box around what is focused is drawn, so many times its size
//
// The canvases get a two-dimensional context each; one hidden canvas draws for all of them with WebGL 2. Without WebGL 2,
// and while the browser has taken its context away, a message with the class "viewer-message" stands in their place.

import { Viewer } from "./viewer.js";

export async function create({ scene, points, canvases, onPick }) {
  const viewer = new Viewer({ scene, canvases, onPick });
  await viewer.load(points);
  return viewer;
}
