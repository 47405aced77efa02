// Points as discs of the size of their spacing, and the shading of their picture by depth.

export const MODES = { kind: 0, scan: 1, probability: 2, distance: 3, pick: 4 };

export const pointVertex = /* glsl */ `
precision highp float;
precision highp int;
in vec4 position;   // place on the lattice, label
in vec4 scan;       // red, green, blue of the scan, probability
in vec4 measured;   // distance, flags: 1 not observed; 2, 4, 6 appeared, disappeared, moved; spacing
uniform mat4 viewMatrix;
uniform mat4 projectionMatrix;
uniform vec3 lower;
uniform float latticeStep;
uniform float diameter;    // of a disc where the spacing is one step of the lattice, in the unit of the drawing
uniform float pixels;      // that a length of 1 takes up at the distance 1
uniform vec2 sizes;        // of a disc in pixels, at least and at most
uniform int mode;
uniform vec3 kinds[3];
uniform vec3 scale[7];
uniform vec3 greys[2];
uniform vec3 unobservedColor;
uniform vec3 faded;
uniform vec2 focus;        // two labels, or -1
uniform bool isolating;
uniform bool clipping;
uniform vec3 clipCentre;
uniform vec3 clipHalf;
uniform vec3 drawnLower;   // of what is unchanged
uniform vec3 drawnUpper;
uniform bool showUnchanged;
uniform bool showUnobserved;
uniform bool fading;
out vec3 color;
out float hatched;

const float NO_LABEL = 65535.0;

vec3 onScale(float value) {
  float place = clamp(value, 0.0, 1.0) * 6.0;
  int below = int(min(floor(place), 5.0));
  return mix(scale[below], scale[below + 1], place - float(below));
}

float hash(int value) {
  uint mixed = uint(value) * 747796405u + 2891336453u;
  mixed = ((mixed >> ((mixed >> 28) + 4u)) ^ mixed) * 277803737u;
  return float((mixed >> 22) ^ mixed) / 4294967295.0;
}

void main() {
  float label = position.w;
  int flags = int(measured.y);
  int kind = flags / 2;
  bool changed = label < NO_LABEL;
  bool unobserved = !changed && (flags & 1) == 1;
  bool own = label == focus.x || label == focus.y;
  vec3 place = lower + (position.xyz + 0.5) * latticeStep;
  bool hidden = unobserved ? !showUnobserved : !changed && !showUnchanged;
  hidden = hidden || (!changed && (any(lessThan(place, drawnLower)) || any(greaterThan(place, drawnUpper))));
  hidden = hidden || (clipping && any(greaterThan(abs(place - clipCentre), clipHalf)));
  hidden = hidden || (fading && hash(gl_VertexID) > mix(0.02, 1.0, scan.a));
  if (hidden) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    gl_PointSize = 0.0;
    return;
  }
  vec4 seen = viewMatrix * vec4(place, 1.0);
  gl_Position = projectionMatrix * seen;
  gl_PointSize = clamp(diameter * exp2(measured.z / 16.0) * pixels / max(-seen.z, 1e-9), sizes.x, sizes.y);

  float brightness = dot(scan.rgb, vec3(0.299, 0.587, 0.114));
  vec3 grey = mix(greys[0], greys[1], brightness);
  hatched = 0.0;
  if (mode == ${MODES.pick}) {
    float number = changed ? label + 1.0 : 0.0;
    color = vec3(mod(number, 256.0), floor(number / 256.0), 0.0) / 255.0;
    return;
  }
  if (mode == ${MODES.scan}) color = scan.rgb;
  else if (mode == ${MODES.probability}) color = onScale(scan.a);
  else if (mode == ${MODES.distance}) color = measured.x > 0.0 ? onScale((measured.x - 1.0) / 254.0) : grey;
  else color = changed ? kinds[max(kind, 1) - 1] : unobserved ? unobservedColor : grey;
  if (unobserved) {
    hatched = 1.0;
    if (mode == ${MODES.scan}) color = mix(color, unobservedColor, 0.6);
  }
  if (isolating && !own) {
    color = mix(changed ? mix(color, grey, 0.7) : color, faded, changed ? 0.45 : 0.55);
  }
}
`;

export const pointFragment = /* glsl */ `
precision highp float;
uniform bool plain;
uniform bool hiddenOnly;
in vec3 color;
in float hatched;
out vec4 result;

void main() {
  vec2 beside = gl_PointCoord - 0.5;
  if (dot(beside, beside) > 0.25) discard;
  if (hiddenOnly && mod(floor(gl_FragCoord.x) + floor(gl_FragCoord.y), 2.0) < 1.0) discard;
  float stripe = hatched > 0.5 && mod(gl_FragCoord.x + gl_FragCoord.y, 8.0) < 3.0 ? 0.72 : 1.0;
  result = vec4(plain ? color : color * stripe, 1.0);
}
`;

export const shadingVertex = /* glsl */ `
in vec3 position;
void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }
`;

/** Eye-dome lighting (Boucheny and Ribes, 2011): what lies behind its neighbours is darker. */
export const shadingFragment = /* glsl */ `
precision highp float;
uniform sampler2D colors;
uniform sampler2D depths;
uniform vec2 corner;     // where the picture is drawn, pixels
uniform vec2 size;       // of the part of it that is drawn
uniform vec2 range;      // near, far
uniform float radius;    // pixels to the neighbours
uniform float strength;
out vec4 result;

float octaves(ivec2 pixel) {
  float depth = texelFetch(depths, clamp(pixel, ivec2(0), ivec2(size) - 1), 0).r;
  if (depth >= 1.0) return 1e3;
  return log2(range.x * range.y / (range.y - depth * (range.y - range.x)));
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy - corner);
  vec4 color = texelFetch(colors, pixel, 0);
  if (color.a == 0.0) {
    result = vec4(0.0);
    return;
  }
  float own = octaves(pixel);
  float behind = 0.0;
  for (int step = 0; step < 8; step++) {
    float angle = float(step) * 0.7853981634;
    float other = octaves(pixel + ivec2(round(radius * vec2(cos(angle), sin(angle)))));
    behind += clamp(own - other, 0.0, 0.08) / 8.0;
  }
  result = vec4(color.rgb * exp(-strength * behind), 1.0);
}
`;
