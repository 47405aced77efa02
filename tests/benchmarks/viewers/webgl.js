import { camera, FRAGMENT, VERTEX } from "./points.js";

export function start(canvas, clouds) {
  const gl = canvas.getContext("webgl2", { antialias: false });
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  const arrays = clouds.map(({ positions, colors }) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    for (const [name, data, size, type] of [["position", positions, 3, gl.FLOAT], ["color", colors, 4, gl.UNSIGNED_BYTE]]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      const place = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, true, 0, 0);
    }
    return [array, positions.length / 3];
  });
  return (angle) => {
    const { view, projection } = camera(angle, canvas.width / canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "view"), false, view);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "projection"), false, projection);
    for (const [array, count] of arrays) {
      gl.bindVertexArray(array);
      gl.drawArrays(gl.POINTS, 0, count);
    }
  };
}
