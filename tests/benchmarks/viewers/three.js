import { BufferAttribute, BufferGeometry, PerspectiveCamera, Points, PointsMaterial, Scene, WebGLRenderer } from "three";

import { camera } from "./points.js";

export function start(canvas, clouds) {
  const renderer = new WebGLRenderer({ canvas, antialias: false });
  renderer.setSize(canvas.width, canvas.height, false);
  const scene = new Scene();
  const material = new PointsMaterial({ size: 2, sizeAttenuation: false, vertexColors: true });
  for (const { positions, colors } of clouds) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    geometry.setAttribute("color", new BufferAttribute(colors, 4, true));
    scene.add(new Points(geometry, material));
  }
  const eye = new PerspectiveCamera(45, canvas.width / canvas.height, 0.05, 10);
  eye.up.set(0, 0, 1);
  return (angle) => {
    eye.position.set(...camera(angle, 1).eye);
    eye.lookAt(0, 0, 0);
    renderer.render(scene, eye);
  };
}
