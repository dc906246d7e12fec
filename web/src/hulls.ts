// Convex hulls of drawn objects, from depth: what `Generate 3-D` makes of the shapes that somebody drew.

import { Chunks, numberAt, textAt } from "./chunks";
import { follow } from "./jobs";
import { finite, type Vector } from "./space/vector";
import type { App } from "./state";
import type { AnnotatedObject } from "./types";

export interface Hull {
  readonly object: string;
  /** Corners in no particular order, metres in `camera/depth`. */
  readonly corners: readonly Vector[];
  /** Of the shape that it was seen in: drawn, tracked, proposed. */
  readonly status: string;
}

/** Frames from one image of depth to the next, at most. */
const MOST_BETWEEN = 4;

const known = new WeakMap<App, Hulls>();

export function hullsOf(app: App): Hulls {
  const found = known.get(app) ?? new Hulls(app);
  known.set(app, found);
  return found;
}

export class Hulls {
  private readonly chunks: Chunks;
  private readonly listeners = new Set<() => void>();

  constructor(app: App) {
    this.chunks = new Chunks(app, "hulls", ["object_id", "x", "y", "z", "status"], () => this.listeners.forEach((f) => f()));
    app.on("tables", () => this.chunks.renew());
    app.on("session", (session) => session === null && this.chunks.clear());
  }

  get there(): boolean {
    return this.chunks.there;
  }

  onLoaded(listener: () => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /** Those of a frame; depth may have fewer images than colour, and what it saw last holds until the next. */
  at(frame: number): Hull[] {
    if (!this.there) return [];
    for (let at = frame; at >= 0 && at > frame - MOST_BETWEEN; at--) {
      const found = this.exactlyAt(at);
      if (found.length > 0) return found;
    }
    return [];
  }

  private exactlyAt(frame: number): Hull[] {
    const rows = this.chunks.at(frame);
    if (rows === null) return [];
    const found = new Map<string, { object: string; corners: Vector[]; status: string }>();
    for (let row = rows.from; row < rows.to; row++) {
      const corner: Vector = [numberAt(rows.table, "x", row), numberAt(rows.table, "y", row), numberAt(rows.table, "z", row)];
      if (!finite(corner)) continue;
      const object = textAt(rows.table, "object_id", row);
      let hull = found.get(object);
      if (!hull) found.set(object, (hull = { object, corners: [], status: textAt(rows.table, "status", row) }));
      hull.corners.push(corner);
    }
    return [...found.values()];
  }
}

/** How far it reaches along the camera's axes, metres. */
export function extent(corners: readonly Vector[]): Vector {
  const reach = (axis: 0 | 1 | 2): number => Math.max(...corners.map((c) => c[axis])) - Math.min(...corners.map((c) => c[axis]));
  return [reach(0), reach(1), reach(2)];
}

export function canHaveHulls(app: App): boolean {
  const there = (kind: string): boolean => app.session?.streams.some((s) => s.kind === kind && s.present) ?? false;
  return there("color") && there("depth");
}

/** Follows every drawn shape through the images and finds its hull where there is depth. */
export async function generateHulls(app: App, object: AnnotatedObject): Promise<void> {
  const sid = app.session?.id;
  if (sid === undefined) return;
  const job = await follow(app, "Generating 3-D", () => app.api.process(sid, ["plane", "hull"]));
  if (job === null || app.session?.id !== sid) return;
  const why = (job.result?.not_applicable as Record<string, string> | undefined)?.hull;
  if (why !== undefined) return app.notify("There is no 3-D to be had.", why);
  // where the server's own news come later than this
  await app.refreshSession();
  app.emitTables();
  const ran = (job.result?.ran as string[] | undefined)?.includes("hull");
  app.notify(ran ? `3-D of ${object.name || object.id} is there.` : "It was up to date already.", "The 3-D view shows the hull where depth sees the object.");
}
