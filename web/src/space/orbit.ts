// An eye that goes around a point, and what it sees: perspective, z up.

import { add, cross, dot, sub, times, unit, type Vector } from "./vector";

export interface Seen {
  readonly x: number;
  readonly y: number;
  /** Distance along the sight line, metres. */
  readonly depth: number;
}

const LEAST_M = 0.15;
const MOST_M = 12;
/** Nearer than this nothing is drawn. */
const NEAR_M = 0.03;
const HALF_VIEW_RAD = (21 * Math.PI) / 180;

export class Orbit {
  target: Vector = [0, 0, 0];
  distance = 1.6;
  /** About z from the x axis, and above the table. */
  azimuth = -Math.PI / 2;
  elevation = 0.6;
  width = 1;
  height = 1;
  /** Left and right exchanged, as in the images of a mirrored camera. */
  flipped = false;

  get eye(): Vector {
    const flat = Math.cos(this.elevation);
    const way: Vector = [flat * Math.cos(this.azimuth), flat * Math.sin(this.azimuth), Math.sin(this.elevation)];
    return add(this.target, times(way, this.distance));
  }

  /** Right, up and forward of the eye. */
  axes(): [Vector, Vector, Vector] {
    const forward = unit(sub(this.target, this.eye));
    const right: Vector = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    return [right, cross(right, forward), forward];
  }

  private get focal(): number {
    return Math.min(this.width, this.height) / 2 / Math.tan(HALF_VIEW_RAD);
  }

  projector(): (p: Vector) => Seen | null {
    const [right, up, forward] = this.axes();
    const { eye, focal } = this;
    const [cx, cy] = [this.width / 2, this.height / 2];
    const side = this.flipped ? -focal : focal;
    return (p) => {
      const d = sub(p, eye);
      const depth = dot(d, forward);
      if (depth < NEAR_M) return null;
      return { x: cx + (side * dot(d, right)) / depth, y: cy - (focal * dot(d, up)) / depth, depth };
    };
  }

  turn(dx: number, dy: number): void {
    this.azimuth -= (this.flipped ? -dx : dx) / 150;
    this.elevation = Math.max(-0.2, Math.min(Math.PI / 2 - 1e-3, this.elevation + dy / 150));
  }

  pan(dx: number, dy: number): void {
    const [right, up] = this.axes();
    const scale = this.distance / this.focal;
    this.target = add(this.target, add(times(right, (this.flipped ? dx : -dx) * scale), times(up, dy * scale)));
  }

  zoom(factor: number): void {
    this.distance = Math.max(LEAST_M, Math.min(MOST_M, this.distance * factor));
  }

  /** Stands at `eye` and looks at `target`. */
  look(eye: Vector, target: Vector): void {
    const way = sub(eye, target);
    this.target = target;
    this.distance = Math.max(LEAST_M, Math.min(MOST_M, Math.hypot(...way)));
    this.azimuth = Math.atan2(way[1], way[0]);
    this.elevation = Math.max(-0.2, Math.min(Math.PI / 2 - 1e-3, Math.asin(Math.max(-1, Math.min(1, way[2] / Math.hypot(...way))))));
  }

  /** Sees everything within `radius` of `target` from the direction it has. */
  frame(target: Vector, radius: number): void {
    this.target = target;
    this.distance = Math.max(LEAST_M, Math.min(MOST_M, (radius / Math.sin(HALF_VIEW_RAD)) * 0.86));
  }
}
