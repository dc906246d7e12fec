// What stands in space at a frame, in the `table` frame: metres, z up.

import { Chunks, numberAt, textAt } from "../chunks";
import { type Hull, hullsOf } from "../hulls";
import type { App } from "../state";
import type { Camera, Plane } from "../types";
import { add, apply, finite, inverted, type Quaternion, type Rigid, times, type Vector } from "./vector";

export interface Box {
  readonly object: string;
  readonly name: string;
  readonly pose: Rigid;
  readonly size: Vector;
  /** On the table, lifted, or only known from its neighbours in time. */
  readonly state: "table" | "free" | "interpolated";
}
export interface Body {
  readonly joints: ReadonlyMap<string, Vector>;
  readonly sure: ReadonlySet<string>;
}
export interface Eye {
  readonly at: Vector;
  readonly corners: readonly Vector[];
  readonly ahead: Vector;
  readonly mirrored: boolean;
}

/** Without a table the camera is taken to look straight ahead: right, down, forward turn to right, forward, up. */
const UPRIGHT: Rigid = { rotation: [-Math.SQRT1_2, 0, 0, Math.SQRT1_2], translation: [0, 0, 0] };
const UNKNOWN_SIZE: Vector = [0.03, 0.03, 0.03];
const TRAIL_S = 2;
const FRUSTUM_M = 0.18;
const MARGIN_M = 0.2;

export class Scene {
  readonly tableFromCamera: Rigid;
  /** The table's edge where it was seen. */
  private readonly seen: readonly Vector[];
  /** What boxes were ever met, in the table's plane: least and largest x and y. */
  private reach: [number, number, number, number] | null = null;
  readonly eye: Eye | null;
  private readonly poses: Chunks;
  private readonly joints: Chunks;
  private readonly sizes: ReadonlyMap<string, { name: string; size: Vector }>;

  constructor(
    private readonly app: App,
    onLoaded: () => void,
  ) {
    const plane = app.session?.plane ?? null;
    this.tableFromCamera = tableFromCamera(plane);
    this.seen = (plane?.outline ?? []).filter(known).map((p) => apply(this.tableFromCamera, p));
    const tables = app.session?.tables ?? [];
    const poses = tables.includes("poses_smooth") ? "poses_smooth" : "poses";
    this.poses = new Chunks(app, poses, ["object_id", "x", "y", "z", "qx", "qy", "qz", "qw", "source", "support"], onLoaded);
    this.joints = new Chunks(app, "joints", ["object_id", "body", "joint", "x", "y", "z", "state"], onLoaded);
    this.sizes = new Map((app.session?.boxes ?? []).map((box) => [box.object_id, { name: box.name, size: box.size_m ?? UNKNOWN_SIZE }]));
    const cameras = app.session?.cameras ?? [];
    const camera = cameras.find((c) => c.name === "color") ?? cameras[0];
    this.eye = camera && (this.poses.there || this.joints.there || plane || hullsOf(app).there) ? this.frustum(camera) : null;
  }

  get there(): boolean {
    return this.poses.there || this.joints.there || this.seen.length > 0 || hullsOf(this.app).there;
  }

  /** Whether anybody knows where the table is; without one the axes are the camera's. */
  get hasTable(): boolean {
    return (this.app.session?.plane ?? null) !== null || this.outline.length > 0;
  }

  /** The table's edge; a rectangle around all that stood on it, where nobody saw the edge. */
  get outline(): readonly Vector[] {
    if (this.seen.length > 2) return this.seen;
    if (this.reach === null) return [];
    const [x0, y0, x1, y1] = this.reach;
    return [[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]];
  }

  private meet([x, y]: Vector): void {
    const r = this.reach ?? [x - MARGIN_M, y - MARGIN_M, x + MARGIN_M, y + MARGIN_M];
    this.reach = [Math.min(r[0], x - MARGIN_M), Math.min(r[1], y - MARGIN_M), Math.max(r[2], x + MARGIN_M), Math.max(r[3], y + MARGIN_M)];
  }

  private frustum(camera: Camera): Eye {
    const depthFromCamera: Rigid = { rotation: camera.rotation as unknown as Quaternion, translation: camera.translation_m as unknown as Vector };
    const place = (p: Vector) => apply(this.tableFromCamera, apply(depthFromCamera, p));
    const corner = (u: number, v: number): Vector =>
      place(times([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, 1], FRUSTUM_M));
    const [w, h] = [camera.width_px, camera.height_px];
    return { at: place([0, 0, 0]), corners: [corner(0, 0), corner(w, 0), corner(w, h), corner(0, h)], ahead: place([0, 0, 1]), mirrored: camera.mirrored };
  }

  boxes(frame: number): Box[] {
    const rows = this.poses.there ? this.poses.at(frame) : null;
    if (rows === null) return [];
    const found: Box[] = [];
    for (let row = rows.from; row < rows.to; row++) {
      const n = (name: string) => numberAt(rows.table, name, row);
      const at: Vector = [n("x"), n("y"), n("z")];
      const rotation: Quaternion = [n("qx"), n("qy"), n("qz"), n("qw")];
      if (!finite(at) || !finite(rotation)) continue;
      this.meet(at);
      const object = textAt(rows.table, "object_id", row);
      const known = this.sizes.get(object);
      const state = textAt(rows.table, "source", row) === "interpolated" ? "interpolated" : textAt(rows.table, "support", row) === "free" ? "free" : "table";
      found.push({ object, name: this.nameOf(object), size: known?.size ?? UNKNOWN_SIZE, pose: { rotation, translation: at }, state });
    }
    return found;
  }

  nameOf(object: string): string {
    return this.app.shownLayers.map(({ document }) => document.object(object)?.name).find(Boolean) ?? this.sizes.get(object)?.name ?? object;
  }

  /** What depth sees of drawn objects. */
  hulls(frame: number): Hull[] {
    return hullsOf(this.app).at(frame).map((hull) => ({ ...hull, corners: hull.corners.map((c) => apply(this.tableFromCamera, c)) }));
  }

  bodies(frame: number): Body[] {
    const rows = this.joints.there ? this.joints.at(frame) : null;
    if (rows === null) return [];
    const bodies = new Map<string, { joints: Map<string, Vector>; sure: Set<string> }>();
    for (let row = rows.from; row < rows.to; row++) {
      const n = (name: string) => numberAt(rows.table, name, row);
      const at: Vector = [n("x"), n("y"), n("z")];
      if (!finite(at)) continue;
      const key = textAt(rows.table, "object_id", row) || String(n("body"));
      let body = bodies.get(key);
      if (!body) bodies.set(key, (body = { joints: new Map(), sure: new Set() }));
      const joint = textAt(rows.table, "joint", row);
      body.joints.set(joint, apply(this.tableFromCamera, at));
      if (textAt(rows.table, "state", row) === "tracked") body.sure.add(joint);
    }
    return [...bodies.values()];
  }

  /** Where each box has been in the last seconds, oldest first. */
  trails(frame: number): Map<string, Vector[]> {
    const trails = new Map<string, Vector[]>();
    const length = Math.round(TRAIL_S * (this.app.session?.frame_rate_median ?? 30));
    const from = Math.max(0, frame - length);
    for (let at = from; at <= frame; at++) {
      const rows = this.poses.there ? this.poses.at(at) : null;
      for (let row = rows?.from ?? 0; row < (rows?.to ?? 0); row++) {
        const p: Vector = [numberAt(rows!.table, "x", row), numberAt(rows!.table, "y", row), numberAt(rows!.table, "z", row)];
        if (!finite(p)) continue;
        const object = textAt(rows!.table, "object_id", row);
        const list = trails.get(object);
        if (list) list.push(p);
        else trails.set(object, [p]);
      }
    }
    return trails;
  }

  /** Where to look at first: the middle of the table or of what stands there, and how far it reaches. */
  middle(): { at: Vector; radius: number } {
    this.boxes(this.app.cursor.frame);
    const points: Vector[] = [...this.outline];
    if (!points.length) for (const hull of this.hulls(this.app.cursor.frame)) points.push(...hull.corners);
    if (!points.length) for (const body of this.bodies(this.app.cursor.frame)) points.push(...body.joints.values());
    if (!points.length) return { at: [0, 0, 0], radius: 0.7 };
    const at = times(points.reduce((a, b) => add(a, b), [0, 0, 0] as Vector), 1 / points.length);
    const radius = Math.max(0.3, ...points.map((p) => Math.hypot(p[0] - at[0], p[1] - at[1], p[2] - at[2])));
    // whoever sits at the table reaches above it
    return { at, radius: Math.min(2.5, this.joints.there ? 1.3 * radius : radius) };
  }
}

function known(p: readonly (number | null)[]): p is Vector & (number | null)[] {
  return p.length === 3 && p.every((n) => n !== null);
}

function tableFromCamera(plane: Plane | null): Rigid {
  if (plane === null || !known(plane.origin) || plane.rotation.some((n) => n === null)) return UPRIGHT;
  return inverted({ rotation: plane.rotation as unknown as Quaternion, translation: plane.origin });
}
