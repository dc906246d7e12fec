// Speeds and distances below the timeline, on its axis.

import "./stage.css";
import { h } from "./dom";
import { follow } from "./pointer";
import type { App } from "./state";
import { onTheme, palette } from "./theme";
import { nth } from "./timeline/colors";
import { Curve, spreadOver } from "./timeline/curve";
import { GUTTER_PX, sharedAxis } from "./timeline/shared";
import { sized } from "./timeline/surface";
import type { SeriesInfo } from "./types";

const HEIGHT = 46;
/** Shown until the person chooses. */
const AT_FIRST = 1;

export function createPlots(host: HTMLElement, app: App): { destroy(): void } {
  let plots = new Plots(host, app);
  // other tables make other curves
  const off = app.on("tables", () => {
    plots.destroy();
    plots = new Plots(host, app);
  });
  return {
    destroy: () => {
      off();
      plots.destroy();
    },
  };
}

interface Row {
  readonly element: HTMLElement;
  readonly canvas: HTMLCanvasElement;
  readonly value: HTMLElement;
  readonly cursor: HTMLElement;
  readonly dot: HTMLElement;
}

class Plots {
  private readonly shared: ReturnType<typeof sharedAxis>;
  private readonly curves = new Map<string, Curve | null>();
  private readonly menu = h("div.plots-menu", { role: "group", "aria-label": "Curves to show" });
  private readonly list = h("div.plots-list");
  private readonly rows = new Map<string, Row>();
  private readonly offs: (() => void)[];
  private series: SeriesInfo[] = [];
  private open = false;
  private gone = false;
  private queued = 0;

  constructor(
    private readonly host: HTMLElement,
    private readonly app: App,
  ) {
    this.shared = sharedAxis(app);
    const queue = () => this.queue();
    this.offs = [this.shared.onChange(queue), app.on("cursor", () => this.rows.forEach((row, name) => this.point(name, row))), onTheme(queue), app.on("settings", () => this.arrange())];
    const sid = app.session?.id;
    if (sid === undefined) return;
    app.api.series(sid).then((series) => {
      this.series = series;
      if (series.length && !this.gone) this.build();
    }, () => undefined);
  }

  private build(): void {
    const button = h("button.plots-button", {
      type: "button", "data-testid": "plots-menu", "aria-expanded": "false", title: "Choose curves of speed and distance",
      onclick: () => {
        this.open = !this.open;
        button.setAttribute("aria-expanded", String(this.open));
        this.menu.hidden = !this.open;
      },
    }, "Plots ▾");
    this.menu.hidden = true;
    this.menu.append(...this.series.map(({ name, title, unit }) => {
      const box = h("input", { type: "checkbox", "data-testid": `plot-${name}`, onchange: () => this.choose(name, box.checked) });
      box.checked = this.chosen.includes(name);
      return h("label.check", null, box, `${title}, ${unit}`);
    }));
    const all = h("div.plots", null, h("div.plots-head", null, button, this.menu), this.list);
    this.host.append(all);
    all.addEventListener("wheel", (event) => {
      this.shared.wheel(event, event.clientX - this.host.getBoundingClientRect().left - GUTTER_PX);
    }, { passive: false });
    this.arrange();
  }

  /** Names of the curves shown: those chosen that this session has, or the first ones. */
  private get chosen(): string[] {
    const names = this.series.map((s) => s.name);
    if (this.app.settings.plots.includes("-")) return this.app.settings.plots.filter((name) => names.includes(name));
    const chosen = this.app.settings.plots.filter((name) => names.includes(name));
    return chosen.length ? chosen : names.slice(0, AT_FIRST);
  }

  private choose(name: string, shown: boolean): void {
    const rest = this.chosen.filter((n) => n !== name);
    const plots = shown ? [...rest, name] : rest;
    // a dash says that none is a choice, too
    this.app.set({ plots: plots.length ? plots : ["-"] });
  }

  private arrange(): void {
    if (!this.series.length) return;
    const { chosen } = this;
    for (const [name, { element }] of this.rows)
      if (!chosen.includes(name)) {
        element.remove();
        this.rows.delete(name);
      }
    for (const name of chosen) if (!this.rows.has(name)) this.add(name);
    this.queue();
  }

  private add(name: string): void {
    const info = this.series.find((s) => s.name === name)!;
    const canvas = h("canvas.plot-canvas", { "aria-hidden": "true", onpointerdown: (event: PointerEvent) => this.scrub(canvas, event) });
    const value = h("span.plot-value", { "data-testid": `value-${name}` });
    const cursor = h("div.plot-cursor", { "aria-hidden": "true" });
    const dot = h("div.plot-dot", { "aria-hidden": "true", style: `background: ${this.color(name)}` });
    const element = h("div.plot", { role: "group", "aria-label": `${info.title}, ${info.unit}` },
      h("div.plot-name", { title: `${info.title}, ${info.unit}` }, h("span.tl-text", null, info.title), value), h("div.plot-room", null, canvas, cursor, dot));
    this.rows.set(name, { element, canvas, value, cursor, dot });
    this.list.append(element);
    if (!this.curves.has(name)) void this.load(name);
  }

  private async load(name: string): Promise<void> {
    this.curves.set(name, null);
    try {
      const table = await this.app.api.seriesValues(this.app.session?.id ?? "", name);
      const values = spreadOver(table.columns.get("frame")!.values, table.columns.get("value")!.values, this.app.nFrames);
      this.curves.set(name, new Curve(values));
      this.queue();
    } catch (error) {
      this.app.fail(error);
    }
  }

  private scrub(canvas: HTMLElement, event: PointerEvent): void {
    if (event.button !== 0) return;
    const left = canvas.getBoundingClientRect().left;
    const move = (e: PointerEvent) => this.app.seek(Math.floor(this.shared.axis.frame(e.clientX - left)));
    follow(canvas, event, move);
    move(event);
  }

  private queue(): void {
    this.queued ||= requestAnimationFrame(() => {
      this.queued = 0;
      for (const [name, row] of this.rows) {
        this.paint(name, row.canvas);
        this.point(name, row);
      }
    });
  }

  private color(name: string): string {
    return nth(this.series.findIndex((s) => s.name === name));
  }

  private height(curve: Curve): (value: number) => number {
    const low = Math.min(0, curve.low);
    return (value) => HEIGHT - 4 - ((value - low) / (curve.high - low || 1)) * (HEIGHT - 10);
  }

  private paint(name: string, canvas: HTMLCanvasElement): void {
    const { axis } = this.shared;
    const colors = palette();
    const context = sized(canvas, axis.width, HEIGHT);
    context.fillStyle = colors.surface;
    context.fillRect(0, 0, axis.width, HEIGHT);
    const curve = this.curves.get(name);
    if (!curve) return;
    const y = this.height(curve);
    context.fillStyle = colors.line;
    context.fillRect(0, Math.round(y(0)), axis.width, 1);
    this.trace(context, curve, y);
    context.strokeStyle = this.color(name);
    context.lineWidth = 1.5;
    context.lineJoin = "round";
    context.stroke();
    context.fillStyle = colors.muted;
    context.font = `10px ${colors.font}`;
    context.textBaseline = "top";
    context.fillText(`${curve.high.toPrecision(3)} ${this.unit(name)}`, 4, 2);
  }

  private unit(name: string): string {
    return this.series.find((s) => s.name === name)?.unit ?? "";
  }

  /** The value at the cursor: elements over the curve, which stays as it is. */
  private point(name: string, { value, cursor, dot }: Row): void {
    const { axis } = this.shared;
    const { frame } = this.app.cursor;
    const curve = this.curves.get(name);
    const at = curve?.values[frame] ?? Number.NaN;
    value.textContent = Number.isNaN(at) ? "–" : `${at.toFixed(3)} ${this.unit(name)}`;
    const x = axis.x(frame);
    cursor.hidden = x < -1 || x > axis.width;
    cursor.style.transform = `translateX(${Math.round(x)}px)`;
    dot.hidden = cursor.hidden || Number.isNaN(at);
    if (curve && !dot.hidden) dot.style.transform = `translate(${x + axis.pxPerFrame / 2}px, ${this.height(curve)(at)}px)`;
  }

  private trace(context: CanvasRenderingContext2D, curve: Curve, y: (value: number) => number): void {
    const { axis } = this.shared;
    context.beginPath();
    let down = false;
    const to = (x: number, value: number) => {
      if (Number.isNaN(value)) down = false;
      else if (down) context.lineTo(x, y(value));
      else {
        context.moveTo(x, y(value));
        down = true;
      }
    };
    if (axis.pxPerFrame >= 0.8) {
      const last = Math.min(curve.values.length - 1, Math.ceil(axis.last));
      for (let frame = Math.max(0, Math.floor(axis.first)); frame <= last; frame++) to(axis.x(frame + 0.5), curve.values[frame]!);
      return;
    }
    for (let x = 0; x < axis.width; x++) {
      const [low, high] = curve.range(Math.floor(axis.frame(x)), Math.floor(axis.frame(x + 1)));
      to(x, low);
      if (high !== low) to(x, high);
    }
  }

  destroy(): void {
    this.gone = true;
    cancelAnimationFrame(this.queued);
    for (const off of this.offs) off();
    this.host.replaceChildren();
  }
}
