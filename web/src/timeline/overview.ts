// The whole recording in one line, and the part of it that is in view.

import { h } from "../dom";
import { follow } from "../pointer";
import type { App } from "../state";
import { palette } from "../theme";
import { withAlpha } from "./colors";
import type { Rows } from "./rows";
import type { SharedAxis } from "./shared";
import { sized } from "./surface";

const HEIGHT = 18;
const GRIP_PX = 6;
const AFTER_MS = 250;

export class Overview {
  private readonly cursor = h("div.tl-overview-cursor", { "aria-hidden": "true" });
  private readonly canvas = h("canvas.tl-overview-canvas", { "aria-hidden": "true" });
  readonly element = h("div.tl-overview", {
    role: "scrollbar", "aria-label": "Part of the recording in view", "aria-orientation": "horizontal", "aria-controls": "timeline",
    "data-testid": "overview", tabindex: 0, title: "Drag to scroll, drag an end to zoom",
  }, this.canvas, this.cursor);
  /** The events as a picture, painted once for many scrolls. */
  private picture: OffscreenCanvas | null = null;
  private timer = 0;

  constructor(
    private readonly app: App,
    private readonly shared: SharedAxis,
    private readonly rows: Rows,
  ) {
    this.element.addEventListener("pointerdown", (event) => this.drag(event));
    this.element.addEventListener("keydown", (event) => this.key(event));
  }

  /** Paints the events anew, once nothing changes any more. */
  forget(): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => {
      this.picture = null;
      this.shared.changed();
    }, AFTER_MS);
  }

  destroy(): void {
    clearTimeout(this.timer);
  }

  private painted(width: number): OffscreenCanvas {
    const colors = palette();
    const picture = new OffscreenCanvas(width, HEIGHT);
    const context = picture.getContext("2d", { alpha: false })!;
    context.fillStyle = colors.raised;
    context.fillRect(0, 0, width, HEIGHT);
    const counts = this.count(width);
    const most = counts.reduce((a, b) => Math.max(a, b), 1);
    context.fillStyle = withAlpha(colors.accent, 0.45);
    counts.forEach((count, x) => {
      if (count) context.fillRect(x, HEIGHT - 3 - (count / most) * (HEIGHT - 6), 1, (count / most) * (HEIGHT - 6) + 1);
    });
    return picture;
  }

  private count(width: number): Float32Array {
    const counts = new Float32Array(width);
    const scale = width / Math.max(1, this.app.nFrames);
    for (const row of this.rows.rows) {
      if (row.kind !== "bars") continue;
      for (const bar of row.bars.items) {
        const from = Math.max(0, Math.floor(bar.start * scale));
        const to = Math.min(width - 1, Math.floor((bar.end - 1) * scale));
        for (let x = from; x <= to; x++) counts[x]! += 1;
      }
    }
    return counts;
  }

  paint(): void {
    const { axis } = this.shared;
    const colors = palette();
    const width = Math.max(1, Math.round(axis.width));
    const context = sized(this.canvas, axis.width, HEIGHT);
    if (this.picture?.width !== width) this.picture = this.painted(width);
    context.drawImage(this.picture, 0, 0, axis.width, HEIGHT);
    const [from, to] = this.window();
    context.fillStyle = withAlpha(colors.text, 0.1);
    context.fillRect(from, 0, to - from, HEIGHT);
    context.strokeStyle = colors.strong;
    context.strokeRect(from + 0.5, 0.5, Math.max(2, to - from - 1), HEIGHT - 1);
    this.element.setAttribute("aria-valuenow", String(Math.round(axis.first)));
    this.element.setAttribute("aria-valuemin", "0");
    this.element.setAttribute("aria-valuemax", String(axis.nFrames));
  }

  placeCursor(): void {
    const { axis } = this.shared;
    this.cursor.style.transform = `translateX(${(this.app.cursor.frame / Math.max(1, axis.nFrames)) * axis.width}px)`;
  }

  private window(): [number, number] {
    const { axis } = this.shared;
    const scale = axis.width / Math.max(1, axis.nFrames);
    return [axis.first * scale, Math.min(axis.nFrames, axis.last) * scale];
  }

  private drag(event: PointerEvent): void {
    if (event.button !== 0) return;
    const { axis } = this.shared;
    const left = this.element.getBoundingClientRect().left;
    const at = (e: PointerEvent) => ((e.clientX - left) / axis.width) * axis.nFrames;
    const [from, to] = this.window();
    const x = event.clientX - left;
    const ends = to - from < axis.width - 2;
    const zone = ends && Math.abs(x - from) < GRIP_PX ? "start" : Math.abs(x - to) < GRIP_PX ? "end" : "body";
    const span = axis.last - axis.first;
    const inside = x >= from && x <= to;
    const offset = inside ? at(event) - axis.first : span / 2;
    const [first, last] = [axis.first, Math.min(axis.nFrames, axis.last)];
    const move = (e: PointerEvent) => {
      const frame = Math.max(0, Math.min(axis.nFrames, at(e)));
      if (zone === "body") axis.first = frame - offset;
      else {
        const [a, b] = zone === "start" ? [Math.min(frame, last - 5), last] : [first, Math.max(frame, first + 5)];
        axis.pxPerFrame = axis.width / (b - a);
        axis.first = a;
      }
      axis.clamp();
      this.shared.changed();
    };
    follow(this.element, event, move);
    if (zone === "body") move(event);
  }

  private key(event: KeyboardEvent): void {
    const { axis } = this.shared;
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (way !== undefined) axis.scroll((way * axis.width) / 4);
    else if (event.key === "+" || event.key === "-") axis.zoom(axis.width / 2, event.key === "+" ? 1.5 : 1 / 1.5);
    else return;
    event.preventDefault();
    event.stopPropagation();
    this.shared.changed();
  }
}
