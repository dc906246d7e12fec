// Painting of the lanes: only what is in view, and of what is too small to be told apart no more than its colour.

import type { App } from "../state";
import { palette, type Palette } from "../theme";
import { type Axis, frameTicks, timeTicks } from "./axis";
import { inkOn, withAlpha } from "./colors";
import { lowerBound } from "./intervals";
import { type Bar, type BarRow, type ObjectRow, presence, type Row, ROW_PX } from "./lanes";
import { fitted } from "./surface";

/** Bars narrower than this are merged. */
const LEAST_PX = 2;
const BAR_INSET = 3;

/** A bar that a hand is holding: where it would be stored. */
export interface Ghost {
  readonly layer: string;
  readonly what: Bar["what"];
  readonly id: string;
  readonly segment: number;
  readonly start: number;
  readonly end: number;
}

export interface LanePaint {
  readonly context: CanvasRenderingContext2D;
  readonly axis: Axis;
  readonly app: App;
  readonly colors: Palette;
  readonly selected: ReadonlySet<string>;
  readonly ghosts: readonly Ghost[];
}

export function barKey(layer: string, what: Bar["what"], id: string): string {
  return `${layer}/${what}/${id}`;
}

export function paintRow(paint: LanePaint, row: Row, y: number): void {
  const { context, axis, colors } = paint;
  context.fillStyle = row.kind === "group" ? colors.raised : colors.surface;
  context.fillRect(0, y, axis.width, row.height);
  context.fillStyle = colors.line;
  context.fillRect(0, y + row.height - 1, axis.width, 1);
  if (row.kind === "bars") paintBars(paint, row, y);
  else if (row.kind === "object") paintObject(paint, row, y);
}

function paintBars(paint: LanePaint, row: BarRow, y: number): void {
  const { axis, selected, ghosts } = paint;
  const { items } = row.bars;
  const [first, last] = row.bars.range(axis.first - 1, axis.last + 1);
  const later: Bar[] = [];
  for (let i = first; i < last; i++) {
    const bar = items[i]!;
    if (bar.end < axis.first) continue;
    const x = axis.x(bar.start);
    const width = (bar.end - bar.start) * axis.pxPerFrame;
    if (selected.has(barKey(row.layer, bar.what, bar.id))) {
      later.push(bar);
      continue;
    }
    if (width >= LEAST_PX) paintBar(paint, row, bar, bar.start, bar.end, y, false);
    else {
      paintSliver(paint, bar, x, y);
      // whatever starts within the same pixel would be painted over it
      i = Math.max(i, row.bars.firstFrom(axis.frame(Math.floor(x) + 1)) - 1);
    }
  }
  for (const bar of later) {
    const held = ghosts.find((g) => g.id === bar.id && g.what === bar.what && g.layer === row.layer && g.segment === bar.segment);
    paintBar(paint, row, bar, held?.start ?? bar.start, held?.end ?? bar.end, y, true);
  }
  if (row.broken) paintConnections(paint, row, first, last, y);
}

function paintSliver({ context }: LanePaint, bar: Bar, x: number, y: number): void {
  context.fillStyle = withAlpha(bar.color, bar.hollow ? 0.45 : 0.9);
  context.fillRect(Math.floor(x), y + BAR_INSET, 1, ROW_PX - 2 * BAR_INSET - 1);
}

function paintBar(paint: LanePaint, row: BarRow, bar: Bar, start: number, end: number, y: number, chosen: boolean): void {
  const { context, axis, colors } = paint;
  // a bar is cut where nobody sees it: rounded corners a million pixels away are slow
  const from = Math.max(-8, axis.x(start));
  const to = Math.min(axis.width + 8, axis.x(end));
  const width = Math.max(LEAST_PX, to - from - 1);
  const height = row.height - 2 * BAR_INSET - 1;
  context.beginPath();
  context.roundRect(from + 0.5, y + BAR_INSET, width, height, Math.min(3, width / 3));
  context.fillStyle = bar.hollow ? withAlpha(bar.color, 0.1) : withAlpha(bar.color, bar.denied ? 0.25 : bar.unsure ? 0.55 : 0.92);
  context.fill();
  if (bar.hollow || bar.unsure || bar.denied) {
    context.setLineDash(bar.hollow ? [] : [3, 2]);
    context.strokeStyle = bar.color;
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  }
  if (chosen) {
    context.strokeStyle = colors.text;
    context.lineWidth = 2;
    context.stroke();
  }
  if (width < 22) return;
  const text = fitted(context, bar.label, width - 8);
  if (!text) return;
  context.fillStyle = bar.hollow || bar.denied || bar.unsure ? colors.text : inkOn(bar.color);
  context.fillText(text, Math.max(from, 0) + 5, y + row.height / 2);
}

/** Thin lines between the segments of one event. */
function paintConnections({ context, axis }: LanePaint, row: BarRow, first: number, last: number, y: number): void {
  const ends = new Map<string, number>();
  const { items } = row.bars;
  for (let i = first; i < last; i++) {
    const bar = items[i]!;
    if (bar.segments < 2) continue;
    const before = ends.get(bar.id);
    if (before !== undefined && before < bar.start) {
      context.fillStyle = bar.color;
      context.fillRect(axis.x(before), y + row.height / 2 - 1, (bar.start - before) * axis.pxPerFrame, 1.5);
    }
    ends.set(bar.id, Math.max(before ?? 0, bar.end));
  }
}

/** A new event as it would be. */
export function paintDraft({ context, axis, colors }: LanePaint, start: number, end: number, y: number, height: number): void {
  const x = axis.x(start);
  const width = Math.max(LEAST_PX, (end - start) * axis.pxPerFrame);
  context.beginPath();
  context.roundRect(x, y + BAR_INSET, width, height - 2 * BAR_INSET - 1, 3);
  context.fillStyle = withAlpha(colors.accent, 0.25);
  context.fill();
  context.setLineDash([4, 3]);
  context.strokeStyle = colors.accent;
  context.lineWidth = 1.5;
  context.stroke();
  context.setLineDash([]);
}

function paintObject(paint: LanePaint, row: ObjectRow, y: number): void {
  const { context, axis, app, colors, selected } = paint;
  const { object } = row;
  const middle = y + row.height / 2;
  const color = object.color.slice(0, 7);
  if (selected.has(`${row.layer}/object/${object.id}`)) {
    context.fillStyle = colors.soft;
    context.fillRect(0, y, axis.width, row.height - 1);
  }
  if (!object.key_frames.length) {
    // its marks or joints are in a table: nobody says when it is there
    context.fillStyle = withAlpha(color, 0.35);
    context.fillRect(axis.x(0), middle - 1, axis.nFrames * axis.pxPerFrame, 1.5);
  }
  for (const { start, end } of presence(object, app.nFrames)) {
    if (end < axis.first || start > axis.last) continue;
    const x = Math.max(0, axis.x(start));
    context.fillStyle = withAlpha(color, 0.55);
    context.fillRect(x, middle - 3, Math.max(1, Math.min(axis.width, axis.x(end)) - x), 6);
  }
  paintKeys(paint, object.key_frames, middle);
  context.fillStyle = colors.good;
  let seen = Number.NEGATIVE_INFINITY;
  for (let i = lowerBound(row.relationFrames, axis.first - 1); i < row.relationFrames.length; i++) {
    const x = axis.x(row.relationFrames[i]!);
    if (x > axis.width) break;
    if (x < seen + 2) continue;
    seen = x;
    context.fillRect(Math.round(x), y + row.height - 6, 2, 5);
  }
}

function paintKeys({ context, axis, colors }: LanePaint, keys: ObjectRow["object"]["key_frames"], middle: number): void {
  const frames = keys.length;
  let low = 0;
  let high = frames;
  while (low < high) {
    const at = (low + high) >> 1;
    if (keys[at]!.frame < axis.first - 8 / axis.pxPerFrame) low = at + 1;
    else high = at;
  }
  let seen = Number.NEGATIVE_INFINITY;
  context.lineWidth = 1;
  for (let i = low; i < frames; i++) {
    const key = keys[i]!;
    const x = axis.x(key.frame + 0.5);
    if (x > axis.width + 8) break;
    if (x < seen + 2) continue;
    seen = x;
    context.beginPath();
    context.moveTo(x, middle - 4.5);
    context.lineTo(x + 4, middle);
    context.lineTo(x, middle + 4.5);
    context.lineTo(x - 4, middle);
    context.closePath();
    context.fillStyle = key.present ? colors.text : colors.surface;
    context.fill();
    context.strokeStyle = key.present ? colors.surface : colors.text;
    context.stroke();
  }
}

/** Time above, frames below, and what is marked. */
export function paintRuler(context: CanvasRenderingContext2D, axis: Axis, app: App, height: number): void {
  const colors = palette();
  context.fillStyle = colors.raised;
  context.fillRect(0, 0, axis.width, height);
  const shade = (start: number, end: number, color: string) => {
    context.fillStyle = color;
    context.fillRect(axis.x(start), 0, Math.max(1, (end - start) * axis.pxPerFrame), height);
  };
  const { loop } = app.cursor;
  if (loop !== null) shade(loop[0], loop[1], withAlpha(colors.warn, 0.22));
  const { start, end } = app.marks;
  if (start !== null && end !== null) shade(Math.min(start, end), Math.max(start, end), withAlpha(colors.accent, 0.25));
  context.font = `11px ${colors.font}`;
  context.textBaseline = "middle";
  const times = app.times !== null && app.times.length > 1 ? timeTicks(axis, app.times) : [];
  const row = (ticks: readonly { frame: number; label: string }[], y: number, ink: string, from: number, to: number) => {
    for (const tick of ticks) {
      const x = Math.round(axis.x(tick.frame));
      context.fillStyle = colors.strong;
      context.fillRect(x, from, 1, to - from);
      context.fillStyle = ink;
      context.fillText(tick.label, x + 4, y);
    }
  };
  row(times, 8, colors.text, 0, 15);
  row(frameTicks(axis), times.length ? 22 : 15, colors.muted, times.length ? 16 : 4, height);
  for (const [frame, sign] of [[start, "I"], [end, "O"]] as const) {
    if (frame === null) continue;
    const x = axis.x(frame);
    context.fillStyle = colors.accent;
    context.fillRect(x, 0, 1.5, height);
    context.font = `bold 10px ${colors.font}`;
    context.fillText(sign, sign === "I" ? x + 4 : x - 11, height - 7);
  }
  context.fillStyle = colors.line;
  context.fillRect(0, height - 1, axis.width, 1);
}
