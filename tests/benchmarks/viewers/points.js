// Two clouds of points on the walls of a hall and on spheres in it, the same for all contenders.
export function clouds(count) {
  let state = 1;
  const random = () => (state = (state * 48271) % 2147483647) / 2147483647;
  return [0, 1].map((side) => {
    const [positions, colors] = [new Float32Array(3 * count), new Uint8Array(4 * count)];
    for (let index = 0; index < count; index++) {
      const point = [random() - 0.5, 0.6 * (random() - 0.5), 0.2 * (random() - 0.5)];
      const axis = Math.floor(3 * random());
      point[axis] = Math.sign(point[axis]) * [0.5, 0.3, 0.1][axis];
      positions.set(point, 3 * index);
      colors.set([120 + 100 * point[0], 130 + 60 * side, 140, 255], 4 * index);
    }
    return { positions, colors };
  });
}

/** Column-major matrices of a camera at this angle, 1.4 from the middle. */
export function camera(angle, aspect) {
  const [near, far, focal] = [0.05, 10, 1 / Math.tan(Math.PI / 8)];
  const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
  const eye = [1.2 * cosine, 1.2 * sine, 0.7];
  const length = Math.hypot(...eye);
  const back = eye.map((value) => value / length);
  const right = [-sine, cosine, 0];
  const up = [
    back[1] * right[2] - back[2] * right[1],
    back[2] * right[0] - back[0] * right[2],
    back[0] * right[1] - back[1] * right[0],
  ];
  const view = [0, 1, 2].flatMap((axis) => [right[axis], up[axis], back[axis], 0]).concat([0, 0, -length, 1]);
  const projection = [
    focal / aspect, 0, 0, 0, 0, focal, 0, 0,
    0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0,
  ];
  return { view, projection, eye };
}

export const VERTEX = `
attribute vec3 position; attribute vec4 color; uniform mat4 view; uniform mat4 projection; varying vec4 shade;
void main() { gl_Position = projection * view * vec4(position, 1.0); gl_PointSize = 2.0; shade = color; }`;
export const FRAGMENT = "precision mediump float; varying vec4 shade; void main() { gl_FragColor = shade; }";
