// Edges and bars in the hand: where they may go, what they snap to, and the operation that stores it.

import { acceptSelected, attempt, newEvent } from "../actions";
import { span } from "../document";
import { type App, MACHINE } from "../state";
import type { EcatEvent } from "../types";
import type { Axis } from "./axis";
import { snap } from "./axis";
import type { Zone } from "./hit";
import type { Bar, BarRow } from "./lanes";
import type { Ghost } from "./paint";

/** How near, in CSS pixels, an edge comes before it snaps. */
const SNAP_PX = 7;

export interface Drag {
  /** What is held, for painting; a draft has the id "". */
  ghost: Ghost;
  readonly row: BarRow;
  readonly zone: Zone;
  readonly grabbed: number;
  readonly original: { start: number; end: number };
  readonly limits: { start: number; end: number };
  readonly targets: readonly number[];
  /** The frame that an edge snapped to. */
  snapped: number | null;
  moved: boolean;
}

/** Frames that an edge may snap to: edges in view, the cursor, the marks. */
function snapTargets(app: App, axis: Axis, rows: readonly BarRow[], held: Bar | null): number[] {
  const { start, end } = app.marks;
  const found = [app.cursor.frame, 0, app.nFrames];
  if (start !== null) found.push(start);
  if (end !== null) found.push(end);
  for (const row of rows)
    for (const bar of row.bars.within(axis.first, axis.last)) if (bar.id !== held?.id || bar.what !== held.what || bar.segment !== held.segment) found.push(bar.start, bar.end);
  return found;
}

/** How far an event may reach: its parent's span, or the recording; and its neighbours in time among its own segments. */
function limitsOf(app: App, row: BarRow, bar: Bar): { start: number; end: number } {
  const all = { start: 0, end: app.nFrames };
  if (bar.what !== "event") return all;
  const document = app.layers.get(row.layer)?.document;
  const event = document?.event(bar.id);
  const parent = event?.parent != null ? document?.event(event.parent) : undefined;
  const [start, end] = parent ? span(parent) : [0, app.nFrames];
  const before = event?.segments[bar.segment - 1]?.end_frame ?? start;
  const after = event?.segments[bar.segment + 1]?.start_frame ?? end;
  return { start: Math.max(start, before), end: Math.min(end, after) };
}

export function pickUp(app: App, axis: Axis, rows: readonly BarRow[], row: BarRow, bar: Bar, zone: Zone, frame: number): Drag {
  const { start, end } = bar;
  return {
    row, zone, grabbed: frame, original: { start, end }, moved: false, snapped: null,
    ghost: { layer: row.layer, what: bar.what, id: bar.id, segment: bar.segment, start, end },
    limits: limitsOf(app, row, bar), targets: snapTargets(app, axis, rows, bar),
  };
}

export function beginDraft(app: App, axis: Axis, rows: readonly BarRow[], row: BarRow, frame: number): Drag {
  const targets = snapTargets(app, axis, rows, null);
  const at = Math.max(0, Math.min(app.nFrames, snap(frame, targets, SNAP_PX / axis.pxPerFrame).frame));
  return {
    row, zone: "end", grabbed: at, original: { start: at, end: at }, moved: false, snapped: null,
    ghost: { layer: row.layer, what: "event", id: "", segment: 0, start: at, end: at },
    limits: { start: 0, end: app.nFrames }, targets,
  };
}

/** The bar follows the hand; `free`: without snapping. */
export function pull(drag: Drag, axis: Axis, frame: number, free: boolean): void {
  const reach = free ? -1 : SNAP_PX / axis.pxPerFrame;
  const { original, limits, ghost } = drag;
  const by = frame - drag.grabbed;
  drag.moved = true;
  const place = (wanted: number) => {
    const { frame: at, snapped } = snap(wanted, drag.targets, reach);
    drag.snapped = snapped ? at : null;
    return at;
  };
  if (ghost.id === "") {
    const at = Math.max(limits.start, Math.min(limits.end, place(frame)));
    drag.ghost = { ...ghost, start: Math.min(original.start, at), end: Math.max(original.start, at) };
  } else if (drag.zone === "start") {
    drag.ghost = { ...ghost, start: Math.max(limits.start, Math.min(ghost.end - 1, place(original.start + by))) };
  } else if (drag.zone === "end") {
    drag.ghost = { ...ghost, end: Math.min(limits.end, Math.max(ghost.start + 1, place(original.end + by))) };
  } else {
    const length = original.end - original.start;
    const start = place(original.start + by);
    const other = snap(original.end + by, drag.targets, reach);
    const wanted = drag.snapped === null && other.snapped ? other.frame - length : start;
    if (drag.snapped === null && other.snapped) drag.snapped = other.frame;
    const kept = Math.max(limits.start, Math.min(limits.end - length, wanted));
    drag.ghost = { ...ghost, start: kept, end: kept + length };
  }
}

/** The frame that the video shows while something is dragged. */
export function shownFrame(drag: Drag): number {
  return drag.zone === "end" ? Math.max(drag.ghost.start, drag.ghost.end - 1) : drag.ghost.start;
}

/** Sub-events that would stick out of an event when it is `[start, end)`. */
export function stickingOut(app: App, event: EcatEvent, start: number, end: number): EcatEvent[] {
  return app.document.children(event.id).filter((child) => {
    const [from, to] = span(child);
    return from < start || to > end;
  });
}

/** Stores what was dragged.  `clip` says what to do with sub-events that would stick out; false: leave all as it was. */
export async function drop(app: App, drag: Drag, clip: (children: EcatEvent[]) => Promise<boolean>): Promise<void> {
  const { ghost, original, zone, row } = drag;
  if (ghost.id === "") {
    if (ghost.end > ghost.start) await create(app, row, ghost.start, ghost.end);
    return;
  }
  if (ghost.start === original.start && ghost.end === original.end) return;
  if (row.layer === MACHINE) {
    await acceptSelected(app, { start_frame: ghost.start, end_frame: ghost.end });
    return;
  }
  if (ghost.what === "relation") {
    await attempt(app, { op: "edit_relation", id: ghost.id, start_frame: ghost.start, ...(zone === "start" ? {} : { end_frame: ghost.end }) });
    return;
  }
  const event = app.document.event(ghost.id);
  if (event === undefined) return;
  if (zone === "body" && event.segments.length === 1) {
    await attempt(app, { op: "move_event", id: ghost.id, frames: ghost.start - original.start });
    return;
  }
  if (zone === "body") {
    const segments = event.segments.map((s, i) => (i === ghost.segment ? [ghost.start, ghost.end] : [s.start_frame, s.end_frame]));
    await attempt(app, { op: "set_segments", id: ghost.id, segments });
    return;
  }
  const frame = zone === "start" ? ghost.start : ghost.end;
  const [from, to] = span(event);
  const out = stickingOut(app, event, zone === "start" && ghost.segment === 0 ? frame : from,
    zone === "end" && ghost.segment === event.segments.length - 1 ? frame : to);
  if (out.length && !(await clip(out))) return;
  await attempt(app, { op: "move_edge", id: ghost.id, segment: ghost.segment, edge: zone, frame, ...(out.length ? { children: "clip" } : {}) });
}

/** A new event in a lane: of the type used last if that lives there, else of the tier's first. */
async function create(app: App, row: BarRow, start: number, end: number): Promise<void> {
  const types = app.scheme.event_types.filter((type) => type.tier === row.tier);
  const type = types.find((t) => t.name === app.settings.lastType) ?? types[0];
  if (type !== undefined) {
    await newEvent(app, type.name, [start, end]);
    return;
  }
  const record = await attempt(app, { op: "add_event", tier: row.tier, segments: [[start, end]] });
  const made = record?.changes.find((change) => change.kind === "event" && change.before === null);
  if (made) app.select([{ kind: "event", id: made.id, layer: app.activeLayer }]);
}
