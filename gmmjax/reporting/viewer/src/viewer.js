// The viewer of report.html: see create() in index.js.

import * as three from "three";

import { legend, lineColor, rgb, scaleColors, themeColors, UNOBSERVED } from "./colors.js";
import { decodeSide, fromBase64, inflate } from "./decode.js";
import { chunks, Drawing } from "./drawing.js";
import { add, bestDirection, between, bounds, clipBox, corners, framed, unit } from "./geometry.js";
import { Overlay, principalAxes } from "./overlay.js";
import { CloudPoints } from "./points.js";
import { MODES } from "./shaders.js";
import { View } from "./view.js";
import { EVERYWHERE, walls, withoutNearWalls } from "./walls.js";

const DEFAULTS = {
  before: true,
  after: true,
  unchanged: true,
  unobserved: true,
  boxes: true,
  gaussians: false,
  rejected: false,
  color: "kind",
  opacityByProbability: false,
  blink: false,
  cutaway: true,
  clip: false,
  clipScale: 1.8,
};
// What is drawn over the points, which stay as they are.
const DRAWN_OVER = ["boxes", "gaussians", "rejected"];
const SIDES = ["before", "after"];
const FIELD_OF_VIEW = 45;
// Of a point's disc, in spacings: few gaps are left between points at random places.
const DIAMETER = 1.7;
// Milliseconds: of a frame while the camera moves (25 frames a second), of one flight to a change, of either cloud while
// they blink, and from the last movement to the picture of all points.
const FRAME = 40;
const FLIGHT = 550;
// Points of each cloud that walls are found by, and that may hide a change from some direction.
const WALL_SAMPLE = 15000;
const OCCLUDERS = 6000;
const BLINK = { moving: 500, reduced: 2000 };
const STILL = 160;
// Points of a frame while the camera moves: until frames have been timed, and at least.
const FIRST_POINTS = 100000;
const FEWEST_POINTS = 12000;
// So many times as many while nothing moves, before all are drawn.
const STILL_FACTOR = 4;
// Where even fewer points take too long, as without a graphics card, the picture has fewer pixels as well.
const POINTS_AT_FULL_SIZE = 120000;
const RESOLUTIONS = [1, 0.71, 0.5, 0.35];
const MISSING =
  "This browser cannot draw the points here: WebGL 2 is missing or switched off. Everything else on this page works without it.";
const LOST = "The browser has taken the graphics memory away. The points come back as soon as it is given back.";

export class Viewer {
  #settings = { ...DEFAULTS };
  #focus = null;
  #theme = "light";
  #clouds = {};
  #views = [];
  #drawing = null;
  #messages = [];
  #stale = true;
  #version = 0;
  #job = null;
  #scheduled = false;
  #flight = null;
  #movedAt = -Infinity;
  #pointsPerFrame = FIRST_POINTS;
  #lastFrame = null;
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
    this.camera = new three.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.001, 10);
    this.camera.up.set(...scene.up);
    this.target = new three.Vector3();
    this.coarse = false;
    this.resolution = 1;
    this.lost = false;
    this.canvases = Object.fromEntries(Object.entries(canvases).filter(([, canvas]) => canvas));
  }

  async load(points) {
    try {
      this.#drawing = new Drawing();
    } catch {
      this.#say(MISSING);
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
    this.#walls = walls(SIDES.flatMap((side) => this.#clouds[side].sampleOfOthers([], null, WALL_SAMPLE)));
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
      pointsPerFrame: this.#pointsPerFrame,
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
    for (const [name, value] of Object.entries(changed)) {
      if (!(name in DEFAULTS)) throw new Error(`the viewer has no setting ${JSON.stringify(name)}`);
      if (typeof value !== typeof DEFAULTS[name]) throw new Error(`${name} is a ${typeof DEFAULTS[name]}`);
    }
    if (changed.color !== undefined && !["kind", "scan", "probability", "distance"].includes(changed.color)) {
      throw new Error(`color is "kind", "scan", "probability" or "distance", not ${JSON.stringify(changed.color)}`);
    }
    Object.assign(this.#settings, changed);
    this.#clip = this.#clipOfFocus();
    if ("blink" in changed) this.#startBlinking();
    if (Object.keys(changed).every((name) => DRAWN_OVER.includes(name))) this.#presentAgain();
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
    const items = this.#itemsOf(wanted);
    this.#focus = wanted;
    this.#clip = this.#clipOfFocus();
    if (!this.#drawing) return;
    const around = bounds(items.flatMap((item) => corners(this.#scaled(item))));
    const centre = around.lower.map((low, axis) => (low + around.upper[axis]) / 2);
    const radius = Math.hypot(...around.lower.map((low, axis) => (around.upper[axis] - low) / 2));
    const narrow = Math.min(1, this.#aspect());
    const halfAngle = Math.atan(Math.tan((FIELD_OF_VIEW * Math.PI) / 360) * narrow);
    const distance = (1.25 * Math.max(radius, 1e-5)) / Math.sin(halfAngle);
    this.#fly(centre, this.#directionTo(items, radius, distance), distance);
  }

  /** Looks at everything from where one looks first; the focus stays. */
  resetCamera({ animate = true } = {}) {
    if (!this.#drawing) return;
    const { lower, upper } = this.scene.shown;
    const samples = SIDES.flatMap((side) => {
      const cloud = this.#clouds[side];
      const found = [];
      for (let index = cloud.changed; index < cloud.count && found.length < 1500; index++) found.push(cloud.point(index));
      return found;
    });
    const centre = lower.map((low, axis) => ((low + upper[axis]) / 2) * this.scale);
    if (!samples.length) samples.push(centre);
    const whole = this.scene.changes.flatMap((change) => corners(this.#scaled(change)));
    const half = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
    const halfSizes = [0.97 * half * this.#aspect(), 0.97 * half];
    const view = framed(samples, whole, this.scene.towardsEye, this.scene.up, halfSizes);
    this.#fly(view.centre, this.scene.towardsEye, view.distance, animate);
  }

  // The changes that a focus is on: a moved object is two of them.
  #itemsOf(wanted) {
    if (typeof wanted === "object") {
      const item = this.scene.rejected[wanted.rejected];
      if (!item) throw new Error(`there is no rejected candidate ${JSON.stringify(wanted.rejected)}`);
      return [item];
    }
    const change = this.scene.changes[wanted];
    if (!change) throw new Error(`there is no change ${JSON.stringify(wanted)}`);
    return change.partner === null ? [change] : [change, this.scene.changes[change.partner]];
  }

  #focusItems() {
    return this.#focus === null ? [] : this.#itemsOf(this.#focus);
  }

  #focusLabels() {
    return this.#focusItems().flatMap((item) => (item.label === undefined ? [] : [item.label]));
  }

  #scaled(item) {
    return {
      ...item,
      centre: item.centre.map((value) => value * this.scale),
      extent: item.extent.map((value) => value * this.scale),
    };
  }

  #aspect() {
    const { clientWidth, clientHeight } = this.canvases.main;
    return clientWidth && clientHeight ? clientWidth / clientHeight : 1;
  }

  #clipOfFocus() {
    if (!this.#settings.clip || this.#focus === null) return null;
    const points = this.#focusItems().flatMap((item) => corners(this.#scaled(item)));
    return clipBox(bounds(points), this.#settings.clipScale);
  }

  #directionTo(items, radius, distance) {
    const labels = items.map((item) => item.label ?? -1);
    const points = SIDES.flatMap((side) => labels.flatMap((label) => this.#clouds[side].pointsOf(label))).flat();
    const ofBoxes = items.flatMap((item) => corners(this.#scaled(item)));
    // What is nearer to the change than the eye will be can hide it, unless it is cut away.
    const near = this.#clip ?? { centre: clipBox(bounds(ofBoxes), 1).centre, half: [distance, distance, distance] };
    const lower = near.centre.map((value, axis) => value - near.half[axis]);
    const upper = near.centre.map((value, axis) => value + near.half[axis]);
    if (this.#settings.cutaway) {
      for (const axis of [0, 1, 2]) {
        lower[axis] = Math.max(lower[axis], this.#walls.lower[axis]);
        upper[axis] = Math.min(upper[axis], this.#walls.upper[axis]);
      }
    }
    const others = SIDES.flatMap((side) => this.#clouds[side].sampleOfOthers(labels, { lower, upper }, OCCLUDERS));
    const change = points.length ? points : ofBoxes.flat();
    return bestDirection(change, others, Math.max(radius / 9, 1e-6), this.scene.towardsEye, this.scene.up);
  }

  #fly(centre, direction, distance, animate = true) {
    const start = { centre: this.target.toArray(), offset: this.camera.position.clone().sub(this.target).toArray() };
    const length = Math.hypot(...start.offset);
    const turned = animate && !this.reducedMotion.matches && length > 0;
    this.#flight = {
      begin: performance.now(),
      duration: turned ? FLIGHT : 0,
      from: { centre: start.centre, direction: length > 0 ? unit(start.offset) : direction, distance: length || distance },
      to: { centre, direction, distance },
    };
    this.#advance(this.#flight.begin);
    this.#invalidate();
  }

  #advance(now) {
    const { begin, duration, from, to } = this.#flight;
    const passed = duration ? Math.min(1, (now - begin) / duration) : 1;
    const share = passed * passed * (3 - 2 * passed);
    const centre = from.centre.map((value, axis) => value + share * (to.centre[axis] - value));
    const distance = from.distance * (to.distance / from.distance) ** share;
    const direction = between(from.direction, to.direction, this.scene.up, share);
    this.target.set(...centre);
    this.camera.position.set(...add(centre, direction, distance));
    this.camera.lookAt(this.target);
    if (passed === 1) this.#flight = null;
  }

  #listen() {
    for (const view of this.#views) {
      view.controls.addEventListener("start", () => { this.#flight = null; });
      view.controls.addEventListener("change", () => {
        this.#movedAt = performance.now();
        this.#invalidate();
        setTimeout(() => this.#request(), STILL + 10);
      });
      this.#listenForClicks(view);
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
      this.#say(LOST);
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.lost = false;
      this.#unsay();
      this.#invalidate();
    });
    document.addEventListener("visibilitychange", () => this.#invalidate());
  }

  #listenForClicks(view) {
    let pressed = null;
    view.canvas.addEventListener("pointerdown", (event) => {
      pressed = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null;
    });
    view.canvas.addEventListener("pointerup", (event) => {
      if (!pressed || !event.isPrimary) return;
      const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5;
      pressed = null;
      const label = still ? this.#labelAt(view, event) : null;
      if (label !== null) this.onPick(label);
    });
  }

  #labelAt(view, event) {
    if (this.lost || !view.front) return null;
    const place = view.canvas.getBoundingClientRect();
    const x = ((event.clientX - place.left) / place.width) * view.canvas.width;
    const y = ((event.clientY - place.top) / place.height) * view.canvas.height;
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

  #uniforms(view, cloud, magnified) {
    const { settings, theme } = { settings: this.#settings, theme: themeColors(this.#theme) };
    const labels = this.#focusLabels();
    const height = view.canvas.height * this.resolution;
    const drawn = settings.cutaway ? withoutNearWalls(this.#walls, this.camera.position.toArray()) : EVERYWHERE;
    return {
      lower: cloud.lower,
      latticeStep: cloud.step,
      diameter: DIAMETER * magnified * cloud.step,
      pixels: height / 2 / Math.tan((FIELD_OF_VIEW * Math.PI) / 360),
      sizes: [1.2, 24].map((size) => Math.max(1, size * view.pixelRatio * this.resolution)),
      mode: MODES[settings.color],
      kinds: ["appeared", "disappeared", "moved"].map((kind) => new three.Vector3(...rgb(this.scene.kindColors[kind]))),
      scale: scaleColors(settings.color, this.#theme).map((color) => new three.Vector3(...rgb(color))),
      greys: [theme.dark, theme.bright].map((color) => new three.Vector3(...rgb(color))),
      unobservedColor: rgb(UNOBSERVED[0]),
      faded: rgb(theme.faded),
      focus: [labels[0] ?? -1, labels[1] ?? -1],
      isolating: this.#focus !== null,
      clipping: this.#clip !== null,
      clipCentre: this.#clip?.centre ?? [0, 0, 0],
      clipHalf: this.#clip?.half ?? [0, 0, 0],
      drawnLower: drawn.lower,
      drawnUpper: drawn.upper,
      showUnchanged: settings.unchanged,
      showUnobserved: settings.unobserved,
      fading: settings.opacityByProbability,
    };
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
    const most = this.#pointsPerFrame * (moving ? 1 : STILL_FACTOR);
    const share = Math.min(1, most / Math.max(total, 1));
    // In steps, as a picture of another size takes time to set up.
    const size = Math.sqrt(most / POINTS_AT_FULL_SIZE);
    this.resolution = share < 1 ? (RESOLUTIONS.find((step) => step <= size) ?? RESOLUTIONS.at(-1)) : 1;
    const begin = performance.now();
    for (const view of views) {
      this.#drawing.clear(view.front, this.resolution);
      view.frontKey = share < 1 ? null : this.#pictureKey();
      this.#draw(view, view.front, share);
    }
    this.#present(views);
    if (views.length) this.#drawing.finish(views[0].front);
    this.coarse = share < 1;
    if (moving) this.#adapt(performance.now() - begin, now, share);
    else this.#lastFrame = null;
  }

  // So many points that the next frame takes as long as it may.
  #adapt(took, now, share) {
    const since = this.#lastFrame === null ? 0 : now - this.#lastFrame;
    this.#lastFrame = now;
    const frame = Math.max(took, since < 250 ? 0.8 * since : 0);
    const factor = Math.min(1.6, Math.max(0.25, (0.8 * FRAME) / Math.max(frame, 1)));
    if (share < 1 || factor < 1) this.#pointsPerFrame = Math.max(FEWEST_POINTS, this.#pointsPerFrame * factor);
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
    const magnified = Math.min(3, Math.sqrt(1 / share));
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
    views.forEach((view) => this.#drawOver(view));
  }

  #drawOver(view) {
    const theme = themeColors(this.#theme);
    const overlay = new Overlay(view.context, view.projector(), view.pixelRatio, theme);
    const sides = this.#sidesOf(view);
    const focused = this.#focusLabels();
    const changes = this.scene.changes.filter(({ side }) => sides.includes(side));
    view.numbers = [];
    for (const change of changes) {
      const own = this.#focus === null || focused.includes(change.label);
      if (this.#clip && !own) continue;
      view.context.globalAlpha = own ? 1 : 0.25;
      this.#drawChange(overlay, view, change, own);
    }
    view.context.globalAlpha = 1;
    if (view.name === "main") this.#drawArrows(overlay, focused);
    this.#drawRejected(overlay, sides, theme);
  }

  #drawChange(overlay, view, change, own) {
    const color = lineColor(this.scene.kindColors[change.kind], overlay.theme);
    const box = this.#scaled(change);
    if (this.#settings.boxes) overlay.box(box, color);
    if (this.#settings.gaussians) {
      const axes = principalAxes(change.covariance).map((axis) => axis.map((value) => value * this.scale));
      overlay.gaussian(change.mean.map((value) => value * this.scale), axes, color);
    }
    if (!own || !(this.#settings.boxes || this.#settings.gaussians)) return;
    const place = overlay.number(String(change.label), box, this.scene.up, color);
    if (place) view.numbers.push([change.label, place]);
  }

  // From where each moved object was to where it is.
  #drawArrows(overlay, focused) {
    for (const change of this.scene.changes) {
      if (change.partner === null || change.side !== "before") continue;
      if (this.#focus !== null && !focused.includes(change.label)) continue;
      const [from, to] = [change, this.scene.changes[change.partner]].map((item) => this.#scaled(item).centre);
      overlay.arrow(from, to);
    }
  }

  #drawRejected(overlay, sides, theme) {
    this.scene.rejected.forEach((candidate, index) => {
      const own = this.#focus?.rejected === index;
      if (!own && (!this.#settings.rejected || this.#focus !== null)) return;
      if (!sides.includes(candidate.side)) return;
      overlay.box(this.#scaled(candidate), theme.line, { width: own ? 2 : 1.2, dashed: true });
    });
  }

  // A message in the place of every canvas.
  #say(text) {
    this.#unsay();
    for (const canvas of Object.values(this.canvases)) {
      const message = document.createElement("p");
      message.className = "viewer-message";
      message.setAttribute("role", "status");
      message.textContent = text;
      canvas.style.display = "none";
      canvas.after(message);
      this.#messages.push(message);
    }
  }

  #unsay() {
    for (const message of this.#messages.splice(0)) message.remove();
    for (const canvas of Object.values(this.canvases)) canvas.style.display = "";
  }
}
