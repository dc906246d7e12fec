// The timeline: lanes of events, proposals, relations and objects over the frames of the annotated video.

import "./stage.css";
import { acceptSelected, rejectSelected } from "./actions";
import { ask } from "./dialogs";
import { h } from "./dom";
import { glyph } from "./player/glyphs";
import { follow, followOrCancel } from "./pointer";
import { openWhole, origin } from "./proposals";
import { type App, MACHINE, type Selected } from "./state";
import { onTheme, palette } from "./theme";
import { beginDraft, type Drag, drop, pickUp, pull, shownFrame } from "./timeline/drag";
import { Gutter } from "./timeline/gutter";
import { type Hit, hitRow } from "./timeline/hit";
import type { Bar, BarRow } from "./timeline/lanes";
import { Mirror } from "./timeline/mirror";
import { Overview } from "./timeline/overview";
import { paintDraft, paintRow, paintRuler, type LanePaint } from "./timeline/paint";
import { Rows } from "./timeline/rows";
import { GUTTER_PX, sharedAxis } from "./timeline/shared";
import { sized } from "./timeline/surface";
import type { EcatEvent } from "./types";

const RULER_PX = 30;
/** The pointer has to move this far before a press becomes a drag. */
const SLACK_PX = 3;

export function createTimeline(host: HTMLElement, app: App): { destroy(): void } {
  const timeline = new Timeline(host, app);
  return { destroy: () => timeline.destroy() };
}

class Timeline {
  private readonly shared: ReturnType<typeof sharedAxis>;
  private readonly rows: Rows;
  private readonly ruler = h("canvas.tl-ruler", { "data-testid": "ruler", "aria-hidden": "true" });
  private readonly lanes = h("canvas.tl-lanes", { "data-testid": "lanes", "aria-hidden": "true" });
  private readonly line = h("div.tl-cursor", { "aria-hidden": "true" });
  private readonly spacer = h("div.tl-spacer");
  private readonly view = h("div.tl-view");
  private readonly scroller = h("div.tl-scroll", { tabindex: -1 });
  private readonly accept: HTMLElement;
  private readonly verdict: HTMLElement;
  private readonly empty = h("p.tl-empty", { hidden: true }, "No events yet. Press E for a new event at the cursor, or drag in the lane.");
  private readonly root: HTMLElement;
  private readonly gutter: Gutter;
  private readonly mirror: Mirror;
  private readonly overview: Overview;
  private readonly observer: ResizeObserver;
  private readonly offs: (() => void)[];
  private drag: Drag | null = null;
  private queued = 0;
  private stale = true;
  private height = 0;
  /** The loop as it was painted. */
  private loop: [number, number] | null = null;

  constructor(
    private readonly host: HTMLElement,
    private readonly app: App,
  ) {
    this.shared = sharedAxis(app);
    this.shared.axis.nFrames = Math.max(1, app.nFrames);
    this.shared.axis.fit();
    this.rows = new Rows(app);
    this.gutter = new Gutter(app, this.rows, (key) => {
      this.rows.toggle(key);
      this.rebuild();
    });
    this.mirror = new Mirror(app, this.rows, this.shared.axis, (layer, bar) => this.choose(layer, bar, false));
    this.overview = new Overview(app, this.shared, this.rows);
    this.accept = this.verdictButton("check", "Accept (Enter)", "timeline-accept", () => void acceptSelected(app));
    this.verdict = h("div.tl-verdict", { hidden: true, role: "group", "aria-label": "Proposal" }, this.accept,
      this.verdictButton("cross", "Reject (X)", "timeline-reject", () => void rejectSelected(app)));
    this.view.append(this.lanes, this.mirror.element, this.verdict, this.gutter.element, this.empty);
    this.scroller.append(this.view, this.spacer);
    this.root = h("div.timeline", null,
      h("div.tl-top", null, h("div.tl-corner", null, ...this.zoomButtons()), this.ruler), this.scroller,
      h("div.tl-bottom", null, h("div.tl-corner"), this.overview.element), this.line);
    host.append(this.root);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.scroller);
    const queue = () => this.queue();
    this.offs = [
      app.on("cursor", () => this.onCursor()), app.on("marks", queue), app.on("running", queue), app.on("people", queue),
      app.on("layer", ({ layer }) => this.rebuild(layer)), app.on("layers", () => this.rebuild()),
      app.on("session", () => this.rebuild()), app.on("settings", () => this.rebuild()),
      app.on("selection", (selection) => this.onSelection(selection)),
      this.shared.onChange(queue), onTheme(() => this.rebuild()),
    ];
    this.listen();
  }

  private verdictButton(sign: "check" | "cross", label: string, testid: string, onclick: () => void): HTMLButtonElement {
    return h("button.tl-verdict-button", {
      type: "button", "aria-label": label, title: label, "data-testid": testid, onclick,
      onpointerdown: (event: PointerEvent) => event.stopPropagation(),
    }, glyph(sign));
  }

  private zoomButtons(): HTMLElement[] {
    const { axis } = this.shared;
    const make = (text: string, label: string, testid: string, act: () => void) =>
      h("button.tl-zoom", {
        type: "button", "aria-label": /\w/.test(text) ? null : label, title: label, "data-testid": testid,
        onclick: () => {
          act();
          this.shared.changed();
        },
      }, text);
    const centre = () => Math.min(axis.width, Math.max(0, axis.x(this.app.cursor.frame)));
    return [
      make("−", "Zoom out (Ctrl+wheel)", "zoom-out", () => axis.zoom(centre(), 1 / 1.6)),
      make("+", "Zoom in (Ctrl+wheel)", "zoom-in", () => axis.zoom(centre(), 1.6)),
      make("all", "Show the whole recording", "zoom-all", () => axis.fit()),
      make("sel", "Show the selected event", "zoom-selection", () => this.showSelected()),
    ];
  }

  private showSelected(): void {
    const segment = this.app.selectedEvent?.segments[0];
    const relation = this.app.selectedRelation;
    if (segment) this.shared.axis.show(segment.start_frame, segment.end_frame);
    else if (relation) this.shared.axis.show(Math.max(0, relation.start_frame), relation.end_frame ?? this.app.nFrames);
    else this.app.notify("Select an event to show it.");
  }

  // --- keeping up

  private rebuild(layer?: string): void {
    this.rows.forget(layer);
    this.stale = true;
    this.overview.forget();
    this.queue();
  }

  private resize(): void {
    this.height = this.scroller.clientHeight;
    this.shared.axis.nFrames = Math.max(1, this.app.nFrames);
    this.shared.axis.resize(this.scroller.clientWidth - GUTTER_PX);
    this.overview.forget();
    this.shared.changed();
  }

  private onCursor(): void {
    // while a bar is in the hand, the lanes stay where they are
    if (this.drag === null && this.shared.axis.reveal(this.app.cursor.frame)) this.shared.changed();
    else if (this.app.running.length > 0 || this.app.cursor.loop !== this.loop) this.queue();
    else this.placeCursor();
  }

  private onSelection(selection: readonly Selected[]): void {
    const last = selection.at(-1);
    if (last !== undefined && this.drag === null) this.reveal(last);
    this.queue();
  }

  /** Brings what was selected elsewhere into view. */
  private reveal(selected: Selected): void {
    this.refresh();
    const { rows, scroller } = this;
    const found = selected.kind === "object" ? null : rows.find(selected.layer, selected.kind, selected.id, selected.segment ?? 0);
    const row = selected.kind === "object" ? rows.findObject(selected.layer, selected.id) : (found?.row ?? -1);
    if (row < 0) return;
    const [top, bottom] = [rows.tops[row]!, rows.tops[row + 1]!];
    if (top < scroller.scrollTop) scroller.scrollTop = Math.max(0, top - 22);
    else if (bottom > scroller.scrollTop + this.height) scroller.scrollTop = bottom - this.height;
    const { axis } = this.shared;
    if (found && (found.bar.end < axis.first || found.bar.start > axis.last)) {
      axis.reveal(found.bar.start);
      this.shared.changed();
    }
  }

  private refresh(): void {
    if (!this.stale) return;
    this.stale = false;
    this.rows.build();
    this.spacer.style.height = `${Math.max(0, this.rows.height - this.height)}px`;
  }

  private queue(): void {
    this.queued ||= requestAnimationFrame(() => {
      this.queued = 0;
      this.paint();
    });
  }

  // --- painting

  private paint(): void {
    const { app, rows, height } = this;
    const { axis } = this.shared;
    this.loop = app.cursor.loop;
    this.refresh();
    this.spacer.style.height = `${Math.max(0, rows.height - height)}px`;
    const top = this.scroller.scrollTop;
    const colors = palette();
    const context = sized(this.lanes, axis.width, height);
    context.font = `11px ${colors.font}`;
    context.textBaseline = "middle";
    context.fillStyle = colors.surface;
    context.fillRect(0, 0, axis.width, height);
    const selected = new Set(app.selection.map((s) => `${s.layer}/${s.kind}/${s.id}`));
    const ghosts = this.drag ? [this.drag.ghost] : [];
    const paint: LanePaint = { context, axis, app, colors, selected, ghosts };
    for (let i = Math.max(0, rows.at(top)); i < rows.rows.length && rows.tops[i]! < top + height; i++) {
      paintRow(paint, rows.rows[i]!, rows.tops[i]! - top);
      this.paintDrafts(paint, i, rows.tops[i]! - top);
    }
    if (this.drag?.snapped != null) {
      context.fillStyle = colors.warn;
      context.fillRect(Math.round(axis.x(this.drag.snapped)), 0, 1, height);
    }
    this.gutter.place(top, height);
    paintRuler(sized(this.ruler, axis.width, RULER_PX), axis, app, RULER_PX);
    this.paintPeople();
    this.overview.paint();
    this.mirror.later(top, height);
    this.placeVerdict(top);
    this.placeCursor();
    this.empty.hidden = app.document.events.list.length > 0 || rows.rows.some((row) => row.kind === "bars" && row.bars.items.length > 0);
  }

  /** What is being drawn in this lane, and the labels that run while it plays. */
  private paintDrafts(paint: LanePaint, index: number, y: number): void {
    const row = this.rows.rows[index]!;
    if (row.kind !== "bars" || !row.editable) return;
    if (this.drag?.ghost.id === "" && this.drag.row === row) paintDraft(paint, this.drag.ghost.start, this.drag.ghost.end, y, row.height);
    for (const running of this.app.running)
      if (running.tier === row.tier) paintDraft(paint, running.start, Math.max(running.start + 1, this.app.cursor.frame), y, row.height);
  }

  private paintPeople(): void {
    const context = this.ruler.getContext("2d")!;
    for (const person of this.app.people) {
      if (person.frame === null) continue;
      const x = this.shared.axis.x(person.frame);
      if (x < 0 || x > this.shared.axis.width) continue;
      context.fillStyle = palette().good;
      context.fillRect(x, 0, 1.5, RULER_PX);
      context.font = `10px ${palette().font}`;
      context.fillText(person.name.slice(0, 12), x + 3, RULER_PX - 8);
    }
  }

  private placeCursor(): void {
    const { axis } = this.shared;
    const x = axis.x(this.app.cursor.frame);
    this.line.hidden = x < -1 || x > axis.width;
    this.line.style.transform = `translateX(${Math.round(GUTTER_PX + x)}px)`;
    this.overview.placeCursor();
  }

  private placeVerdict(top: number): void {
    const last = this.app.primary;
    const open = last?.layer === MACHINE && last.kind !== "object" && this.app.decided(last.id) === null;
    const place = open ? this.rows.find(last.layer, last.kind as Bar["what"], last.id) : null;
    const { axis } = this.shared;
    this.verdict.hidden = place === null || axis.x(place.bar.end) < 0 || axis.x(place.bar.start) > axis.width;
    if (place === null) return;
    this.accept.hidden = openWhole(this.app, place.bar.id) !== null;
    const x = Math.max(0, Math.min(axis.width - 48, axis.x(place.bar.end) + 2));
    this.verdict.style.transform = `translate(${x}px, ${this.rows.tops[place.row]! - top + 1}px)`;
  }

  // --- pointer

  private listen(): void {
    this.scroller.addEventListener("scroll", () => this.queue(), { passive: true });
    this.root.addEventListener("wheel", (event) => {
      this.shared.wheel(event, event.clientX - this.view.getBoundingClientRect().left - GUTTER_PX);
    }, { passive: false });
    this.view.addEventListener("pointerdown", (event) => this.onDown(event));
    this.view.addEventListener("pointermove", (event) => this.onHover(event));
    this.view.addEventListener("dblclick", (event) => this.onDouble(event));
    this.ruler.addEventListener("pointerdown", (event) => this.scrub(event));
  }

  private frameAt(event: MouseEvent): number {
    return this.shared.axis.frame(event.clientX - this.lanes.getBoundingClientRect().left);
  }

  private hit(event: MouseEvent): Hit | null {
    const box = this.lanes.getBoundingClientRect();
    const x = event.clientX - box.left;
    const index = this.rows.at(event.clientY - box.top + this.scroller.scrollTop);
    const row = this.rows.rows[index];
    if (row === undefined || x < 0) return null;
    return hitRow(row, index, this.shared.axis, x, (bar) =>
      this.app.selection.some((s) => s.id === bar.id && s.kind === bar.what && s.layer === (row as BarRow).layer));
  }

  /** Whether an edit of this bar is allowed: the person's own layer, or a proposal that is accepted by it. */
  private changeable(row: BarRow, bar: Bar): boolean {
    return row.layer === this.app.activeLayer || (row.layer === MACHINE && openWhole(this.app, bar.id) === null);
  }

  private onHover(event: PointerEvent): void {
    if (event.buttons !== 0) return;
    const hit = this.hit(event);
    const cursor =
      hit === null ? ""
      : hit.key !== null ? "pointer"
      : hit.row.kind === "bars" && hit.bar && this.changeable(hit.row, hit.bar) && this.edgeOpen(hit) ? (hit.zone === "body" ? "grab" : "ew-resize")
      : hit.row.kind === "bars" && hit.row.editable && !hit.bar ? "crosshair"
      : "";
    if (this.view.style.cursor !== cursor) this.view.style.cursor = cursor;
    const title = hit?.bar && hit.row.kind === "bars" ? this.about(hit.row, hit.bar) : "";
    if (this.view.title !== title) this.view.title = title;
  }

  /** What is said of a bar, of which its label may have no room to say anything. */
  private about({ layer, proposals }: BarRow, bar: Bar): string {
    const document = this.app.layers.get(layer)?.document;
    const event = bar.what === "event" ? document?.event(bar.id) : undefined;
    const element = event ?? document?.relation(bar.id);
    const text = event !== undefined && event.type !== "" ? event.text : "";
    return [`${bar.label}  [${bar.start}, ${bar.end})`, text, proposals && element !== undefined ? origin(element) : ""].filter(Boolean).join("\n");
  }

  private edgeOpen(hit: Hit): boolean {
    return hit.bar !== null && (hit.bar.what === "event" || hit.zone !== "body");
  }

  private onDown(event: PointerEvent): void {
    if (event.button === 1) return this.panWith(event);
    if (event.button !== 0 || (event.target as HTMLElement).closest(".tl-gutter, .tl-verdict")) return;
    const hit = this.hit(event);
    if (hit === null || hit.row.kind === "group") return;
    if (hit.row.kind === "object") return this.onObject(hit);
    if (hit.row.kind !== "bars") return;
    const { axis } = this.shared;
    const frame = this.frameAt(event);
    event.preventDefault();
    if (hit.bar !== null) {
      this.choose(hit.row.layer, hit.bar, event.shiftKey);
      if (event.shiftKey || !this.changeable(hit.row, hit.bar) || !this.edgeOpen(hit)) return;
      this.hold(event, pickUp(this.app, axis, this.visibleBars(), hit.row, hit.bar, hit.zone, frame));
    } else if (hit.row.editable) this.hold(event, beginDraft(this.app, axis, this.visibleBars(), hit.row, frame));
    else this.app.seek(Math.floor(frame));
  }

  private onObject(hit: Hit): void {
    if (hit.row.kind !== "object") return;
    this.app.select([{ kind: "object", id: hit.row.object.id, layer: hit.row.layer }]);
    if (hit.key !== null) this.app.seek(hit.key);
  }

  private choose(layer: string, bar: Bar, add: boolean): void {
    const chosen: Selected = { kind: bar.what, id: bar.id, layer, segment: bar.segment };
    const last = this.app.primary;
    if (!add && this.app.selection.length === 1 && last?.id === chosen.id && last.layer === layer && last.kind === chosen.kind && last.segment === chosen.segment) return;
    const others = add ? this.app.selection.filter((s) => s.id !== chosen.id || s.layer !== layer) : [];
    this.app.select([...others, chosen]);
  }

  private visibleBars(): BarRow[] {
    const top = this.scroller.scrollTop;
    const { rows } = this;
    return rows.rows.filter((row, i): row is BarRow => row.kind === "bars" && rows.tops[i + 1]! > top && rows.tops[i]! < top + this.height);
  }

  private hold(event: PointerEvent, drag: Drag): void {
    const from = event.clientX;
    const slack = drag.ghost.id === "" ? SLACK_PX + 1 : SLACK_PX;
    const move = (e: PointerEvent) => {
      if (!drag.moved && Math.abs(e.clientX - from) < slack) return;
      this.drag = drag;
      pull(drag, this.shared.axis, this.frameAt(e), e.altKey);
      this.app.setPlaying(false);
      this.app.seek(shownFrame(drag));
      this.queue();
    };
    followOrCancel(this.view, event, move, (cancelled) => {
      if (cancelled || !drag.moved) {
        this.drag = null;
        // a press on an empty lane goes there
        if (!cancelled && drag.ghost.id === "") this.app.seek(Math.floor(this.frameAt(event)));
        this.queue();
        return;
      }
      void drop(this.app, drag, (children) => askToClip(children)).finally(() => {
        if (this.drag === drag) this.drag = null;
        this.queue();
      });
    });
  }

  private panWith(event: PointerEvent): void {
    event.preventDefault();
    let [x, y] = [event.clientX, event.clientY];
    follow(this.view, event, (e) => {
      this.shared.axis.scroll(x - e.clientX);
      this.scroller.scrollTop += y - e.clientY;
      [x, y] = [e.clientX, e.clientY];
      this.shared.changed();
    });
  }

  /** A double click goes to the start of what it hits and repeats it. */
  private onDouble(event: MouseEvent): void {
    const bar = this.hit(event)?.bar;
    if (!bar) return;
    this.app.seek(bar.start);
    this.app.setLoop([bar.start, Math.min(bar.end, this.app.nFrames)]);
  }

  /** The ruler moves the cursor; with Shift it sets the marks. */
  private scrub(event: PointerEvent): void {
    if (event.button !== 0) return;
    const { app } = this;
    const start = Math.round(this.frameAt(event));
    const move = (e: PointerEvent) => {
      const frame = this.frameAt(e);
      if (event.shiftKey) app.setMarks({ start: Math.min(start, Math.round(frame)), end: Math.max(start, Math.round(frame)) });
      app.seek(Math.floor(frame));
    };
    follow(this.ruler, event, move);
    if (!event.shiftKey) move(event);
  }

  destroy(): void {
    cancelAnimationFrame(this.queued);
    this.observer.disconnect();
    this.mirror.destroy();
    this.overview.destroy();
    for (const off of this.offs) off();
    this.host.replaceChildren();
  }
}

function askToClip(children: readonly EcatEvent[]): Promise<boolean> {
  const names = children.slice(0, 3).map((child) => child.type || child.id).join(", ");
  const more = children.length > 3 ? `, and ${children.length - 3} more` : "";
  return ask("Sub-events reach beyond", `${names}${more} would stick out of the event. Cut them to fit?`, "Cut them");
}

