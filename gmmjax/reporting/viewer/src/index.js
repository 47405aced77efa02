// GmmjaxViewer: draws what gmmjax/reporting/packed_points.py packs into a page.
//
//   const viewer = await GmmjaxViewer.create({
//     scene,                            // the parsed JSON of the scene
//     points: { before, after },        // base64
//     canvases: { main, before, after } // <canvas> elements; before and after may be null
//     onPick(label) {},                 // a click on a point or on the number of a change
//   });
//   viewer.set({ color: "scan", clip: true });
//   viewer.focus(label | null | { rejected: index });
//   viewer.resetCamera(); viewer.setTheme("dark"); viewer.state; viewer.legend; await viewer.settled;

import { Viewer } from "./viewer.js";

export async function create({ scene, points, canvases, onPick }) {
  const viewer = new Viewer({ scene, canvases, onPick });
  await viewer.load(points);
  return viewer;
}
