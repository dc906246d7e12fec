// Shapes in image pixels: interpolation between key frames, hit tests, and the moves a hand makes of them.
//
// Coordinates as the model has them: rectangle `u, v, width, height`; polygon `u1, v1, u2, v2, ...`; point `u, v`.

export interface Point {
  readonly x: number;
  readonly y: number;
}

export type Coordinates = readonly number[];

export interface Key {
  readonly frame: number;
  readonly present?: boolean;
  readonly coordinates?: Coordinates;
}

export interface Shown {
  readonly coordinates: Coordinates;
  /** Whether somebody drew it at this very frame. */
  readonly key: boolean;
}

/** Position of the last of `count` sorted numbers that is not above `value`, or -1. */
export function lastAtMost(count: number, at: (i: number) => number, value: number): number {
  let low = 0;
  let high = count;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (at(middle) <= value) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** The shape at `frame`: that of the last key frame, or between it and the next where both have as many numbers. */
export function shapeAt(keys: readonly Key[], frame: number, interpolation: "linear" | "hold"): Shown | null {
  const i = lastAtMost(keys.length, (k) => keys[k]!.frame, frame);
  const key = keys[i];
  const from = key?.coordinates ?? [];
  if (!key || key.present === false || !from.length) return null;
  const next = keys[i + 1];
  const to = next?.coordinates ?? [];
  if (key.frame === frame || interpolation === "hold" || !next || next.present === false || to.length !== from.length)
    return { coordinates: from, key: key.frame === frame };
  const weight = (frame - key.frame) / (next.frame - key.frame);
  return { coordinates: from.map((value, k) => value + weight * (to[k]! - value)), key: false };
}

/** The vertices of a shape in drawing order; a rectangle's run clockwise from its top left corner. */
export function vertices(kind: string, coordinates: Coordinates): Point[] {
  if (kind === "rectangle" && coordinates.length === 4) {
    const [u, v, width, height] = coordinates as [number, number, number, number];
    return [
      { x: u, y: v },
      { x: u + width, y: v },
      { x: u + width, y: v + height },
      { x: u, y: v + height },
    ];
  }
  const points: Point[] = [];
  for (let i = 0; i + 1 < coordinates.length; i += 2) points.push({ x: coordinates[i]!, y: coordinates[i + 1]! });
  return points;
}

export function flatten(points: readonly Point[]): number[] {
  return points.flatMap((p) => [p.x, p.y]);
}

export function centroid(points: readonly Point[]): Point {
  const n = points.length || 1;
  return { x: points.reduce((sum, p) => sum + p.x, 0) / n, y: points.reduce((sum, p) => sum + p.y, 0) / n };
}

export function distance(a: Point, b: Point): number {
  return Math.hypot(a.x - b.x, a.y - b.y);
}

/** Distance of `p` from the stretch between `a` and `b`. */
export function distanceToStretch(p: Point, a: Point, b: Point): number {
  const length2 = (b.x - a.x) ** 2 + (b.y - a.y) ** 2;
  const t = length2 ? ((p.x - a.x) * (b.x - a.x) + (p.y - a.y) * (b.y - a.y)) / length2 : 0;
  const along = Math.min(1, Math.max(0, t));
  return distance(p, { x: a.x + along * (b.x - a.x), y: a.y + along * (b.y - a.y) });
}

/** Even-odd rule. */
export function inside(p: Point, ring: readonly Point[]): boolean {
  let within = false;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const a = ring[i]!;
    const b = ring[j]!;
    if (a.y > p.y !== b.y > p.y && p.x < ((b.x - a.x) * (p.y - a.y)) / (b.y - a.y) + a.x) within = !within;
  }
  return within;
}

/**
 * How well a click at `p` means this shape: 0 for not at all; the smaller and nearer the shape, the more, so that what
 * lies inside something larger can be reached (ECAT 2018 file format §2.12).  `reach` is in image pixels.
 */
export function hitScore(p: Point, ring: readonly Point[], reach: number): number {
  if (!ring.length) return 0;
  const near = ring.some((a, i) => distanceToStretch(p, a, ring[(i + 1) % ring.length]!) <= reach);
  if (!near && !(ring.length > 2 && inside(p, ring))) return 0;
  return ring.reduce((sum, v) => sum + 1 / Math.sqrt((v.x - p.x) ** 2 + (v.y - p.y) ** 2 + 1), 0) / ring.length;
}

/** The edge (by its first vertex) whose line passes nearest to `p`, and how near. */
export function nearestEdge(p: Point, ring: readonly Point[]): { edge: number; distance: number } {
  let best = { edge: 0, distance: Number.POSITIVE_INFINITY };
  ring.forEach((a, i) => {
    const far = distanceToStretch(p, a, ring[(i + 1) % ring.length]!);
    if (far < best.distance) best = { edge: i, distance: far };
  });
  return best;
}

/** The rectangle with two opposite corners at `a` and `b`. */
export function rectangleBetween(a: Point, b: Point): [number, number, number, number] {
  return [Math.min(a.x, b.x), Math.min(a.y, b.y), Math.abs(a.x - b.x), Math.abs(a.y - b.y)];
}

/** The eight handles of a rectangle: which way each lies from the centre. */
export const COMPASS = {
  nw: [-1, -1],
  n: [0, -1],
  ne: [1, -1],
  e: [1, 0],
  se: [1, 1],
  s: [0, 1],
  sw: [-1, 1],
  w: [-1, 0],
} as const;
export type Side = keyof typeof COMPASS;

/** A rectangle with one of its handles moved by (dx, dy); a handle pulled across the other side turns it over. */
export function resized(rectangle: Coordinates, side: Side, dx: number, dy: number): number[] {
  const [u, v, width, height] = rectangle as [number, number, number, number];
  const [sx, sy] = COMPASS[side];
  const a = { x: u + (sx < 0 ? dx : 0), y: v + (sy < 0 ? dy : 0) };
  const b = { x: u + width + (sx > 0 ? dx : 0), y: v + height + (sy > 0 ? dy : 0) };
  return rectangleBetween(a, b);
}

export function moved(kind: string, coordinates: Coordinates, dx: number, dy: number): number[] {
  return coordinates.map((value, i) => (kind === "rectangle" && i > 1 ? value : value + (i % 2 ? dy : dx)));
}

/** A shape turned about its centroid; rectangles have no angle and stay as they are. */
export function turned(kind: string, coordinates: Coordinates, angle: number): number[] {
  if (kind === "rectangle") return [...coordinates];
  const points = vertices(kind, coordinates);
  const c = centroid(points);
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return flatten(
    points.map((p) => ({
      x: c.x + cos * (p.x - c.x) - sin * (p.y - c.y),
      y: c.y + sin * (p.x - c.x) + cos * (p.y - c.y),
    })),
  );
}

export function scaled(kind: string, coordinates: Coordinates, factor: number): number[] {
  if (kind === "rectangle") {
    const [u, v, width, height] = coordinates as [number, number, number, number];
    const [w, h] = [width * factor, height * factor];
    return [u + (width - w) / 2, v + (height - h) / 2, w, h];
  }
  const points = vertices(kind, coordinates);
  const c = centroid(points);
  return flatten(points.map((p) => ({ x: c.x + factor * (p.x - c.x), y: c.y + factor * (p.y - c.y) })));
}

/** A hundredth of a pixel is finer than any hand. */
export function rounded(coordinates: Coordinates): number[] {
  return coordinates.map((value) => Math.round(value * 100) / 100);
}
