// Going from one thing to another in time, and how fast.

import { span } from "./document";
import { type App, MACHINE, type Selected, SPEEDS } from "./state";
import type { EcatEvent, Relation } from "./types";

export function startOf(element: EcatEvent | Relation): number {
  return "segments" in element ? span(element)[0] : element.start_frame;
}

/** Selects an element and moves the cursor to its start. */
export function goTo(app: App, selected: Selected | null): void {
  if (selected === null) return app.select([]);
  app.select([selected]);
  const document = app.layers.get(selected.layer)?.document;
  const element = selected.kind === "event" ? document?.event(selected.id) : selected.kind === "relation" ? document?.relation(selected.id) : undefined;
  if (element !== undefined) app.seek(startOf(element));
  else {
    const first = document?.object(selected.id)?.key_frames.find((k) => k.present);
    if (first !== undefined && app.cursor.frame < first.frame) app.seek(first.frame);
  }
}

/** Selects the previous (-1) or next (+1) event in time among those shown; what is repeated is that one then. */
export function stepEvent(app: App, by: -1 | 1): void {
  const all = app.shownLayers.flatMap((l) => l.document.events.list
    .filter((e) => l.name !== MACHINE || app.decided(e.id) === null)
    .map((e) => ({ layer: l.name, id: e.id, at: span(e) })));
  all.sort((a, b) => a.at[0] - b.at[0] || b.at[1] - a.at[1] || (a.id < b.id ? -1 : 1));
  const now = app.primary?.kind === "event" ? all.findIndex((e) => e.id === app.primary?.id && e.layer === app.primary.layer) : -1;
  const frame = app.cursor.frame;
  const next = now >= 0 ? all[now + by] : by > 0 ? all.find((e) => e.at[0] >= frame) : all.findLast((e) => e.at[0] <= frame);
  if (next === undefined) return;
  goTo(app, { kind: "event", id: next.id, layer: next.layer });
  // a key names the event that is selected: it has to be the one that is seen
  const segment = app.selectedEvent?.segments[0];
  if (app.cursor.loop !== null && segment !== undefined) app.setLoop([segment.start_frame, segment.end_frame]);
}

/** Moves the cursor to the previous or next edge of any shown event. */
export function stepEdge(app: App, by: -1 | 1): void {
  let best: number | null = null;
  const frame = app.cursor.frame;
  for (const layer of app.shownLayers) {
    for (const event of layer.document.events.list) {
      for (const s of event.segments) {
        for (const edge of [s.start_frame, s.end_frame]) {
          if ((edge - frame) * by > 0 && (best === null || Math.abs(edge - frame) < Math.abs(best - frame))) best = edge;
        }
      }
    }
  }
  if (best !== null) app.seek(best);
}

export function changeSpeed(app: App, by: -1 | 1): void {
  const now = SPEEDS.findIndex((s) => s >= app.cursor.speed - 1e-6);
  app.setSpeed(SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, (now < 0 ? SPEEDS.length : now) + by))] ?? 1);
}
