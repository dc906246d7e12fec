// Points in metres and rotations as unit quaternions x, y, z, w.

export type Vector = readonly [number, number, number];
export type Quaternion = readonly [number, number, number, number];

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a: Vector, k: number): Vector => [a[0] * k, a[1] * k, a[2] * k];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vector, b: Vector): Vector => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const length = (a: Vector): number => Math.hypot(...a);
export const unit = (a: Vector): Vector => times(a, 1 / (length(a) || 1));
export const finite = (a: readonly number[]): boolean => a.every(Number.isFinite);

export function rotate([x, y, z, w]: Quaternion, v: Vector): Vector {
  const u: Vector = [x, y, z];
  const t = times(cross(u, v), 2);
  return add(add(v, times(t, w)), cross(u, t));
}

export const inverse = ([x, y, z, w]: Quaternion): Quaternion => [-x, -y, -z, w];

/** `p = rotation * q + translation`. */
export interface Rigid {
  readonly rotation: Quaternion;
  readonly translation: Vector;
}

export const apply = (pose: Rigid, p: Vector): Vector => add(rotate(pose.rotation, p), pose.translation);

export function inverted({ rotation, translation }: Rigid): Rigid {
  const back = inverse(rotation);
  return { rotation: back, translation: times(rotate(back, translation), -1) };
}
