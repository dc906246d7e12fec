// The recording in space: table, boxes, skeleton, paths, and where the camera stands.
//
// A dozen boxes and lines need no graphics card: they are projected here and painted from far to near on a plain canvas, which
// looks the same everywhere.

import "./stage.css";
import { inside } from "./canvas/shapes";
import { h } from "./dom";
import { type Hull, hullsOf } from "./hulls";
import { follow } from "./pointer";
import { bonesOf } from "./skeleton";
import { Orbit, type Seen } from "./space/orbit";
import { type Box, Scene } from "./space/scene";
import { convexOutline, visibleFaces } from "./space/solid";
import type { Vector } from "./space/vector";
import type { App } from "./state";
import { onTheme, palette, type Palette } from "./theme";
import { objectColor, withAlpha } from "./timeline/colors";
import { sized } from "./timeline/surface";

const LIFTED = "#ffb300";
const UNOBSERVED = "#868e96";
const BODY = "#e8a80c";
const GRID_M = 0.1;
const MOST_GRID = 40;

type Project = (p: Vector) => Seen | null;
interface Piece {
  readonly depth: number;
  readonly paint: () => void;
}

export function createSpace(host: HTMLElement, app: App): { destroy(): void } {
  const space = new Space(host, app);
  return { destroy: () => space.destroy() };
}

class Space {
  private readonly canvas = h("canvas.space-canvas", { "data-testid": "space-canvas", role: "img", "aria-label": "Table, boxes and skeleton in space" });
  private readonly note = h("p.space-note", { hidden: true });
  private readonly described = h("p.visually-hidden", { "data-testid": "space-text" });
  private readonly orbit = new Orbit();
  private scene: Scene;
  private readonly offs: (() => void)[];
  private readonly observer: ResizeObserver;
  private faces: { object: string; points: readonly Seen[] }[] = [];
  private touched = false;
  private light = "";
  private queued = 0;
  private textTimer = 0;

  constructor(
    private readonly host: HTMLElement,
    private readonly app: App,
  ) {
    this.scene = this.makeScene();
    const preset = (name: string, label: string, act: () => void) =>
      h("button.space-preset", {
        type: "button", "data-testid": `view-${name}`, title: label,
        onclick: () => {
          this.touched = true;
          this.orbit.flipped = false;
          act();
          this.queue();
        },
      }, name);
    const head = h("div.space-head", null, h("h2.stage-title", null, "Space"), h("div.space-presets", { role: "group", "aria-label": "Point of view" },
      preset("home", "Everything, from the camera's side", () => this.home()), preset("top", "From above", () => this.view(-Math.PI / 2, Math.PI / 2 - 1e-3)),
      preset("camera", "From the camera", () => this.fromCamera()), preset("side", "From the side", () => this.view(0, 0.15))));
    host.append(h("div.space", null, head, this.canvas, this.note, this.described));
    this.note.textContent = "Nothing is known in space yet. `ecat process` finds the table and the boxes.";
    this.note.hidden = this.scene.there;
    const queue = () => this.queue();
    this.offs = [
      app.on("cursor", queue), app.on("selection", queue), app.on("layer", queue), app.on("layers", queue), app.on("settings", queue), onTheme(queue),
      hullsOf(app).onLoaded(queue), app.on("tables", () => this.renew()),
    ];
    this.observer = new ResizeObserver(queue);
    this.observer.observe(this.canvas.parentElement!);
    this.listen();
    this.home();
  }

  private makeScene(): Scene {
    return new Scene(this.app, () => {
      if (!this.touched) this.home();
      this.queue();
    });
  }

  /** A stage has found something new. */
  private renew(): void {
    this.scene = this.makeScene();
    this.note.hidden = this.scene.there;
    if (!this.touched) this.home();
    this.queue();
  }

  // --- point of view

  private home(): void {
    const { at, radius } = this.scene.middle();
    const eye = this.scene.eye;
    this.orbit.azimuth = eye ? Math.atan2(eye.at[1] - at[1], eye.at[0] - at[0]) + 0.35 : -Math.PI / 2 + 0.35;
    this.orbit.elevation = 0.6;
    this.orbit.frame(at, radius);
  }

  private view(azimuth: number, elevation: number): void {
    const { at, radius } = this.scene.middle();
    this.orbit.azimuth = azimuth;
    this.orbit.elevation = elevation;
    this.orbit.frame(at, radius);
  }

  private fromCamera(): void {
    const { eye } = this.scene;
    if (eye === null) return this.home();
    const { at } = this.scene.middle();
    // as the image shows it
    this.orbit.flipped = eye.mirrored;
    const way: Vector = [eye.ahead[0] - eye.at[0], eye.ahead[1] - eye.at[1], eye.ahead[2] - eye.at[2]];
    const far = Math.max(0.3, Math.hypot(at[0] - eye.at[0], at[1] - eye.at[1], at[2] - eye.at[2]));
    return this.orbit.look(eye.at, [eye.at[0] + way[0] * far, eye.at[1] + way[1] * far, eye.at[2] + way[2] * far]);
  }

  private listen(): void {
    const { canvas, orbit } = this;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.touched = true;
      orbit.zoom(Math.exp(event.deltaY / 500));
      this.queue();
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      let [x, y] = [event.clientX, event.clientY];
      let far = 0;
      const slide = event.button !== 0 || event.shiftKey;
      const move = (e: PointerEvent) => {
        const [dx, dy] = [e.clientX - x, e.clientY - y];
        [x, y] = [e.clientX, e.clientY];
        far += Math.abs(dx) + Math.abs(dy);
        this.touched = true;
        if (slide) orbit.pan(dx, dy);
        else orbit.turn(dx, dy);
        this.queue();
      };
      follow(canvas, event, move, () => {
        if (far < 4 && event.button === 0) this.pick(event);
      });
    });
  }

  private pick(event: PointerEvent): void {
    const box = this.canvas.getBoundingClientRect();
    const p = { x: event.clientX - box.left, y: event.clientY - box.top };
    const face = this.faces.findLast(({ points }) => inside(p, points));
    const layer = face && this.app.shownLayers.find(({ document }) => document.object(face.object));
    if (face && layer) this.app.select([{ kind: "object", id: face.object, layer: layer.name }]);
  }

  // --- painting

  private queue(): void {
    this.queued ||= requestAnimationFrame(() => {
      this.queued = 0;
      this.paint();
    });
  }

  private paint(): void {
    const { orbit, scene, app } = this;
    const box = this.canvas.parentElement!.getBoundingClientRect();
    const [width, height] = [Math.max(1, box.width), Math.max(1, box.height - 28)];
    [orbit.width, orbit.height] = [width, height];
    if (!scene.there && this.canvas.clientWidth === width && this.light === palette().surface) return;
    this.light = palette().surface;
    const context = sized(this.canvas, width, height);
    const colors = palette();
    context.fillStyle = colors.surface;
    context.fillRect(0, 0, width, height);
    if (!scene.there) return;
    const project = orbit.projector();
    const { frame } = app.cursor;
    const boxes = scene.boxes(frame);
    if (scene.hasTable) this.table(context, project, colors);
    for (const [object, trail] of scene.trails(frame)) this.trail(context, project, objectColor(app, object), trail);
    const chosen = new Set(app.selection.filter((s) => s.kind === "object").map((s) => s.id));
    this.faces = [];
    const pieces: Piece[] = [...this.skeletons(context, project, frame)];
    for (const thing of boxes) {
      const centre = project(thing.pose.translation);
      if (centre) pieces.push({ depth: centre.depth, paint: () => this.box(context, project, thing, chosen.has(thing.object), colors) });
    }
    const hulls = scene.hulls(frame);
    for (const hull of hulls) {
      const seen = hull.corners.map(project).filter((p) => p !== null);
      const depth = seen.reduce((sum, p) => sum + p.depth, 0) / Math.max(1, seen.length);
      pieces.push({ depth, paint: () => this.hull(context, hull.object, seen, chosen.has(hull.object), colors) });
    }
    pieces.sort((a, b) => b.depth - a.depth).forEach((piece) => piece.paint());
    for (const thing of boxes) this.label(context, project, thing.name, [thing.pose.translation[0], thing.pose.translation[1], thing.pose.translation[2] + thing.size[2] * 0.75 + 0.01], colors);
    for (const { object, corners } of hulls) {
      const mean = (axis: 0 | 1): number => corners.reduce((sum, c) => sum + c[axis], 0) / corners.length;
      this.label(context, project, scene.nameOf(object), [mean(0), mean(1), Math.max(...corners.map((c) => c[2])) + 0.01], colors);
    }
    this.camera(context, project, colors);
    clearTimeout(this.textTimer);
    this.textTimer = window.setTimeout(() => this.describe(boxes, hulls), 300);
  }

  private describe(boxes: readonly Box[], hulls: readonly Hull[]): void {
    this.described.textContent = [
      ...boxes.map(({ name, pose, state }) => `${name} at ${pose.translation.map((n) => n.toFixed(3)).join(", ")} m, ${state}`),
      ...hulls.map(({ object, corners }) => `${this.scene.nameOf(object)}: hull of ${corners.length} corners`),
    ].join("; ");
  }

  private line(context: CanvasRenderingContext2D, project: Project, points: readonly Vector[], closed: boolean): void {
    context.beginPath();
    let down = false;
    for (const p of points) {
      const seen = project(p);
      if (seen === null) down = false;
      else if (down) context.lineTo(seen.x, seen.y);
      else {
        context.moveTo(seen.x, seen.y);
        down = true;
      }
    }
    if (closed) context.closePath();
  }

  private table(context: CanvasRenderingContext2D, project: Project, colors: Palette): void {
    const { outline } = this.scene;
    const edge: readonly Vector[] = outline.length > 2 ? outline : [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]];
    context.save();
    if (edge.every((p) => project(p) !== null)) {
      this.line(context, project, edge, true);
      context.fillStyle = colors.raised;
      context.fill();
      context.lineWidth = 1.5;
      context.strokeStyle = colors.strong;
      context.stroke();
      context.clip();
    }
    const [xs, ys] = [edge.map((p) => p[0]), edge.map((p) => p[1])];
    const ends = (values: readonly number[]): [number, number] => [
      Math.max(-MOST_GRID, Math.floor(Math.min(...values) / GRID_M)), Math.min(MOST_GRID, Math.ceil(Math.max(...values) / GRID_M)),
    ];
    const [[x0, x1], [y0, y1]] = [ends(xs), ends(ys)];
    context.lineWidth = 1;
    context.strokeStyle = colors.line;
    for (let k = x0; k <= x1; k++) {
      this.line(context, project, [[k * GRID_M, y0 * GRID_M, 0], [k * GRID_M, y1 * GRID_M, 0]], false);
      context.stroke();
    }
    for (let k = y0; k <= y1; k++) {
      this.line(context, project, [[x0 * GRID_M, k * GRID_M, 0], [x1 * GRID_M, k * GRID_M, 0]], false);
      context.stroke();
    }
    context.restore();
    const axes: [Vector, string][] = [[[0.1, 0, 0], "#ff5c5c"], [[0, 0.1, 0], "#37b24d"], [[0, 0, 0.1], "#4d8dff"]];
    context.lineWidth = 2;
    for (const [tip, color] of axes) {
      this.line(context, project, [[0, 0, 0], tip], false);
      context.strokeStyle = color;
      context.stroke();
    }
  }

  private box(context: CanvasRenderingContext2D, project: Project, thing: Box, chosen: boolean, colors: Palette): void {
    const own = objectColor(this.app, thing.object);
    const color = thing.state === "free" ? LIFTED : thing.state === "interpolated" ? UNOBSERVED : own;
    for (const face of visibleFaces(thing.pose, thing.size, this.orbit.eye, project)) {
      context.beginPath();
      face.points.forEach((p, i) => (i ? context.lineTo(p.x, p.y) : context.moveTo(p.x, p.y)));
      context.closePath();
      context.fillStyle = shaded(color, face.light);
      context.fill();
      context.lineJoin = "round";
      context.lineWidth = chosen ? 2.5 : 1;
      context.strokeStyle = chosen ? colors.text : shaded(own, 0.45);
      context.stroke();
      this.faces.push({ object: thing.object, points: face.points });
    }
  }

  /** What is seen of a convex body is bounded by the hull of its corners in the picture. */
  private hull(context: CanvasRenderingContext2D, object: string, corners: readonly Seen[], chosen: boolean, colors: Palette): void {
    const outline = convexOutline(corners);
    if (outline.length < 3) return;
    context.beginPath();
    outline.forEach((p, i) => (i ? context.lineTo(p.x, p.y) : context.moveTo(p.x, p.y)));
    context.closePath();
    const color = objectColor(this.app, object);
    context.fillStyle = withAlpha(color, 0.45);
    context.fill();
    context.lineJoin = "round";
    context.lineWidth = chosen ? 2.5 : 1;
    context.strokeStyle = chosen ? colors.text : shaded(color, 0.6);
    context.stroke();
    this.faces.push({ object, points: outline });
  }

  private label(context: CanvasRenderingContext2D, project: Project, name: string, at: Vector, colors: Palette): void {
    const top = project(at);
    if (top === null) return;
    context.font = `500 11px ${colors.font}`;
    context.textAlign = "center";
    context.textBaseline = "bottom";
    context.lineWidth = 3;
    context.strokeStyle = colors.surface;
    context.strokeText(name, top.x, top.y);
    context.fillStyle = colors.text;
    context.fillText(name, top.x, top.y);
    context.textAlign = "start";
  }

  private trail(context: CanvasRenderingContext2D, project: Project, color: string, points: readonly Vector[]): void {
    for (let i = 1; i < points.length; i++) {
      const [a, b] = [project(points[i - 1]!), project(points[i]!)];
      if (a === null || b === null || Math.hypot(a.x - b.x, a.y - b.y) < 0.2) continue;
      context.beginPath();
      context.moveTo(a.x, a.y);
      context.lineTo(b.x, b.y);
      context.strokeStyle = withAlpha(color, 0.15 + (0.75 * i) / points.length);
      context.lineWidth = 2;
      context.stroke();
    }
  }

  private *skeletons(context: CanvasRenderingContext2D, project: Project, frame: number): Generator<Piece> {
    for (const { joints, sure } of this.scene.bodies(frame)) {
      for (const [from, to] of bonesOf(this.app)) {
        const [p, q] = [joints.get(from), joints.get(to)];
        const [a, b] = [p ? project(p) : null, q ? project(q) : null];
        if (!a || !b) continue;
        const color = sure.has(from) && sure.has(to) ? BODY : UNOBSERVED;
        yield {
          depth: (a.depth + b.depth) / 2,
          paint: () => {
            context.beginPath();
            context.moveTo(a.x, a.y);
            context.lineTo(b.x, b.y);
            context.lineCap = "round";
            context.lineWidth = 3;
            context.strokeStyle = color;
            context.stroke();
          },
        };
      }
    }
  }

  private camera(context: CanvasRenderingContext2D, project: Project, colors: Palette): void {
    const { eye } = this.scene;
    if (eye === null) return;
    context.strokeStyle = colors.muted;
    context.lineWidth = 1;
    this.line(context, project, eye.corners, true);
    context.stroke();
    for (const corner of eye.corners) {
      this.line(context, project, [eye.at, corner], false);
      context.stroke();
    }
  }

  destroy(): void {
    cancelAnimationFrame(this.queued);
    clearTimeout(this.textTimer);
    this.observer.disconnect();
    for (const off of this.offs) off();
    this.host.replaceChildren();
  }
}

function shaded(color: string, light: number): string {
  const channel = (i: number) => Math.round(Number.parseInt(color.slice(i, i + 2), 16) * light).toString(16).padStart(2, "0");
  return `#${channel(1)}${channel(3)}${channel(5)}`;
}
