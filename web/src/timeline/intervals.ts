// Intervals of one lane, sorted by start, of which those in view are found without looking at the others.

import { lastAtMost } from "../canvas/shapes";

export interface Interval {
  readonly start: number;
  readonly end: number;
}

export class Intervals<T extends Interval> {
  readonly items: readonly T[];
  readonly starts: Float64Array;
  /** The latest end up to each item: it never falls, so it can be searched. */
  private readonly reach: Float64Array;

  constructor(items: readonly T[]) {
    this.items = [...items].sort((a, b) => a.start - b.start || b.end - a.end);
    this.starts = Float64Array.from(this.items, (item) => item.start);
    this.reach = new Float64Array(this.items.length);
    let latest = Number.NEGATIVE_INFINITY;
    this.items.forEach((item, i) => {
      latest = Math.max(latest, item.end);
      this.reach[i] = latest;
    });
  }

  /** Positions `[first, last)` among which all items that touch `[from, to)` are. */
  range(from: number, to: number): [number, number] {
    const first = lastAtMost(this.reach.length, (i) => this.reach[i]!, from) + 1;
    return [first, this.firstFrom(to)];
  }

  /** Position of the first item that starts at `frame` or later. */
  firstFrom(frame: number): number {
    let low = 0;
    let high = this.starts.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.starts[middle]! < frame) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** Items that touch `[from, to)`. */
  within(from: number, to: number): T[] {
    const [first, last] = this.range(from, to);
    return this.items.slice(first, last).filter((item) => item.end > from);
  }
}

/** Whether `n` sorted numbers were given: the lanes rely on it. */
export function lowerBound(sorted: ArrayLike<number>, value: number): number {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle]! < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * A lane for each item, from 0, so that no two in a lane overlap: each takes the first that is free, in the order of their
 * starts (interval partitioning: as few lanes as possible).
 */
export function spread(items: readonly Interval[]): Int32Array {
  const lanes = new Int32Array(items.length);
  const order = Array.from(items.keys()).sort((a, b) => items[a]!.start - items[b]!.start || items[b]!.end - items[a]!.end);
  const ends: number[] = [];
  for (const i of order) {
    const item = items[i]!;
    let lane = ends.findIndex((end) => end <= item.start);
    if (lane < 0) lane = ends.push(0) - 1;
    ends[lane] = Math.max(item.end, item.start + 1);
    lanes[i] = lane;
  }
  return lanes;
}
