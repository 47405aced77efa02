// Boxes, Gaussians, arrows, numbers and stations, drawn over the points in two dimensions: nothing hides them.

import { corners, dot } from "./geometry.js";

const EDGES = [0, 1, 2].flatMap((axis) =>
  [0, 1, 2, 3, 4, 5, 6, 7].filter((corner) => !((corner >> axis) & 1)).map((corner) => [corner, corner | (1 << axis)]),
);
const TURN = Array.from({ length: 49 }, (_, step) => [Math.cos((step * Math.PI) / 24), Math.sin((step * Math.PI) / 24)]);

export class Overlay {
  /** project: from a point to [x, y] on the canvas, or null behind the eye; pixelRatio: of the canvas. */
  constructor(context, project, pixelRatio, theme) {
    Object.assign(this, { context, project, pixelRatio, theme });
  }

  #line(points, closed = false) {
    const seen = points.map(this.project);
    if (seen.includes(null)) return null;
    const path = new Path2D();
    seen.forEach(([x, y], index) => (index ? path.lineTo(x, y) : path.moveTo(x, y)));
    if (closed) path.closePath();
    return path;
  }

  #stroke(path, color, width) {
    if (!path) return;
    this.context.strokeStyle = this.theme.halo;
    this.context.lineWidth = (width + 1.6) * this.pixelRatio;
    const alpha = this.context.globalAlpha;
    this.context.globalAlpha = 0.7 * alpha;
    this.context.stroke(path);
    this.context.globalAlpha = alpha;
    this.context.strokeStyle = color;
    this.context.lineWidth = width * this.pixelRatio;
    this.context.stroke(path);
  }

  box(box, color, { width = 1.6, dashed = false } = {}) {
    const points = corners(box);
    this.context.setLineDash(dashed ? [5 * this.pixelRatio, 4 * this.pixelRatio] : []);
    for (const [start, end] of EDGES) this.#stroke(this.#line([points[start], points[end]]), color, width);
    this.context.setLineDash([]);
  }

  /** The ellipsoid of two standard deviations, by its three principal ellipses. */
  gaussian(mean, axes, color) {
    for (const [first, second] of [[0, 1], [0, 2], [1, 2]]) {
      const ring = TURN.map(([cosine, sine]) =>
        mean.map((value, axis) => value + 2 * (cosine * axes[first][axis] + sine * axes[second][axis])),
      );
      const path = this.#line(ring, true);
      if (!path) continue;
      const alpha = this.context.globalAlpha;
      this.context.globalAlpha = 0.1 * alpha;
      this.context.fillStyle = color;
      this.context.fill(path);
      this.context.globalAlpha = alpha;
      this.#stroke(path, color, 1);
    }
  }

  /** In the colour of the lines: over the boxes and points that moved, their own would not be seen. */
  arrow(from, to) {
    const [start, end] = [this.project(from), this.project(to)];
    if (!start || !end) return;
    const length = Math.hypot(end[0] - start[0], end[1] - start[1]);
    if (length < this.pixelRatio) return;
    const along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length];
    const head = Math.min(14 * this.pixelRatio, Math.max(0.5 * length, 5 * this.pixelRatio));
    const path = new Path2D();
    path.moveTo(...start);
    path.lineTo(...end);
    for (const side of [1, -1]) {
      path.moveTo(...end);
      path.lineTo(
        end[0] - head * (along[0] + 0.5 * side * along[1]),
        end[1] - head * (along[1] - 0.5 * side * along[0]),
      );
    }
    this.context.lineCap = "round";
    this.#stroke(path, this.theme.line, 3.5);
    this.context.lineCap = "butt";
  }

  /** The triangle of a survey station, with its name to the left or right. */
  station(position, name, left) {
    const seen = this.project(position);
    if (!seen) return;
    const [x, y] = seen;
    const size = 6 * this.pixelRatio;
    const triangle = new Path2D();
    triangle.moveTo(x, y - size);
    triangle.lineTo(x + size, y + 0.7 * size);
    triangle.lineTo(x - size, y + 0.7 * size);
    triangle.closePath();
    this.context.lineJoin = "round";
    this.#stroke(triangle, this.theme.line, 1.6);
    this.context.fillStyle = this.theme.line;
    this.context.fillRect(x - 0.2 * size, y - 0.1 * size, 0.4 * size, 0.4 * size);
    const [at, align] = left ? [x - 1.5 * size, "right"] : [x + 1.5 * size, "left"];
    this.#text(name, at, y, { font: `500 ${11 * this.pixelRatio}px`, align, baseline: "middle", color: this.theme.line });
  }

  /** Draws a text with a halo; returns its width. */
  #text(text, x, y, { font, align, baseline, color }) {
    const { context } = this;
    context.font = `${font} system-ui, sans-serif`;
    context.textAlign = align;
    context.textBaseline = baseline;
    context.lineJoin = "round";
    context.strokeStyle = this.theme.halo;
    context.lineWidth = 4 * this.pixelRatio;
    context.strokeText(text, x, y);
    context.fillStyle = color;
    context.fillText(text, x, y);
    return context.measureText(text).width;
  }

  /** The number of a change above its box; returns where it stands: left, top, right, bottom. */
  number(text, box, up, color) {
    const points = corners(box);
    const height = Math.max(...points.map((point) => dot(point, up) - dot(box.centre, up)));
    const seen = this.project(box.centre.map((value, axis) => value + height * up[axis]));
    if (!seen) return null;
    const size = 15 * this.pixelRatio;
    const [x, y] = [seen[0], seen[1] - 4 * this.pixelRatio];
    const half = this.#text(text, x, y, { font: `700 ${size}px`, align: "center", baseline: "bottom", color }) / 2 + 3 * this.pixelRatio;
    return [x - half, y - size - 2 * this.pixelRatio, x + half, y + 2 * this.pixelRatio];
  }
}

/** The principal axes of a covariance, each as long as its standard deviation (Jacobi's method). */
export function principalAxes(covariance) {
  const matrix = covariance.map((row) => [...row]);
  const vectors = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  for (let sweep = 0; sweep < 12; sweep++) {
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]]) {
      if (Math.abs(matrix[p][q]) < 1e-300) continue;
      const angle = 0.5 * Math.atan2(2 * matrix[p][q], matrix[q][q] - matrix[p][p]);
      const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
      for (let k = 0; k < 3; k++) {
        [matrix[k][p], matrix[k][q]] = [cosine * matrix[k][p] - sine * matrix[k][q], sine * matrix[k][p] + cosine * matrix[k][q]];
      }
      for (let k = 0; k < 3; k++) {
        [matrix[p][k], matrix[q][k]] = [cosine * matrix[p][k] - sine * matrix[q][k], sine * matrix[p][k] + cosine * matrix[q][k]];
        [vectors[p][k], vectors[q][k]] = [cosine * vectors[p][k] - sine * vectors[q][k], sine * vectors[p][k] + cosine * vectors[q][k]];
      }
    }
  }
  return vectors.map((vector, axis) => vector.map((value) => value * Math.sqrt(Math.max(matrix[axis][axis], 0))));
}
