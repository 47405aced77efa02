import createRegl from "regl";

import { camera, FRAGMENT, VERTEX } from "./points.js";

export function start(canvas, clouds) {
  const regl = createRegl({ canvas, attributes: { antialias: false } });
  const draws = clouds.map(({ positions, colors }) =>
    regl({
      vert: VERTEX,
      frag: FRAGMENT,
      attributes: { position: { buffer: regl.buffer(positions), size: 3 }, color: { buffer: regl.buffer(colors), size: 4, normalized: true } },
      uniforms: { view: regl.prop("view"), projection: regl.prop("projection") },
      count: positions.length / 3,
      primitive: "points",
    }),
  );
  return (angle) => {
    regl.clear({ color: [0, 0, 0, 0], depth: 1 });
    draws.forEach((draw) => draw(camera(angle, canvas.width / canvas.height)));
  };
}
