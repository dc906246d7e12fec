// What lies under the pointer.

import type { Axis } from "./axis";
import type { Bar, Row } from "./lanes";

export type Zone = "start" | "end" | "body";

export interface Hit {
  readonly row: Row;
  readonly index: number;
  readonly bar: Bar | null;
  readonly zone: Zone;
  /** Frame of the key under the pointer, in an object's lane. */
  readonly key: number | null;
}

const EDGE_PX = 5;
/** Of a bar that is narrower than this, the edges are taken from outside only. */
const NARROW_PX = 16;

export function hitBar(axis: Axis, bars: readonly Bar[], x: number, prefer: (bar: Bar) => boolean): { bar: Bar; zone: Zone } | null {
  let best: { bar: Bar; zone: Zone; score: number } | null = null;
  for (const bar of bars) {
    const [from, to] = [axis.x(bar.start), Math.max(axis.x(bar.end), axis.x(bar.start) + 2)];
    if (x < from - EDGE_PX || x > to + EDGE_PX) continue;
    const inner = to - from < NARROW_PX ? (to - from) / 4 : EDGE_PX;
    const zone: Zone = x < from + inner ? "start" : x > to - inner ? "end" : "body";
    const within = x >= from && x <= to;
    // of two that touch, the chosen one has its edge; else the one that the pointer is in
    const score = (within ? 2 : 0) + (prefer(bar) ? 3 : 0);
    if (best === null || score > best.score) best = { bar, zone, score };
  }
  return best;
}

export function hitRow(row: Row, index: number, axis: Axis, x: number, prefer: (bar: Bar) => boolean): Hit {
  const nothing: Hit = { row, index, bar: null, zone: "body", key: null };
  if (row.kind === "bars") {
    const near = EDGE_PX / axis.pxPerFrame + 1;
    const found = hitBar(axis, row.bars.within(axis.frame(x) - near, axis.frame(x) + near), x, prefer);
    return found ? { ...nothing, ...found } : nothing;
  }
  if (row.kind === "object") {
    const key = row.object.key_frames.find((k) => Math.abs(axis.x(k.frame + 0.5) - x) <= EDGE_PX);
    return { ...nothing, key: key?.frame ?? null };
  }
  return nothing;
}
