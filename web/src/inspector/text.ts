// The event's text: objects named in it can be selected from it.

import { attempt } from "../actions";
import { h, iconButton } from "../dom";
import type { App, LayerState } from "../state";
import type { EcatEvent, TextPredicate, TextReference } from "../types";
import { section, textInput } from "./fields";

/** The text cut at its references, in order; overlapping ones are left out.  References count characters, not UTF-16 units. */
export function pieces(whole: string, references: TextReference[]): { text: string; reference: TextReference | null }[] {
  const found: { text: string; reference: TextReference | null }[] = [];
  const text = [...whole];
  let at = 0;
  for (const reference of [...references].sort((a, b) => a.start - b.start)) {
    if (reference.start < at || reference.end > text.length) continue;
    if (reference.start > at) found.push({ text: text.slice(at, reference.start).join(""), reference: null });
    found.push({ text: text.slice(reference.start, reference.end).join(""), reference });
    at = reference.end;
  }
  if (at < text.length) found.push({ text: text.slice(at).join(""), reference: null });
  return found;
}

export function textSection(app: App, layer: LayerState, event: EcatEvent, own: boolean): HTMLElement {
  const area = textInput("Text", event.text, (text) => void attempt(app, { op: "edit_event", id: event.id, text }), {
    multiline: true, disabled: !own, testId: "event-text", placeholder: "What happens, in words",
  }) as HTMLTextAreaElement;
  const find = h("button.button", {
    type: "button", disabled: !own || event.text === "", "data-testid": "find-references", title: "Finds the names of objects as whole words",
    onclick: () => void attempt(app, { op: "find_references", ids: [event.id] }),
  }, "Find objects");
  return section("Text", [find], area,
    event.references.length > 0 && h("div.annotated-text", { "data-testid": "annotated-text" }, pieces(event.text, event.references).map((p) => piece(app, layer, p))),
    ...event.references.map((r) => referenceRow(app, layer, event, r, own)),
    ...event.predicates.map((p, i) => actionRow(app, event, p, i, own)),
    own && addMark(app, layer, event, area));
}

function piece(app: App, layer: LayerState, { text, reference }: { text: string; reference: TextReference | null }): HTMLElement | string {
  if (reference === null) return text;
  const object = layer.document.object(reference.target);
  return h("button", {
    type: "button", title: object?.name || reference.target, "data-testid": `reference-${reference.target}`,
    onclick: () => app.select([{ kind: "object", id: reference.target, layer: layer.name }]),
  }, text);
}

function referenceRow(app: App, layer: LayerState, event: EcatEvent, r: TextReference, own: boolean): HTMLElement | null {
  const object = layer.document.object(r.target);
  return h("div.row", null, h("span", null, `“${[...event.text].slice(r.start, r.end).join("")}”`), h("span.muted", null, "is"),
    h("button.link-button", { type: "button", onclick: () => app.select([{ kind: "object", id: r.target, layer: layer.name }]) }, object?.name || r.target),
    h("span.spacer"),
    own ? iconButton("close", "Remove the reference", () => void attempt(app, { op: "remove_reference", id: event.id, start: r.start, end: r.end })) : null);
}

/** A word that names an action, and which one. */
function actionRow(app: App, event: EcatEvent, p: TextPredicate, index: number, own: boolean): HTMLElement {
  const others = event.predicates.filter((_, i) => i !== index);
  const set = (predicates: TextPredicate[]): void => void attempt(app, { op: "set_predicates", id: event.id, predicates });
  const words = [...event.text].slice(p.start, p.end).join("");
  return h("div.row", { "data-testid": `action-${index}` }, h("span", null, `“${words}”`), h("span.muted", null, "is the action"),
    textInput(`Action that “${words}” names`, p.type, (type) => set([...others, { ...p, type: type.trim() || words }]), {
      disabled: !own, testId: `action-${index}-type`, suggestions: app.scheme.event_types.map((t) => t.name),
    }),
    own ? iconButton("close", "Remove the action", () => set(others)) : null);
}

/** What the selected words mean: an object, or an action. */
function addMark(app: App, layer: LayerState, event: EcatEvent, area: HTMLTextAreaElement): HTMLElement {
  // The selection is remembered, because choosing takes the focus from the text.
  let chosen: [number, number] | null = null;
  area.addEventListener("select", () => {
    chosen = area.selectionEnd > area.selectionStart ? [area.selectionStart, area.selectionEnd] : null;
  });
  /** The selected characters. */
  const selected = (): [number, number] | null => {
    const [start, end] = (chosen ?? [area.selectionStart, area.selectionEnd]).map((units) => [...area.value.slice(0, units)].length) as [number, number];
    if (end > start) return [start, end];
    app.notify("Select the words in the text first.");
    return null;
  };
  const target = h("select.input", { "aria-label": "Object that the selected words mean", "data-testid": "reference-target", "data-focus": "reference target" },
    h("option", { value: "" }, "Select words, then their object…"));
  target.addEventListener("focus", () => {
    if (target.children.length === 1) target.append(...layer.document.objects.list.map((o) => h("option", { value: o.id }, o.name || o.id)));
  });
  target.addEventListener("change", () => {
    const range = target.value === "" ? null : selected();
    if (range !== null) void attempt(app, { op: "add_reference", id: event.id, start: range[0], end: range[1], target: target.value });
    target.value = "";
  });
  const action = h("button.button", {
    type: "button", title: "The selected words name an action", "data-testid": "add-action", "data-focus": "add action",
    // the text keeps its selection
    onmousedown: (e: MouseEvent) => e.preventDefault(),
    onclick: () => {
      const range = selected();
      if (range === null) return;
      const [start, end] = range;
      const type = [...area.value].slice(start, end).join("");
      // what is still being typed is sent first
      area.blur();
      void attempt(app, (document) => {
        const kept = (document.event(event.id)?.predicates ?? []).filter((p) => p.end <= start || end <= p.start);
        return [{ op: "set_predicates", id: event.id, predicates: [...kept, { start, end, type }] }];
      });
    },
  }, "Action");
  return h("div.row", null, target, action);
}
