// The lanes of the page as it is: made anew when a layer changes, one layer at a time.

import { type App, MACHINE } from "../state";
import { lowerBound } from "./intervals";
import { type Bar, LaneCache, lanes, type Row, type Section } from "./lanes";

export interface BarPlace {
  readonly row: number;
  readonly bar: Bar;
}

const SECTIONS: readonly Section[] = ["events", "objects", "relations"];

export class Rows {
  rows: Row[] = [];
  /** Upper edge of each row, and the lower edge of the last one. */
  tops = new Float64Array(1);
  readonly collapsed = new Set<string>();
  private readonly perLayer = new Map<string, Record<Section, Row[]>>();

  private readonly caches = new Map<string, LaneCache>();
  private scheme: unknown = null;

  constructor(private readonly app: App) {}

  /** Forgets the lanes of a layer; of all of them without a name. */
  forget(layer?: string): void {
    if (layer === undefined) this.perLayer.clear();
    else this.perLayer.delete(layer);
    // what was decided about is no proposal any more
    if (layer === this.app.activeLayer) this.perLayer.delete(MACHINE);
  }

  build(): void {
    const { app } = this;
    // colours and tiers are the scheme's
    if (this.scheme !== app.scheme) this.caches.clear();
    this.scheme = app.scheme;
    const names = app.shownLayers.map((layer) => layer.name);
    for (const known of this.perLayer.keys()) if (!names.includes(known)) this.perLayer.delete(known);
    const made = app.shownLayers.map(({ name, document }) => {
      let found = this.perLayer.get(name);
      if (found === undefined) {
        const cache = this.caches.get(name) ?? new LaneCache();
        this.caches.set(name, cache);
        found = lanes({
          document, scheme: app.scheme, nFrames: app.nFrames, active: name === app.activeLayer, proposals: name === MACHINE,
          decided: new Set(name === MACHINE ? app.document.decisions.list.map((d) => d.proposal) : []), collapsed: this.collapsed, cache,
        });
        this.perLayer.set(name, found);
      }
      return found;
    });
    this.rows = SECTIONS.flatMap((section) => made.flatMap((layer) => layer[section]));
    this.tops = new Float64Array(this.rows.length + 1);
    this.rows.forEach((row, i) => (this.tops[i + 1] = this.tops[i]! + row.height));
  }

  get height(): number {
    return this.tops[this.rows.length] ?? 0;
  }

  /** Position of the row at a height, or -1 below the last. */
  at(y: number): number {
    if (y < 0 || y >= this.height) return -1;
    const found = lowerBound(this.tops, y);
    return this.tops[found] === y ? found : found - 1;
  }

  toggle(key: string): void {
    if (!this.collapsed.delete(key)) this.collapsed.add(key);
    this.perLayer.clear();
  }

  /** Where an event or relation of a layer is; null while its lanes are folded away. */
  find(layer: string, what: Bar["what"], id: string, segment = 0): BarPlace | null {
    for (let row = 0; row < this.rows.length; row++) {
      const lane = this.rows[row]!;
      if (lane.kind !== "bars" || lane.layer !== layer) continue;
      const bar = lane.bars.items.find((b) => b.id === id && b.what === what && b.segment === segment);
      if (bar) return { row, bar };
    }
    return null;
  }

  findObject(layer: string, id: string): number {
    return this.rows.findIndex((row) => row.kind === "object" && row.layer === layer && row.object.id === id);
  }
}
