// One canvas: its camera, its controls, and the pictures that are drawn for it.

import * as three from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

// Finer screens are drawn at this many pixels to one of the page: more cost time and are hardly seen.
const FINEST = 2;
// Pixels that a click may move by.
const STEADY = 5;

export class View {
  /** name: "main", "before" or "after"; camera, target: shared by all views. */
  constructor(name, canvas, camera, target) {
    this.name = name;
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.camera = camera.clone();
    this.controls = new OrbitControls(camera, canvas);
    this.controls.target = target;
    this.controls.enableDamping = false;
    this.controls.zoomToCursor = name === "main";
    this.onScreen = true;
    // The picture that is shown and the one that is being drawn, and of what they are.
    this.front = null;
    this.back = null;
    this.frontKey = null;
    this.backKey = null;
    // Where the numbers of the changes stand: [label, [left, top, right, bottom]].
    this.numbers = [];
  }

  /** Calls back with the place of a click on the canvas; a drag is none. */
  onClick(callback) {
    let pressed = null;
    this.canvas.addEventListener("pointerdown", (event) => {
      pressed = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null;
    });
    this.canvas.addEventListener("pointerup", (event) => {
      if (!pressed || !event.isPrimary) return;
      const moved = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]);
      pressed = null;
      if (moved > STEADY) return;
      const { left, top, width, height } = this.canvas.getBoundingClientRect();
      callback(
        ((event.clientX - left) / width) * this.canvas.width,
        ((event.clientY - top) / height) * this.canvas.height,
      );
    });
  }

  get pixelRatio() {
    return Math.min(window.devicePixelRatio || 1, FINEST);
  }

  get drawn() {
    return this.onScreen && this.canvas.clientWidth > 0 && this.canvas.clientHeight > 0;
  }

  /** Gives the canvas the size that it has on the page. */
  fit(drawing) {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map((length) =>
      Math.max(1, Math.round(length * this.pixelRatio)),
    );
    if (this.front?.width === width && this.front?.height === height) return;
    this.dispose();
    this.front = drawing.target(width, height);
    this.back = drawing.target(width, height);
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
  }

  dispose() {
    for (const target of [this.front, this.back]) {
      target?.depthTexture?.dispose();
      target?.dispose();
    }
    this.front = this.back = this.frontKey = this.backKey = null;
  }

  swap() {
    [this.front, this.back] = [this.back, this.front];
    [this.frontKey, this.backKey] = [this.backKey, this.frontKey];
  }

  /** Looks where the shared camera looks. */
  follow(camera) {
    this.camera.position.copy(camera.position);
    this.camera.quaternion.copy(camera.quaternion);
    this.camera.near = camera.near;
    this.camera.far = camera.far;
    this.camera.aspect = this.canvas.width / this.canvas.height;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }

  /** From a point to its place on the canvas, or null where it is behind the eye. */
  projector() {
    const matrix = new three.Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse);
    const [e, { width, height }] = [matrix.elements, this.canvas];
    return ([x, y, z]) => {
      const w = e[3] * x + e[7] * y + e[11] * z + e[15];
      if (w < this.camera.near) return null;
      const across = (e[0] * x + e[4] * y + e[8] * z + e[12]) / w;
      const upwards = (e[1] * x + e[5] * y + e[9] * z + e[13]) / w;
      return [((across + 1) / 2) * width, ((1 - upwards) / 2) * height];
    };
  }
}
