// The millimetres under the pointer, as the sensor stored them.

import { toImage } from "../canvas/view";
import type { App } from "../state";
import type { Pane } from "./pane";

/** Long enough for a hand that moves on, short enough for one that points. */
const WAIT_MS = 40;

/** Asks for the depth where the pointer is, once it rests; of several questions only the last one is answered. */
export class DepthProbe {
  private timer = 0;
  private asked: AbortController | null = null;
  private at: { u: number; v: number } | null = null;
  private readonly offs: (() => void)[];

  constructor(
    private readonly app: App,
    private readonly pane: Pane,
    private readonly tell: (text: string) => void,
  ) {
    const { element } = pane;
    const move = (event: PointerEvent) => {
      const box = element.getBoundingClientRect();
      const p = toImage(pane.view, { x: event.clientX - box.left, y: event.clientY - box.top });
      const [u, v] = [Math.floor(p.x), Math.floor(p.y)];
      const inside = u >= 0 && v >= 0 && u < pane.image.width && v < pane.image.height;
      if (inside && this.at?.u === u && this.at.v === v) return;
      this.at = inside ? { u, v } : null;
      this.later();
    };
    const leave = () => {
      this.at = null;
      this.later();
    };
    element.addEventListener("pointermove", move);
    element.addEventListener("pointerleave", leave);
    this.offs = [
      pane.onShown(() => this.at && this.later()),
      () => element.removeEventListener("pointermove", move), () => element.removeEventListener("pointerleave", leave),
    ];
  }

  private later(): void {
    clearTimeout(this.timer);
    this.asked?.abort();
    if (this.at === null) return this.tell("");
    this.timer = window.setTimeout(() => void this.ask(), WAIT_MS);
  }

  private async ask(): Promise<void> {
    const { at, app, pane } = this;
    if (at === null || app.session === null || pane.shown < 0) return;
    this.asked = new AbortController();
    try {
      const found = await app.api.depthAt(app.session.id, pane.stream.name, pane.shown, at.u, at.v, this.asked.signal);
      const place = found.x === null || found.y === null || found.z === null ? ""
        : `  ·  ${found.x.toFixed(3)}, ${found.y.toFixed(3)}, ${found.z.toFixed(3)} m`;
      const depth = found.depth_m === null ? "no depth" : `${Math.round(found.depth_m * 1e4) / 10} mm`;
      this.tell(`${depth}${place}  ·  pixel ${at.u}, ${at.v}`);
    } catch (error) {
      if (!(error instanceof DOMException)) this.tell("");
    }
  }

  destroy(): void {
    clearTimeout(this.timer);
    this.asked?.abort();
    for (const off of this.offs) off();
  }
}
