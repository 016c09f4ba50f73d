// Directions, turns and cameras. +Y is up; azimuth goes from -Z towards +X; a quaternion is [x, y, z, w].

const RADIANS = Math.PI / 180;

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const add = (a, b, times = 1) => [a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2]];
const normalized = (a) => {
  const length = Math.hypot(...a);
  return a.map((value) => value / length);
};

/** An azimuth from 0 to 360. */
export const wrapped = (degrees) => ((degrees % 360) + 360) % 360;

export function direction(azimuth, elevation) {
  const level = Math.cos(elevation * RADIANS);
  return [level * Math.sin(azimuth * RADIANS), Math.sin(elevation * RADIANS), -level * Math.cos(azimuth * RADIANS)];
}

/** A turn by `degrees` of azimuth: about -Y by the right hand. */
export function about(degrees) {
  const half = (degrees * RADIANS) / 2;
  return [0, -Math.sin(half), 0, Math.cos(half)];
}

/** The shortest turn from one unit direction to another. */
export function between(from, to) {
  const turn = [...cross(from, to), 1 + dot(from, to)];
  return turn[3] < 1e-9 ? [0, 1, 0, 0] : normalized(turn);
}

/** First `b`, then `a`. */
export function product(a, b) {
  const [x, y, z] = add(add(cross(a, b), b, a[3]), a, b[3]);
  return normalized([x, y, z, a[3] * b[3] - dot(a, b)]);
}

/** The azimuth by which a turn turns about the vertical, 0 to 360: its twist about Y. */
export function azimuthOf(turn) {
  return wrapped((-2 * Math.atan2(turn[1], turn[3])) / RADIANS);
}

/** The turn between two, at share t. */
export function slerp(a, b, t) {
  let cosine = dot(a, b) + a[3] * b[3];
  const sign = cosine < 0 ? -1 : 1;
  cosine = Math.min(1, Math.abs(cosine));
  const angle = Math.acos(cosine);
  const share = (part) => (angle < 1e-4 ? part : Math.sin(part * angle) / Math.sin(angle));
  const [p, q] = [share(1 - t), share(t)];
  return normalized(a.map((value, k) => p * value + sign * q * b[k]));
}

/** Right, up and forward of a camera. */
export function frame(camera) {
  const forward = normalized(add(camera.target, camera.position, -1));
  const right = normalized(cross(forward, camera.up ?? [0, 1, 0]));
  return { right, up: cross(right, forward), forward };
}

const slope = (camera) => Math.tan((camera.fov * RADIANS) / 2);

/** Where a point is seen: shares of the picture's width and height, and its depth; null behind the camera. */
export function seen(camera, aspect, point) {
  const { right, up, forward } = frame(camera);
  const way = add(point, camera.position, -1);
  const depth = dot(way, forward);
  if (depth <= 0) return null;
  const reach = depth * slope(camera);
  return { x: 0.5 + dot(way, right) / (2 * reach * aspect), y: 0.5 - dot(way, up) / (2 * reach), depth };
}

/** How a point at `depth` moves when it is dragged by shares of the picture, in the plane of the picture. */
export function dragged(camera, aspect, depth, dx, dy) {
  const { right, up } = frame(camera);
  const reach = 2 * depth * slope(camera);
  return add(right.map((value) => value * dx * reach * aspect), up, -dy * reach);
}

/** World to clip space, by columns. */
export function clip(camera, aspect, near, far) {
  const { right, up, forward } = frame(camera);
  const tall = 1 / slope(camera);
  const wide = tall / aspect;
  const a = (far + near) / (far - near);
  const b = (-2 * far * near) / (far - near);
  const at = (axis) => -dot(axis, camera.position);
  const rows = [
    [...right.map((v) => v * wide), at(right) * wide],
    [...up.map((v) => v * tall), at(up) * tall],
    [...forward.map((v) => v * a), at(forward) * a + b],
    [...forward, at(forward)],
  ];
  return [0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column]));
}
