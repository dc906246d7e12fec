// Shapes over the picture: shown, drawn, chosen and changed, in pixels of the image at any zoom.

import { addedId, attempt } from "./actions";
import { drawBlank, drawDraft, drawRings, drawShape, drawSkeletons } from "./canvas/draw";
import { Handles } from "./canvas/handles";
import { distance, flatten, inside, moved, type Point, rectangleBetween, rounded, vertices } from "./canvas/shapes";
import { toImage, toScreen } from "./canvas/view";
import { Measured, type Preview, type Ring, shapeUnder, type VisibleShape, visibleShapes } from "./canvas/visible";
import { h, isTyping } from "./dom";
import { annotatedPane } from "./player";
import type { Pane } from "./player/pane";
import { follow, followOrCancel } from "./pointer";
import { bonesOf } from "./skeleton";
import type { App, Selected } from "./state";

/** How near, in CSS pixels, a click has to come. */
const REACH_PX = 6;
/** A rectangle smaller than this was a click that slipped. */
const LEAST_PX = 4;
const MOST_LISTED = 60;

export function createCanvas(host: HTMLElement, app: App): { destroy(): void } {
  const pane = annotatedPane(host);
  if (pane === null) return { destroy: () => undefined };
  const canvas = new ShapeCanvas(app, pane);
  return { destroy: () => canvas.destroy() };
}

class ShapeCanvas {
  private readonly canvas = h("canvas.pane-overlay", { "data-testid": "overlay", "aria-hidden": "true" });
  private readonly list = h("div.visually-hidden", { role: "group", "aria-label": "Shapes in the image" });
  private readonly handles: Handles;
  private readonly measured: Measured;
  private readonly offs: (() => void)[];
  private shapes: VisibleShape[] = [];
  private rings: Ring[] = [];
  /** The object that has the grips. */
  private gripped: string | undefined;
  private preview: Preview | null = null;
  /** Vertices of what is being drawn, image pixels; the last one moves with the pointer. */
  private draft: Point[] | null = null;
  private queued = 0;
  /** Whether nothing is painted. */
  private clean = false;
  private listTimer = 0;

  constructor(
    private readonly app: App,
    private readonly pane: Pane,
  ) {
    this.measured = new Measured(app, () => this.queue());
    this.handles = new Handles({
      view: () => pane.view,
      preview: (coordinates) => this.hold(coordinates),
      commit: (coordinates) => void this.store(coordinates),
      cancel: () => this.release(),
    });
    pane.element.append(this.canvas, this.handles.element, this.list);
    const queue = () => this.queue();
    this.offs = [
      app.on("cursor", queue), app.on("layer", queue), app.on("layers", queue), app.on("selection", () => this.onSelection()),
      app.on("settings", () => this.onSettings()), app.on("tables", () => this.onTables()), pane.onView(queue), pane.onShown(queue),
    ];
    const on = <K extends keyof HTMLElementEventMap>(name: K, listener: (event: HTMLElementEventMap[K]) => void) =>
      this.canvas.addEventListener(name, listener);
    on("pointerdown", (event) => this.onDown(event));
    on("pointermove", (event) => this.onMove(event));
    on("dblclick", (event) => this.onDouble(event));
    on("contextmenu", (event) => {
      event.preventDefault();
      if (this.draft && app.settings.tool === "polygon") void this.closePolygon();
    });
    this.onKey = this.onKey.bind(this);
    window.addEventListener("keydown", this.onKey, true);
    this.onSettings();
  }

  private onSettings(): void {
    if (this.app.settings.tool === "select") this.draft = null;
    this.canvas.dataset.tool = this.app.settings.tool;
    this.queue();
  }

  private onTables(): void {
    this.measured.renew();
    this.queue();
  }

  private onSelection(): void {
    // a hand may be quicker than the next picture: it must not find the grips of what is chosen no more
    if (this.editable()?.object.id !== this.gripped) this.handles.hide();
    this.queue();
  }

  // --- painting

  private queue(): void {
    this.queued ||= requestAnimationFrame(() => {
      this.queued = 0;
      this.paint();
    });
  }

  private paint(): void {
    const { app, pane } = this;
    const { width, height } = pane.hostSize;
    const ratio = devicePixelRatio;
    const [w, hgt] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== w || this.canvas.height !== hgt) {
      [this.canvas.width, this.canvas.height] = [w, hgt];
      this.clean = false;
    }
    const chosen = new Set(app.selection.filter((s) => s.kind === "object").map((s) => s.id));
    this.rings = app.settings.marks ? this.measured.rings(app.cursor.frame) : [];
    const skeletons = this.measured.skeletons(app.cursor.frame);
    this.shapes = visibleShapes(app, pane.stream.name, this.preview);
    const something = this.rings.length + skeletons.length + this.shapes.length > 0 || this.draft !== null || pane.source === "none";
    // an empty canvas that stays empty costs nothing
    if (!something && this.clean) return;
    this.clean = !something;
    const context = this.canvas.getContext("2d")!;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    if (pane.source === "none") drawBlank(context, pane.image, pane.view);
    drawRings(context, this.rings, pane.view, chosen);
    drawSkeletons(context, skeletons, bonesOf(app), pane.view);
    const isChosen = (shape: VisibleShape) => app.selection.some((s) => s.kind === "object" && s.id === shape.object.id && s.layer === shape.layer);
    for (const shape of this.shapes) if (!isChosen(shape)) drawShape(context, shape, pane.view, false);
    for (const shape of this.shapes) if (isChosen(shape)) drawShape(context, shape, pane.view, true);
    if (this.draft) drawDraft(context, this.draftOutline(), app.settings.tool === "rectangle", pane.view);
    const editable = this.editable();
    this.gripped = editable?.object.id;
    if (editable) this.handles.show(editable.object.kind, editable.coordinates, editable.points);
    else this.handles.hide();
    clearTimeout(this.listTimer);
    this.listTimer = window.setTimeout(() => this.describe(), 250);
  }

  private draftOutline(): Point[] {
    const draft = this.draft ?? [];
    if (this.app.settings.tool !== "rectangle" || draft.length < 2) return draft;
    return vertices("rectangle", rectangleBetween(draft[0]!, draft[1]!));
  }

  /** The one selected shape of the edited layer that is visible. */
  private editable(): VisibleShape | null {
    const { app } = this;
    const last = app.primary;
    if (last?.kind !== "object" || last.layer !== app.activeLayer || app.settings.tool !== "select" || app.cursor.playing) return null;
    return this.shapes.find((shape) => shape.own && shape.object.id === last.id) ?? null;
  }

  private describe(): void {
    if (this.app.cursor.playing) return;
    const rows = this.shapes.slice(0, MOST_LISTED).map(({ object, layer, coordinates }) =>
      h("button", {
        type: "button", "data-testid": `shape-${object.id}`, "data-key": coordinates.join(" "),
        onclick: () => this.app.select([{ kind: "object", id: object.id, layer }]),
      }, `${object.name || object.id}, ${object.kind} at ${coordinates.slice(0, 2).map(Math.round).join(", ")}`));
    // a list that is being read is left alone
    if (!this.list.contains(document.activeElement)) this.list.replaceChildren(...rows);
  }

  // --- pointer

  private at(event: MouseEvent): Point {
    const box = this.canvas.getBoundingClientRect();
    return toImage(this.pane.view, { x: event.clientX - box.left, y: event.clientY - box.top });
  }

  private within(p: Point): Point {
    const { width, height } = this.pane.image;
    return { x: Math.min(width, Math.max(0, p.x)), y: Math.min(height, Math.max(0, p.y)) };
  }

  private get reach(): number {
    return REACH_PX / this.pane.view.scale;
  }

  private onDown(event: PointerEvent): void {
    if (event.button !== 0) return;
    const p = this.at(event);
    const { tool } = this.app.settings;
    if (tool !== "select" && this.app.cursor.playing) this.app.setPlaying(false);
    if (tool === "select") this.choose(event, p);
    else if (tool === "point") void this.create("point", [this.within(p)]);
    else if (tool === "rectangle") this.dragRectangle(event, this.within(p));
    else this.addVertex(this.within(p));
  }

  private onMove(event: PointerEvent): void {
    const p = this.at(event);
    if (this.app.settings.tool === "polygon" && this.draft) {
      this.draft[this.draft.length - 1] = this.within(p);
      this.queue();
    } else if (this.app.settings.tool === "select" && event.buttons === 0) {
      this.canvas.style.cursor = shapeUnder(this.shapes, p, this.reach) ? "move" : "";
    }
  }

  private choose(event: PointerEvent, p: Point): void {
    const { app } = this;
    const shape = shapeUnder(this.shapes, p, this.reach);
    const ring = shape ? null : this.rings.find((r) => inside(p, r.points));
    const picked: Selected | null = shape ? { kind: "object", id: shape.object.id, layer: shape.layer } : ring ? this.owner(ring.object) : null;
    if (picked) {
      const others = event.shiftKey ? app.selection.filter((s) => s.id !== picked.id || s.layer !== picked.layer) : [];
      app.select([...others, picked]);
    }
    if (shape?.own && !event.shiftKey) this.dragShape(event, shape);
    else if (!picked) {
      this.pane.dragView(event);
      if (app.selection.some((s) => s.kind === "object")) app.select(app.selection.filter((s) => s.kind !== "object"));
    }
  }

  /** The layer that knows an object which a table speaks of. */
  private owner(id: string): Selected | null {
    const layer = this.app.shownLayers.find(({ document }) => document.object(id));
    return layer ? { kind: "object", id, layer: layer.name } : null;
  }

  private dragShape(event: PointerEvent, shape: VisibleShape): void {
    const start = this.at(event);
    let now: number[] | null = null;
    followOrCancel(this.canvas, event, (e) => {
      const p = this.at(e);
      if (now === null && Math.hypot(e.clientX - event.clientX, e.clientY - event.clientY) < 3) return;
      now = moved(shape.object.kind, shape.coordinates, p.x - start.x, p.y - start.y);
      this.hold(now);
    }, (cancelled) => (now && !cancelled ? void this.store(now) : this.release()));
  }

  private dragRectangle(event: PointerEvent, start: Point): void {
    this.draft = [start, start];
    follow(this.canvas, event, (e) => {
      if (this.draft) this.draft = [start, this.within(this.at(e))];
      this.queue();
    }, () => {
      const draft = this.draft;
      this.draft = null;
      this.queue();
      const { scale } = this.pane.view;
      if (draft && Math.abs(draft[0]!.x - draft[1]!.x) * scale >= LEAST_PX && Math.abs(draft[0]!.y - draft[1]!.y) * scale >= LEAST_PX)
        void this.create("rectangle", draft);
    });
  }

  private addVertex(p: Point): void {
    const first = this.draft?.[0];
    const near = (a: Point) => distance(toScreen(this.pane.view, a), toScreen(this.pane.view, p)) <= REACH_PX;
    if (this.draft && first && this.draft.length > 3 && near(first)) return void this.closePolygon();
    this.draft = this.draft ? [...this.draft.slice(0, -1), p, p] : [p, p];
    return this.queue();
  }

  private onDouble(event: MouseEvent): void {
    if (this.app.settings.tool === "polygon" && this.draft) return void this.closePolygon();
    if (this.app.settings.tool === "select" && !shapeUnder(this.shapes, this.at(event), this.reach)) this.pane.fit();
  }

  private async closePolygon(): Promise<void> {
    const draft = this.draft ?? [];
    const { scale } = this.pane.view;
    // the last vertex follows the pointer, and a double click sets two at one place
    const points = draft.slice(0, -1).filter((p, i, all) => i === 0 || distance(p, all[i - 1]!) * scale > 2);
    if (points.length < 3) return this.app.notify("A polygon needs at least three vertices.");
    this.draft = null;
    await this.create("polygon", points);
  }

  /** Keys that belong to what is being drawn, before anybody else sees them. */
  private onKey(event: KeyboardEvent): void {
    if (isTyping(event.target)) return;
    if (event.key === "0" && !event.ctrlKey && !event.altKey && this.pane.element.matches(":hover")) return this.pane.fit();
    if (!this.draft) {
      if (event.key === "Escape" && this.app.settings.tool !== "select") {
        event.stopPropagation();
        this.app.set({ tool: "select" });
      }
      return;
    }
    if (event.key === "Escape") this.draft = null;
    else if (event.key === "Enter" && this.app.settings.tool === "polygon") void this.closePolygon();
    else if (event.key === "Backspace" && this.app.settings.tool === "polygon")
      this.draft = this.draft.length > 2 ? [...this.draft.slice(0, -2), this.draft.at(-1)!] : null;
    else return;
    event.preventDefault();
    event.stopPropagation();
    this.queue();
  }

  // --- storing

  private hold(coordinates: readonly number[]): void {
    const last = this.app.primary;
    if (last?.kind !== "object") return;
    if (this.app.cursor.playing) this.app.setPlaying(false);
    this.preview = { id: last.id, coordinates };
    this.queue();
  }

  private release(): void {
    this.preview = null;
    this.queue();
  }

  private async store(coordinates: readonly number[]): Promise<void> {
    const last = this.app.primary;
    if (last?.kind !== "object") return this.release();
    this.preview = { id: last.id, coordinates };
    const held = this.preview;
    await attempt(this.app, { op: "set_key_frame", object: last.id, frame: this.app.cursor.frame, coordinates: rounded(coordinates) });
    if (this.preview === held) this.release();
  }

  /** A new object; or the shape of the selected one, where that has none at this frame. */
  private async create(kind: "rectangle" | "polygon" | "point", points: readonly Point[]): Promise<void> {
    const { app } = this;
    const coordinates = rounded(kind === "rectangle" ? rectangleBetween(points[0]!, points[1]!) : flatten(points));
    const { frame } = app.cursor;
    const chosen = app.selectedObject;
    const hidden = chosen?.kind === kind && app.primary?.layer === app.activeLayer && !this.shapes.some((s) => s.own && s.object.id === chosen.id);
    app.set({ tool: "select" });
    if (chosen && hidden) {
      await attempt(app, { op: "set_key_frame", object: chosen.id, frame, coordinates });
      return;
    }
    const record = await attempt(app, { op: "add_object", kind, stream: this.pane.stream.name, frame, coordinates });
    const id = record && addedId(record, "object");
    if (id) app.select([{ kind: "object", id, layer: app.activeLayer }]);
  }

  destroy(): void {
    cancelAnimationFrame(this.queued);
    clearTimeout(this.listTimer);
    window.removeEventListener("keydown", this.onKey, true);
    for (const off of this.offs) off();
    for (const element of [this.canvas, this.handles.element, this.list]) element.remove();
  }
}
