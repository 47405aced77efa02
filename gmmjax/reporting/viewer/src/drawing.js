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

  clear(target) {
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

  /** Shades a picture and copies it to the canvas of a view. */
  show(target, camera, context, pixelRatio) {
    const { width, height } = target;
    if (this.canvas.width < width || this.canvas.height < height) {
      this.renderer.setSize(Math.max(this.canvas.width, width), Math.max(this.canvas.height, height), false);
    }
    this.renderer.setRenderTarget(null);
    this.renderer.setViewport(0, 0, width, height);
    const { uniforms } = this.shading;
    uniforms.colors.value = target.texture;
    uniforms.depths.value = target.depthTexture;
    uniforms.range.value = [camera.near, camera.far];
    uniforms.radius.value = 1.4 * pixelRatio;
    this.renderer.render(this.shadingScene, this.flatCamera);
    context.clearRect(0, 0, width, height);
    // The lower left of one, from the upper left of the other.
    context.drawImage(this.canvas, 0, this.canvas.height - height, width, height, 0, 0, width, height);
  }

  /** Waits until all is drawn. */
  finish(target) {
    this.renderer.readRenderTargetPixels(target, 0, 0, 1, 1, new Uint8Array(4));
  }

  /** The label of the change that is seen nearest to the middle of the small picture around a place; null: of none. */
  labelAt(camera, clouds, [x, y], [width, height], uniformsOf) {
    const edge = this.pickTarget.width;
    const near = camera.clone();
    near.setViewOffset(width, height, x - (edge - 1) / 2, y - (edge - 1) / 2, edge, edge);
    near.updateProjectionMatrix();
    this.clear(this.pickTarget);
    for (const cloud of clouds) {
      this.set({ ...uniformsOf(cloud), mode: MODES.pick, plain: true });
      this.part(this.pickTarget, near, cloud, [0, cloud.count]);
    }
    this.set({ plain: false });
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
