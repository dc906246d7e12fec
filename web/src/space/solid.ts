// A box as the faces that the eye sees, and its projection.

import type { Seen } from "./orbit";
import { apply, dot, rotate, type Rigid, sub, unit, type Vector } from "./vector";

export interface Face {
  readonly points: readonly Seen[];
  /** How bright it is, 0 to 1. */
  readonly light: number;
  readonly axis: number;
}

const SUN = unit([0.35, -0.5, 0.8]);
/** Corners of each face (signs along the box's axes) and its outward normal. */
const FACES: readonly { corners: readonly Vector[]; normal: Vector; axis: number }[] = [0, 1, 2].flatMap((axis) =>
  [1, -1].map((sign) => {
    const [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
    const corner = (i: number, j: number): Vector => {
      const p = [0, 0, 0];
      p[axis] = sign;
      p[b] = i;
      p[c] = j;
      return p as unknown as Vector;
    };
    const normal = [0, 0, 0];
    normal[axis] = sign;
    return { corners: [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)], normal: normal as unknown as Vector, axis: sign > 0 ? axis : -1 };
  }),
);

/** Faces turned towards `eye`; of a convex body they never hide each other. */
export function visibleFaces(pose: Rigid, size: Vector, eye: Vector, project: (p: Vector) => Seen | null): Face[] {
  const found: Face[] = [];
  for (const face of FACES) {
    const normal = rotate(pose.rotation, face.normal);
    const corners = face.corners.map((c) => apply(pose, [(c[0] * size[0]) / 2, (c[1] * size[1]) / 2, (c[2] * size[2]) / 2]));
    if (dot(normal, sub(eye, corners[0]!)) <= 0) continue;
    const points = corners.map(project);
    if (points.some((p) => p === null)) continue;
    found.push({ points: points as Seen[], light: 0.62 + 0.38 * Math.max(0, dot(normal, SUN)), axis: face.axis });
  }
  return found;
}

/** The corners of the smallest convex polygon around points of a picture, in order (Andrew's monotone chain). */
export function convexOutline<P extends { readonly x: number; readonly y: number }>(points: readonly P[]): P[] {
  const sorted = [...points].sort((a, b) => a.x - b.x || a.y - b.y);
  const half = (list: readonly P[]): P[] => {
    const chain: P[] = [];
    for (const p of list) {
      while (chain.length > 1 && turn(chain.at(-2)!, chain.at(-1)!, p) <= 0) chain.pop();
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return sorted.length < 3 ? sorted : [...half(sorted), ...half([...sorted].reverse())];
}

function turn(a: { x: number; y: number }, b: { x: number; y: number }, c: { x: number; y: number }): number {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}
