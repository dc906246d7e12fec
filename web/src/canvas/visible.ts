// What there is to see in the image at a frame: drawn shapes of the shown layers, marker faces, skeletons.

import { Chunks, numberAt, textAt } from "../chunks";
import type { App } from "../state";
import { objectColor } from "../timeline/colors";
import type { AnnotatedObject } from "../types";
import { type Coordinates, hitScore, type Point, shapeAt, vertices } from "./shapes";

export interface VisibleShape {
  readonly layer: string;
  readonly object: AnnotatedObject;
  readonly coordinates: Coordinates;
  readonly points: readonly Point[];
  /** Whether the shape was drawn at this very frame. */
  readonly key: boolean;
  /** Whether it belongs to the layer that is edited. */
  readonly own: boolean;
}

/** A shape that a hand is holding, not stored yet. */
export interface Preview {
  readonly id: string;
  readonly coordinates: Coordinates;
}

const DRAWN: ReadonlySet<string> = new Set(["rectangle", "polygon", "point", "other"]);

export function visibleShapes(app: App, stream: string, preview: Preview | null): VisibleShape[] {
  const found: VisibleShape[] = [];
  const { frame } = app.cursor;
  for (const { name, document } of app.shownLayers) {
    const own = name === app.activeLayer;
    for (const object of document.objects.list) {
      if (!DRAWN.has(object.kind) || (object.stream && object.stream !== stream)) continue;
      const held = own && preview?.id === object.id ? preview.coordinates : null;
      const shown = held ? { coordinates: held, key: true } : shapeAt(object.key_frames, frame, object.interpolation);
      if (shown !== null)
        found.push({ layer: name, object, own, points: vertices(object.kind, shown.coordinates), ...shown });
    }
  }
  return found;
}

/** The shape that a click at `p` means. */
export function shapeUnder(shapes: readonly VisibleShape[], p: Point, reach: number): VisibleShape | null {
  let best: VisibleShape | null = null;
  let most = 0;
  for (const shape of shapes) {
    const score = hitScore(p, shape.points, reach) * (shape.own ? 1.001 : 1);
    if (score > most) [best, most] = [shape, score];
  }
  return best;
}

export interface Ring {
  readonly object: string;
  readonly color: string;
  readonly points: readonly Point[];
}
export interface Skeleton {
  readonly object: string;
  readonly joints: ReadonlyMap<string, Point>;
  readonly sure: ReadonlySet<string>;
}

const CORNERS = ["u0_px", "v0_px", "u1_px", "v1_px", "u2_px", "v2_px", "u3_px", "v3_px"];

/** Marker faces and joints: measured, so shown but not edited. */
export class Measured {
  private readonly markers: Chunks;
  private readonly joints: Chunks;

  constructor(private readonly app: App, onLoaded: () => void) {
    this.markers = new Chunks(app, "markers_2d", ["object_id", ...CORNERS], onLoaded);
    this.joints = new Chunks(app, "joints", ["object_id", "body", "joint", "u_px", "v_px", "state"], onLoaded);
  }

  /** Fetches again what is shown: it is another by now. */
  renew(): void {
    this.markers.renew();
    this.joints.renew();
  }

  rings(frame: number): Ring[] {
    const rows = this.markers.there ? this.markers.at(frame) : null;
    if (rows === null) return [];
    const rings: Ring[] = [];
    for (let row = rows.from; row < rows.to; row++) {
      const values = CORNERS.map((name) => numberAt(rows.table, name, row));
      if (!values.every(Number.isFinite)) continue;
      const object = textAt(rows.table, "object_id", row);
      rings.push({ object, color: objectColor(this.app, object), points: vertices("polygon", values) });
    }
    return rings;
  }

  skeletons(frame: number): Skeleton[] {
    const rows = this.joints.there ? this.joints.at(frame) : null;
    if (rows === null) return [];
    const bodies = new Map<string, { joints: Map<string, Point>; sure: Set<string> }>();
    for (let row = rows.from; row < rows.to; row++) {
      const [x, y] = [numberAt(rows.table, "u_px", row), numberAt(rows.table, "v_px", row)];
      if (!Number.isFinite(x) || !Number.isFinite(y)) continue;
      const key = textAt(rows.table, "object_id", row) || `body ${numberAt(rows.table, "body", row)}`;
      let body = bodies.get(key);
      if (!body) bodies.set(key, (body = { joints: new Map(), sure: new Set() }));
      const joint = textAt(rows.table, "joint", row);
      body.joints.set(joint, { x, y });
      if (textAt(rows.table, "state", row) === "tracked") body.sure.add(joint);
    }
    return [...bodies].map(([object, body]) => ({ object, ...body }));
  }
}
