// The viewer of report.html: see create() in index.js.

import * as three from "three";

import { annotate } from "./annotations.js";
import { uniformsOf } from "./appearance.js";
import { legend, themeColors } from "./colors.js";
import { decodeSide, fromBase64, inflate } from "./decode.js";
import { chunks, Drawing } from "./drawing.js";
import { add } from "./geometry.js";
import { Items } from "./items.js";
import { LOST, Messages, MISSING } from "./messages.js";
import { FRAME, Pacing } from "./pacing.js";
import { CloudPoints } from "./points.js";
import { checkSettings, DEFAULTS, keepsPoints, SIDES } from "./settings.js";
import { View } from "./view.js";
import { closeUp, FIELD_OF_VIEW, Flight, overview, viewpointOf } from "./viewpoints.js";
import { EVERYWHERE, walls } from "./walls.js";

// Milliseconds: of one flight to a change, of either cloud while they blink, and from the last movement to the picture
// of all points.
const FLIGHT = 550;
const BLINK = { moving: 500, reduced: 2000 };
const STILL = 160;
// Points of each cloud that walls are found by.
const WALL_SAMPLE = 15000;
// Discs that stand for several points that are not drawn are at most so much larger.
const LARGEST_MAGNIFIED = 3;

export class Viewer {
  #settings = { ...DEFAULTS };
  #focus = null;
  #theme = "light";
  #clouds = {};
  #views = [];
  #drawing = null;
  #stale = true;
  #version = 0;
  #job = null;
  #scheduled = false;
  #flight = null;
  #movedAt = -Infinity;
  #pacing = new Pacing();
  #waiting = [];
  #blinkSide = "after";
  #blinkTimer = null;
  #clip = null;
  #walls = EVERYWHERE;

  constructor({ scene, canvases, onPick }) {
    this.scene = scene;
    this.onPick = onPick ?? (() => {});
    this.reducedMotion = window.matchMedia("(prefers-reduced-motion: reduce)");
    // In the unit of the drawing the longest edge of what is shown is 1, whatever the unit of the clouds.
    this.scale = 1 / (scene.quantisation.step * 2 ** scene.quantisation.depth);
    this.items = new Items(scene, this.scale);
    this.camera = new three.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.001, 10);
    this.camera.up.set(...scene.up);
    this.target = new three.Vector3();
    this.coarse = false;
    this.resolution = 1;
    this.lost = false;
    this.canvases = Object.fromEntries(Object.entries(canvases).filter(([, canvas]) => canvas));
    this.messages = new Messages(Object.values(this.canvases));
  }

  async load(points) {
    try {
      this.#drawing = new Drawing();
    } catch {
      this.messages.show(MISSING);
      return;
    }
    this.#views = Object.entries(this.canvases).map(([name, canvas]) => new View(name, canvas, this.camera, this.target));
    for (const side of SIDES) {
      const bytes = await inflate(fromBase64(points[side].trim()));
      const decoded = decodeSide(bytes, this.scene, side);
      this.#clouds[side] = new CloudPoints(decoded, this.scene, side, this.scale);
      // So that the page can answer between the two clouds.
      await new Promise((resolve) => setTimeout(resolve));
    }
    this.#walls = walls(SIDES.flatMap((side) => this.#clouds[side].unchangedSample(WALL_SAMPLE)));
    this.#listen();
    this.resetCamera({ animate: false });
  }

  /** Current settings, focus and counts; `available` is false where there is no WebGL 2. */
  get state() {
    const points = Object.fromEntries(SIDES.map((side) => [side, this.#clouds[side]?.count ?? 0]));
    return Object.freeze({
      ...this.#settings,
      focus: this.#focus,
      theme: this.#theme,
      available: this.#drawing !== null,
      blinkSide: this.#settings.blink ? this.#blinkSide : null,
      points,
      pointsPerFrame: Math.round(this.#pacing.pointsPerFrame),
      camera: { position: this.camera.position.toArray(), target: this.target.toArray() },
    });
  }

  /** What the colours mean now; see legend() in colors.js. */
  get legend() {
    return legend(this.#settings.color, this.scene, this.#theme);
  }

  /** Resolves when all points are drawn and nothing moves any more. */
  get settled() {
    if (!this.#drawing || this.#isSettled()) return Promise.resolve();
    return new Promise((resolve) => this.#waiting.push(resolve));
  }

  set(changed) {
    checkSettings(changed);
    Object.assign(this.#settings, changed);
    this.#clip = this.#clipOfFocus();
    if ("blink" in changed) this.#startBlinking();
    if (keepsPoints(changed)) this.#presentAgain();
    else this.#invalidate();
  }

  // The same points with other boxes.
  #presentAgain() {
    if (!this.lost) this.#present(this.#views.filter((view) => view.drawn && view.front));
  }

  setTheme(name) {
    themeColors(name);
    this.#theme = name;
    this.#invalidate();
  }

  /** Looks at a change, at what was turned down ({rejected: index}), or at everything again (null). */
  focus(wanted) {
    if (wanted === null || wanted === undefined) {
      this.#focus = null;
      this.#clip = null;
      this.resetCamera();
      return;
    }
    const chosen = this.items.of(wanted);
    this.#focus = wanted;
    this.#clip = this.#clipOfFocus();
    if (!this.#drawing) return;
    this.#fly(closeUp(this.scene, chosen, Object.values(this.#clouds), this.#aspect(), this.#visible()));
  }

  /** Looks at everything from where one looks first; the focus stays. */
  resetCamera({ animate = true } = {}) {
    if (!this.#drawing) return;
    this.#fly(overview(this.scene, this.items, Object.values(this.#clouds), this.#aspect()), animate);
  }

  #aspect() {
    const { clientWidth, clientHeight } = this.canvases.main;
    return clientWidth && clientHeight ? clientWidth / clientHeight : 1;
  }

  #clipOfFocus() {
    return this.#settings.clip ? this.items.clipOf(this.#focus, this.#settings.clipScale) : null;
  }

  // The box of what may hide a focus. Walls too, though they are cut away: what stands before one was scanned, and is
  // better seen, from inside.
  #visible() {
    if (!this.#clip) return EVERYWHERE;
    const { centre, half } = this.#clip;
    return { lower: add(centre, half, -1), upper: add(centre, half) };
  }

  #fly(viewpoint, animate = true) {
    const begin = performance.now();
    const from = viewpointOf(this.camera, this.target, viewpoint);
    const moving = animate && !this.reducedMotion.matches;
    this.#flight = new Flight(from, viewpoint, this.scene.up, begin, moving ? FLIGHT : 0);
    this.#advance(begin);
    this.#invalidate();
  }

  #advance(now) {
    const { centre, direction, distance, arrived } = this.#flight.at(now);
    this.target.set(...centre);
    this.camera.position.set(...add(centre, direction, distance));
    this.camera.lookAt(this.target);
    if (arrived) this.#flight = null;
  }

  #listen() {
    for (const view of this.#views) {
      view.controls.addEventListener("start", () => { this.#flight = null; });
      view.controls.addEventListener("change", () => {
        this.#movedAt = performance.now();
        this.#invalidate();
        setTimeout(() => this.#request(), STILL + 10);
      });
      view.onClick((x, y) => {
        const label = this.#labelAt(view, x, y);
        if (label !== null) this.onPick(label);
      });
      new ResizeObserver(() => this.#invalidate()).observe(view.canvas);
      new IntersectionObserver(([entry]) => {
        view.onScreen = entry.isIntersecting;
        if (view.onScreen) this.#invalidate();
      }).observe(view.canvas);
    }
    const { canvas } = this.#drawing;
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.lost = true;
      this.#job = null;
      this.#views.forEach((view) => view.dispose());
      this.messages.show(LOST);
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.lost = false;
      this.messages.clear();
      this.#invalidate();
    });
    document.addEventListener("visibilitychange", () => this.#invalidate());
  }

  #labelAt(view, x, y) {
    if (this.lost || !view.front) return null;
    const number = view.numbers.find(([, [left, top, right, bottom]]) => x > left && x < right && y > top && y < bottom);
    if (number) return number[0];
    const clouds = this.#sidesOf(view).map((side) => this.#clouds[side]);
    const size = [view.canvas.width, view.canvas.height];
    this.resolution = 1;
    return this.#drawing.labelAt(view.camera, clouds, [x, y], size, (cloud) => this.#uniforms(view, cloud, 1));
  }

  #startBlinking() {
    clearInterval(this.#blinkTimer);
    if (!this.#settings.blink) return;
    this.#blinkTimer = setInterval(() => this.#blink(), this.reducedMotion.matches ? BLINK.reduced : BLINK.moving);
  }

  // Shows the other cloud; once both are drawn, their two pictures just change places.
  #blink() {
    // A slow machine blinks more slowly.
    if (document.hidden || this.lost || !this.#isSettled()) return;
    this.#blinkSide = this.#blinkSide === "before" ? "after" : "before";
    const main = this.#views.find(({ name }) => name === "main");
    if (!main.drawn || !main.front) return;
    if (main.backKey === this.#pictureKey()) {
      main.swap();
      this.#present([main]);
      return;
    }
    this.#job = this.#fullPicture([main]);
    this.#request();
  }

  #pictureKey() {
    return `${this.#version} ${this.#settings.blink ? this.#blinkSide : ""}`;
  }

  #sidesOf(view) {
    if (view.name !== "main") return [view.name];
    const shown = SIDES.filter((side) => this.#settings[side]);
    return this.#settings.blink ? [this.#blinkSide] : shown;
  }

  #look() {
    return {
      settings: this.#settings,
      theme: this.#theme,
      focus: this.#focus,
      labels: this.items.labelsOf(this.#focus),
      clip: this.#clip,
      walls: this.#walls,
      eye: this.camera.position.toArray(),
    };
  }

  #uniforms(view, cloud, magnified) {
    return uniformsOf(this.scene, this.#look(), view, cloud, magnified, this.resolution);
  }

  // Draws again in the next frame.
  #invalidate() {
    this.#version++;
    this.#stale = true;
    this.#job = null;
    this.#request();
  }

  #request() {
    if (this.#scheduled || !this.#drawing) return;
    this.#scheduled = true;
    requestAnimationFrame((now) => {
      this.#scheduled = false;
      if (!this.lost && !document.hidden) this.#frame(now);
    });
  }

  #isMoving(now) {
    return this.#flight !== null || now - this.#movedAt < STILL;
  }

  #isSettled() {
    return !this.#stale && !this.coarse && !this.#job && !this.#isMoving(performance.now());
  }

  #frame(now) {
    if (this.#flight) {
      this.#advance(now);
      this.#version++;
      this.#stale = true;
    }
    const moving = this.#isMoving(performance.now());
    if (this.#stale) this.#begin(moving, now);
    else if (!this.#job && this.coarse && !moving) this.#job = this.#fullPicture(this.#views);
    if (this.#job && !moving && this.#job.next().done) this.#job = null;
    if (this.#flight || this.#job || (this.coarse && !moving)) this.#request();
    else if (moving) setTimeout(() => this.#request(), STILL);
    else this.#resolve();
  }

  #resolve() {
    if (!this.#isSettled()) return;
    for (const resolve of this.#waiting.splice(0)) resolve();
  }

  // The first picture after something has changed: all points if there is time, else a sample of them.
  #begin(moving, now) {
    this.#stale = false;
    const views = this.#views.filter((view) => view.drawn);
    this.#place(views);
    const total = views.reduce((sum, view) => sum + this.#count(view), 0);
    const { share, resolution } = this.#pacing.plan(total, moving);
    this.resolution = resolution;
    const begin = performance.now();
    for (const view of views) {
      this.#drawing.clear(view.front, this.resolution);
      view.frontKey = share < 1 ? null : this.#pictureKey();
      this.#draw(view, view.front, share);
    }
    this.#present(views);
    if (views.length) this.#drawing.finish(views[0].front);
    this.coarse = share < 1;
    this.#pacing.drawn({ took: performance.now() - begin, now, share, moving });
  }

  // All points, a few at a time, so that the page answers in between.
  *#fullPicture(chosen) {
    const views = chosen.filter((view) => view.drawn && view.front);
    this.resolution = 1;
    let begin = performance.now();
    for (const view of views) {
      this.#drawing.clear(view.back);
      view.backKey = null;
      for (const side of this.#sidesOf(view)) {
        const cloud = this.#clouds[side];
        for (const part of chunks(cloud.parts(Infinity))) {
          this.#drawing.set(this.#uniforms(view, cloud, 1));
          this.#drawing.part(view.back, view.camera, cloud, part);
          this.#drawing.finish(view.back);
          if (performance.now() - begin < FRAME) continue;
          yield;
          begin = performance.now();
        }
      }
      this.#drawHidden(view, view.back, 1, 1);
      view.backKey = this.#pictureKey();
      view.swap();
      this.#present([view]);
    }
    this.coarse = false;
  }

  #place(views) {
    const distance = this.camera.position.distanceTo(this.target);
    this.camera.near = Math.max(0.04 * distance, 1e-6);
    this.camera.far = distance + 3;
    for (const view of views) {
      view.fit(this.#drawing);
      view.follow(this.camera);
    }
    this.camera.aspect = this.#aspect();
    this.camera.updateProjectionMatrix();
  }

  #count(view) {
    return this.#sidesOf(view).reduce((sum, side) => sum + this.#clouds[side].count, 0);
  }

  #draw(view, target, share) {
    const magnified = Math.min(LARGEST_MAGNIFIED, Math.sqrt(1 / share));
    for (const side of this.#sidesOf(view)) {
      const cloud = this.#clouds[side];
      this.#drawing.set(this.#uniforms(view, cloud, magnified));
      for (const part of cloud.parts(share * cloud.count)) this.#drawing.part(target, view.camera, cloud, part);
    }
    this.#drawHidden(view, target, share, magnified);
  }

  #drawHidden(view, target, share, magnified) {
    for (const side of this.#sidesOf(view)) {
      const cloud = this.#clouds[side];
      this.#drawing.set(this.#uniforms(view, cloud, magnified));
      this.#drawing.hidden(target, view.camera, cloud, share * cloud.count);
    }
  }

  #present(views) {
    if (views.length) this.#drawing.show(views);
    views.forEach((view) => annotate(this.scene, this.items, this.#look(), view, this.#sidesOf(view)));
  }
}
