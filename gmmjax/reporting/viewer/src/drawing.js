// The one graphics context that draws all views: points into a picture with depth, shaded, copied to the view's canvas.

import * as three from "three";

import { MODES, shadingFragment, shadingVertex } from "./shaders.js";
import { pointMaterial } from "./points.js";

// Points that are drawn between two looks at the clock.
const CHUNK = 250000;

export class Drawing {
  constructor() {
    this.canvas = document.createElement("canvas");
    const context = this.canvas.getContext("webgl2", { antialias: false, depth: false, alpha: true });
    if (!context) throw new Error("no WebGL 2");
    this.renderer = new three.WebGLRenderer({ canvas: this.canvas, context });
    this.renderer.autoClear = false;
    this.renderer.outputColorSpace = three.LinearSRGBColorSpace;
    this.renderer.setPixelRatio(1);
    this.material = pointMaterial();
    // What is hidden of the changes shines through.
    this.hiddenMaterial = pointMaterial();
    this.hiddenMaterial.uniforms = { ...this.material.uniforms, hiddenOnly: { value: true } };
    this.hiddenMaterial.depthFunc = three.GreaterDepth;
    this.hiddenMaterial.depthWrite = false;
    this.points = new three.Points(new three.BufferGeometry(), this.material);
    this.points.frustumCulled = false;
    this.scene = new three.Scene();
    this.scene.matrixWorldAutoUpdate = false;
    this.scene.add(this.points);
    this.shading = new three.RawShaderMaterial({
      glslVersion: three.GLSL3,
      vertexShader: shadingVertex,
      fragmentShader: shadingFragment,
      depthTest: false,
      depthWrite: false,
      blending: three.NoBlending,
      uniforms: {
        colors: { value: null },
        depths: { value: null },
        corner: { value: [0, 0] },
        size: { value: [1, 1] },
        range: { value: [1, 2] },
        radius: { value: 1 },
        strength: { value: 9 },
      },
    });
    const triangle = new three.BufferGeometry();
    triangle.setAttribute("position", new three.BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    const mesh = new three.Mesh(triangle, this.shading);
    mesh.frustumCulled = false;
    this.shadingScene = new three.Scene();
    this.shadingScene.add(mesh);
    this.flatCamera = new three.Camera();
    this.pickTarget = this.target(15, 15);
  }

  /** A picture with depth. */
  target(width, height) {
    return new three.WebGLRenderTarget(width, height, {
      minFilter: three.NearestFilter,
      magFilter: three.NearestFilter,
      depthTexture: new three.DepthTexture(width, height, three.UnsignedIntType),
    });
  }

  /** Empties a picture; `share` of its width and height, from the lower left corner on, will be drawn. */
  clear(target, share = 1) {
    const [width, height] = [Math.ceil(share * target.width), Math.ceil(share * target.height)];
    target.viewport.set(0, 0, width, height);
    target.scissor.set(0, 0, width, height);
    this.renderer.setRenderTarget(target);
    this.renderer.setClearColor(0x000000, 0);
    this.renderer.clear();
  }

  set(values) {
    for (const [name, value] of Object.entries(values)) this.material.uniforms[name].value = value;
    this.material.uniformsNeedUpdate = this.hiddenMaterial.uniformsNeedUpdate = true;
  }

  /** Draws part of a cloud; or what is hidden of it. */
  part(target, camera, cloud, [start, count], material = this.material) {
    this.renderer.setRenderTarget(target);
    this.points.material = material;
    this.points.geometry = cloud.geometry;
    cloud.geometry.setDrawRange(start, count);
    if (count > 0) this.renderer.render(this.scene, camera);
  }

  /** Draws the points of changes that lie behind others, as a pattern. */
  hidden(target, camera, cloud, most) {
    this.part(target, camera, cloud, [0, Math.min(most, cloud.changed)], this.hiddenMaterial);
  }

  /** Shades the pictures of views, side by side, so that there is one to wait for, and copies them to their canvases. */
  show(views) {
    const sizes = views.map(({ front }) => [front.viewport.z, front.viewport.w]);
    const [width, height] = [sizes.reduce((sum, [own]) => sum + own, 0), Math.max(...sizes.map(([, own]) => own))];
    if (this.canvas.width !== width || this.canvas.height !== height) this.renderer.setSize(width, height, false);
    this.renderer.setRenderTarget(null);
    let left = 0;
    const places = sizes.map(([own]) => (left += own) - own);
    views.forEach((view, index) => this.#shade(view, places[index], sizes[index]));
    views.forEach(({ context, canvas }, index) => {
      const [own, high] = sizes[index];
      context.clearRect(0, 0, canvas.width, canvas.height);
      context.drawImage(this.canvas, places[index], height - high, own, high, 0, 0, canvas.width, canvas.height);
    });
  }

  #shade({ front, camera, pixelRatio }, left, [width, height]) {
    this.renderer.setViewport(left, 0, width, height);
    const { uniforms } = this.shading;
    uniforms.colors.value = front.texture;
    uniforms.depths.value = front.depthTexture;
    uniforms.corner.value = [left, 0];
    uniforms.size.value = [width, height];
    uniforms.range.value = [camera.near, camera.far];
    uniforms.radius.value = Math.max(1, (1.4 * pixelRatio * width) / front.width);
    this.renderer.render(this.shadingScene, this.flatCamera);
  }

  /** Waits until all is drawn. */
  finish(target) {
    this.renderer.readRenderTargetPixels(target, 0, 0, 1, 1, new Uint8Array(4));
  }

  /**
   * The label of the change that is seen nearest to a place on the canvas, else of one that shines through there; null:
   * of none.
   */
  labelAt(camera, clouds, place, size, uniformsOf) {
    const near = camera.clone();
    const edge = this.pickTarget.width;
    near.setViewOffset(...size, place[0] - (edge - 1) / 2, place[1] - (edge - 1) / 2, edge, edge);
    near.updateProjectionMatrix();
    const seen = (countOf) => {
      this.clear(this.pickTarget);
      for (const cloud of clouds) {
        this.set({ ...uniformsOf(cloud), mode: MODES.pick, plain: true });
        this.part(this.pickTarget, near, cloud, [0, countOf(cloud)]);
      }
      this.set({ plain: false });
      return this.#nearestLabel();
    };
    return seen((cloud) => cloud.count) ?? seen((cloud) => cloud.changed);
  }

  #nearestLabel() {
    const edge = this.pickTarget.width;
    const bytes = new Uint8Array(4 * edge * edge);
    this.renderer.readRenderTargetPixels(this.pickTarget, 0, 0, edge, edge, bytes);
    let best = { label: null, apart: Infinity };
    for (let index = 0; index < edge * edge; index++) {
      const label = bytes[4 * index] + 256 * bytes[4 * index + 1] - 1;
      const apart = Math.hypot((index % edge) - (edge - 1) / 2, Math.floor(index / edge) - (edge - 1) / 2);
      if (label >= 0 && apart < best.apart) best = { label, apart };
    }
    return best.label;
  }
}

/** The parts of clouds cut into pieces that are quickly drawn. */
export function chunks(parts) {
  return parts.flatMap(([start, count]) =>
    Array.from({ length: Math.ceil(count / CHUNK) }, (_, index) => [
      start + index * CHUNK,
      Math.min(CHUNK, count - index * CHUNK),
    ]),
  );
}
