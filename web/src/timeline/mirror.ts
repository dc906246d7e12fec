// What is painted, once more as elements: so that the keyboard, a screen reader and a test reach the events.

import { confirmSelected } from "../actions";
import { h } from "../dom";
import { type App, MACHINE } from "../state";
import type { Axis } from "./axis";
import type { Bar, BarRow } from "./lanes";
import type { Rows } from "./rows";

/** More bars than this in view are not worth reading one by one: only the selected ones stay. */
const MOST = 400;
const LEAST_PX = 6;

export function barTestId(app: App, layer: string, bar: Bar): string {
  const name = layer === MACHINE ? `proposal-${bar.id}` : layer === app.activeLayer ? `${bar.what}-${bar.id}` : `${bar.what}-${layer}.${bar.id}`;
  return bar.segment ? `${name}-segment-${bar.segment}` : name;
}

export class Mirror {
  readonly element = h("div.tl-mirror", { role: "listbox", "aria-label": "Events and relations in view", "aria-multiselectable": "true", tabindex: -1 });
  private readonly known = new Map<string, HTMLElement>();
  private timer = 0;

  constructor(
    private readonly app: App,
    private readonly rows: Rows,
    private readonly axis: Axis,
    private readonly onFocus: (layer: string, bar: Bar) => void,
  ) {}

  /** Places the elements once nothing moves any more. */
  later(top: number, height: number): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.place(top, height), 90);
  }

  private place(top: number, height: number): void {
    const { rows, axis, app } = this;
    const first = Math.max(0, rows.at(top));
    const found: { row: BarRow; index: number; bar: Bar }[] = [];
    for (let i = first; i < rows.rows.length && rows.tops[i]! < top + height; i++) {
      const row = rows.rows[i]!;
      if (row.kind !== "bars") continue;
      const [from, to] = row.bars.range(axis.first, axis.last);
      if (to - from + found.length > 20 * MOST) continue;
      for (const bar of row.bars.within(axis.first, axis.last)) found.push({ row, index: i, bar });
    }
    const isChosen = (row: BarRow, bar: Bar) => app.selection.some((s) => s.id === bar.id && s.kind === bar.what && s.layer === row.layer);
    const kept = found.length <= MOST ? found : found.filter(({ row, bar }) => isChosen(row, bar));
    const names = new Set<string>();
    let reachable = false;
    for (const { row, index, bar } of kept) {
      const name = barTestId(app, row.layer, bar);
      names.add(name);
      const element = this.element_(name, row.layer, bar);
      const chosen = isChosen(row, bar);
      reachable ||= chosen;
      const x = Math.max(0, axis.x(bar.start));
      const width = Math.max(LEAST_PX, Math.min(axis.width, axis.x(bar.end)) - x);
      element.style.transform = `translate(${x}px, ${rows.tops[index]! - top + 3}px)`;
      element.style.width = `${width}px`;
      element.style.height = `${row.height - 7}px`;
      element.tabIndex = chosen ? 0 : -1;
      element.setAttribute("aria-selected", String(chosen));
      element.setAttribute("aria-label", this.label(row, bar));
      element.dataset.start = String(bar.start);
      element.dataset.end = String(bar.end);
    }
    for (const [name, element] of this.known)
      if (!names.has(name)) {
        element.remove();
        this.known.delete(name);
      }
    const start = this.element.firstElementChild;
    if (!reachable && start instanceof HTMLElement) start.tabIndex = 0;
  }

  private element_(name: string, layer: string, bar: Bar): HTMLElement {
    let element = this.known.get(name);
    if (element === undefined) {
      element = h("div.tl-option", {
        role: "option", "data-testid": name, onfocus: () => this.onFocus(layer, bar), onkeydown: (event: KeyboardEvent) => this.key(event),
      });
      this.known.set(name, element);
      this.element.append(element);
    }
    return element;
  }

  /** The keys that a focused control keeps to itself mean here what they mean everywhere. */
  private key(event: KeyboardEvent): void {
    if (event.key === "Enter") void confirmSelected(this.app);
    else if (event.key === " ") this.app.setPlaying(!this.app.cursor.playing);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  private label(row: BarRow, bar: Bar): string {
    const kind = row.proposals ? "proposed " : "";
    const lane = row.tier ? `, tier ${row.tier}` : "";
    return `${kind}${bar.what} ${bar.label}, frames ${bar.start} to ${bar.end}${lane}, layer ${row.layer}`;
  }

  destroy(): void {
    clearTimeout(this.timer);
    this.element.remove();
  }
}
