// The lists of the inspector: objects, events, relations, proposals.  Only the rows in sight exist.

import { trackedObjects } from "../actions";
import { goTo } from "../navigate";
import { confidence, inOrder, type Order, ORDERS, origin } from "../proposals";
import { span } from "../document";
import { fill, h } from "../dom";
import { holdsAt, intervals, type Stretches } from "../holding";
import { swatch } from "../scheme";
import { type App, type ElementKind, MACHINE, type Selected } from "../state";
import type { AnnotatedObject, EcatEvent, Relation } from "../types";
import { relationForm, relationText } from "./relation";

const ROW = 24;
/** Height of a row with a note below its text. */
export const NOTED_ROW = 40;

export interface Row {
  selected: Selected;
  text: string;
  /** What stands small below the text; the filter looks at both. */
  note?: string;
  at: string;
  color?: string;
  style?: string;
  indent?: number;
}

export interface ListPanel {
  element: HTMLElement;
  refresh(): void;
}

/** A list with a filter; `rows` is called when the layer changes, not when the list is scrolled. */
export function createList(app: App, label: string, rows: () => Row[], tools: () => (HTMLElement | null)[], height = ROW): ListPanel {
  const filter = h("input.input", { type: "search", placeholder: `Find in ${label.toLowerCase()}`, "aria-label": `Find in ${label.toLowerCase()}`, "data-testid": `find-${label.toLowerCase()}` });
  const space = h("div.list-space");
  const list = h("div.list", { role: "listbox", "aria-label": label, tabindex: 0, "data-testid": `list-${label.toLowerCase()}` }, space);
  const extra = h("div");
  const element = h("div.panel.flush", null, h("div.list-tools", null, filter), extra, list);
  let shown: Row[] = [];

  const draw = (): void => {
    const first = Math.max(0, Math.floor(list.scrollTop / height) - 4);
    const last = Math.min(shown.length, Math.ceil((list.scrollTop + (list.clientHeight || 400)) / height) + 4);
    space.style.height = `${shown.length * height}px`;
    space.replaceChildren(...shown.slice(first, last).map((row, i) => rowElement(app, row, (first + i) * height, height)));
    // A listbox has options, or is none.
    list.setAttribute("role", shown.length > 0 ? "listbox" : "group");
    if (shown.length === 0) space.replaceChildren(h("p.empty.list-empty", null, filter.value === "" ? "Nothing here." : "Nothing found."));
  };
  const refresh = (): void => {
    const wanted = filter.value.trim().toLowerCase();
    shown = rows().filter((r) => wanted === "" || `${r.text} ${r.note ?? ""}`.toLowerCase().includes(wanted) || r.selected.id === wanted);
    fill(extra, tools().filter((t) => t !== null));
    draw();
  };
  const move = (by: number): void => {
    const at = shown.findIndex((r) => app.selection.some((s) => s.id === r.selected.id && s.layer === r.selected.layer));
    const next = shown[Math.max(0, Math.min(shown.length - 1, at + by))];
    if (next === undefined) return;
    goTo(app, next.selected);
    const top = shown.indexOf(next) * height;
    if (top < list.scrollTop) list.scrollTop = top;
    else if (top + height > list.scrollTop + list.clientHeight) list.scrollTop = top + height - list.clientHeight;
  };
  filter.addEventListener("input", refresh);
  list.addEventListener("scroll", draw, { passive: true });
  list.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (by === undefined || event.ctrlKey || event.altKey) return;
    event.preventDefault();
    move(by);
  });
  return { element, refresh };
}

function rowElement(app: App, row: Row, top: number, height: number): HTMLElement {
  const chosen = app.selection.some((s) => s.kind === row.selected.kind && s.id === row.selected.id && s.layer === row.selected.layer);
  const element = h("div.list-row", {
    role: "option", "aria-selected": chosen ? "true" : "false", "data-testid": `row-${row.selected.id}`, title: row.note === undefined ? null : `${row.text}\n${row.note}`,
    onclick: (event: MouseEvent) => {
      if (event.ctrlKey || event.metaKey || event.shiftKey) app.select(chosen ? app.selection.filter((s) => s.id !== row.selected.id) : [...app.selection, row.selected]);
      else goTo(app, row.selected);
    },
  }, row.color === undefined ? null : swatch(row.color), h("span.grow", null, row.text, row.note === undefined ? null : h("span.note", null, row.note)), h("span.at", null, row.at));
  if (row.style) element.classList.add(row.style);
  element.style.top = `${top}px`;
  element.style.height = `${height}px`;
  if (row.indent) element.style.paddingLeft = `${8 + 12 * row.indent}px`;
  return element;
}

export function objectRows(app: App): Row[] {
  const row = (layer: string, style?: string) => (o: AnnotatedObject): Row => ({
    selected: { kind: "object" as ElementKind, id: o.id, layer }, text: o.name || o.id, at: o.kind.replaceAll("_", " "), color: o.color, style,
  });
  return [...app.document.objects.list.map(row(app.activeLayer)), ...trackedObjects(app).map(row(MACHINE, "proposed"))];
}

/** An event's type and text, whichever it has. */
function eventText(event: EcatEvent): string {
  return [event.type || (event.text === "" ? event.id : ""), event.text].filter(Boolean).join(" – ");
}

export function eventRows(app: App): Row[] {
  const document = app.document;
  return [...document.events.list]
    .sort((a, b) => span(a)[0] - span(b)[0] || span(b)[1] - span(a)[1])
    .map((e) => ({
      selected: { kind: "event" as ElementKind, id: e.id, layer: app.activeLayer },
      text: eventText(e), at: span(e).join("–"),
      indent: document.depth(e), style: e.status === "proposed" ? "proposed" : undefined,
    }));
}

export function proposalRows(app: App): Row[] {
  const machine = app.layers.get(MACHINE);
  if (machine === undefined) return [];
  const { events, relations } = app.openProposals();
  const row = (kind: ElementKind, e: EcatEvent | Relation, text: string, at: string): Row => ({
    selected: { kind, id: e.id, layer: MACHINE }, text, at, note: origin(e), style: "proposed",
  });
  return [
    ...inOrder(events, app.settings.order).map((e) => row("event", e, eventText(e), span(e).join("–"))),
    ...inOrder(relations, app.settings.order).map((r) => row("relation", r, relationText(r, machine), `${r.start_frame}–${r.end_frame ?? ""}`)),
  ];
}

/** Chooses the order of the proposals; null where none says how sure the machine was. */
export function proposalOrder(app: App): HTMLElement | null {
  if (!app.openProposals().events.some((e) => confidence(e) !== null)) return null;
  const order = h("select.input", { "aria-label": "Order of the proposals", "data-testid": "proposal-order", "data-focus": "proposal order", onchange: () => {
    app.set({ order: order.value as Order });
  } }, Object.entries(ORDERS).map(([value, name]) => h("option", { value, selected: value === app.settings.order }, name)));
  return h("div.list-tools", null, order);
}

/** Relations, all or only those that hold at the cursor; the intervals are computed when the layer changes. */
export function createRelationList(app: App): ListPanel & { atCursor(): void } {
  let onlyNow = false;
  let holding = new Map<string, Stretches>();
  const rows = (): Row[] => {
    const layer = app.active;
    return layer.document.relations.list
      .filter((r) => !onlyNow || holdsAt(holding.get(r.id), app.cursor.frame))
      .sort((a, b) => a.start_frame - b.start_frame)
      .map((r) => ({
        selected: { kind: "relation" as const, id: r.id, layer: layer.name }, text: relationText(r, layer), at: `${r.start_frame}–${r.end_frame ?? ""}`,
        style: holdsAt(holding.get(r.id), app.cursor.frame) ? "holds" : undefined,
      }));
  };
  const toggle = h("input", { type: "checkbox", "data-testid": "holds-now", onchange: () => {
    onlyNow = toggle.checked;
    panel.refresh();
  } });
  const now = h("label.check.list-tools", null, toggle, "Only what holds at this frame");
  let form: HTMLElement | null = null;
  const panel = createList(app, "Relations", rows, () => [now, form]);
  const compute = (): void => {
    const document = app.document;
    holding = intervals(document.relations.list, app.scheme, (id) => document.object(id));
    // The form keeps what is being typed into it.
    if (form === null || !form.contains(globalThis.document.activeElement)) form = h("div.panel-form", null, relationForm(app));
    panel.refresh();
  };
  return { element: panel.element, refresh: compute, atCursor: () => onlyNow && panel.refresh() };
}
