import { camera } from "./points.js";

// plotly.js itself is a script of the page, as it was in the reports: that of the Python package.
export async function start(canvas, clouds) {
  const pane = document.createElement("div");
  Object.assign(pane.style, { width: `${canvas.width}px`, height: `${canvas.height}px` });
  canvas.replaceWith(pane);
  const coordinate = (positions, axis) => Float32Array.from({ length: positions.length / 3 }, (_, index) => positions[3 * index + axis]);
  const eye = (angle) => ({ "scene.camera.eye": Object.fromEntries(camera(angle, 1).eye.map((value, axis) => ["xyz"[axis], value])) });
  const traces = clouds.map(({ positions }, index) => ({
    type: "scatter3d",
    mode: "markers",
    hoverinfo: "skip",
    marker: { size: 2, color: index ? "#70a08c" : "#a08c70", line: { width: 0 } },
    x: coordinate(positions, 0), y: coordinate(positions, 1), z: coordinate(positions, 2),
  }));
  const axis = { visible: false };
  const layout = { margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, scene: { xaxis: axis, yaxis: axis, zaxis: axis, aspectmode: "data" } };
  await Plotly.newPlot(pane, traces, layout, { displayModeBar: false });
  return (angle) => Plotly.relayout(pane, eye(angle));
}
