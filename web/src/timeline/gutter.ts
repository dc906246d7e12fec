// The lanes' names: elements, of which only those in view exist.

import { h } from "../dom";
import type { App } from "../state";
import type { Row } from "./lanes";
import type { Rows } from "./rows";

export class Gutter {
  readonly element = h("div.tl-gutter");
  private readonly known = new Map<string, { signature: string; element: HTMLElement }>();

  constructor(
    private readonly app: App,
    private readonly rows: Rows,
    private readonly onToggle: (key: string) => void,
  ) {}

  place(top: number, height: number): void {
    const { rows } = this;
    const seen = new Set<string>();
    for (let i = Math.max(0, rows.at(top)); i < rows.rows.length && rows.tops[i]! < top + height; i++) {
      const row = rows.rows[i]!;
      seen.add(row.key);
      let known = this.known.get(row.key);
      const signature = signatureOf(row);
      if (known?.signature !== signature) {
        known?.element.remove();
        known = { signature, element: this.make(row) };
        this.known.set(row.key, known);
        this.element.append(known.element);
      }
      known.element.style.transform = `translateY(${rows.tops[i]! - top}px)`;
      if (row.kind === "object") {
        const chosen = this.app.selection.some((s) => s.kind === "object" && s.id === row.object.id && s.layer === row.layer);
        known.element.setAttribute("aria-pressed", String(chosen));
      }
    }
    for (const [key, { element }] of this.known)
      if (!seen.has(key)) {
        element.remove();
        this.known.delete(key);
      }
  }

  private make(row: Row): HTMLElement {
    const style = `height: ${row.height}px; padding-left: ${8 + 12 * row.depth}px`;
    if (row.kind === "group")
      return h("button.tl-name.tl-group", {
        type: "button", style, "aria-expanded": String(!row.collapsed), "data-testid": `group-${row.key}`, title: row.label,
        onclick: () => this.onToggle(row.key),
      }, h("span.tl-chevron", { "aria-hidden": "true" }, row.collapsed ? "▸" : "▾"), h("span.tl-text", null, row.label), h("span.tl-count", null, String(row.count)));
    if (row.kind === "object")
      return h("button.tl-name", {
        type: "button", style, title: row.label, "data-testid": `lane-${row.object.id}`, "aria-pressed": "false",
        onclick: () => this.app.select([{ kind: "object", id: row.object.id, layer: row.layer }]),
      }, h("span.swatch", { style: `background: ${row.object.color.slice(0, 7)}` }), h("span.tl-text", null, row.label));
    return h("div.tl-name", { style, title: row.label }, h("span.tl-text", null, row.label));
  }
}

/** What a name looks like: it is made anew only when that changes. */
function signatureOf(row: Row): string {
  const more = row.kind === "group" ? `${row.count} ${row.collapsed}` : row.kind === "object" ? row.object.color : "";
  return `${row.label}|${row.depth}|${more}`;
}
