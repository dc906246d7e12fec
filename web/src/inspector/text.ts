// The event's text: objects named in it can be selected from it.

import { attempt } from "../actions";
import { h, iconButton } from "../dom";
import type { App, LayerState } from "../state";
import type { EcatEvent, TextReference } from "../types";
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
    own && event.text !== "" && addReference(app, layer, event, area));
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

function addReference(app: App, layer: LayerState, event: EcatEvent, area: HTMLTextAreaElement): HTMLElement {
  // The selection is remembered, because choosing an object takes the focus from the text.
  let chosen: [number, number] | null = null;
  const target = h("select.input", { "aria-label": "Object that the selected words mean", "data-testid": "reference-target", "data-focus": "reference target" },
    h("option", { value: "" }, "Select words, then their object…"));
  target.addEventListener("focus", () => {
    if (target.children.length === 1) target.append(...layer.document.objects.list.map((o) => h("option", { value: o.id }, o.name || o.id)));
  });
  area.addEventListener("select", () => {
    chosen = area.selectionEnd > area.selectionStart ? [area.selectionStart, area.selectionEnd] : null;
  });
  target.addEventListener("change", () => {
    const [start, end] = (chosen ?? [area.selectionStart, area.selectionEnd]).map((units) => [...area.value.slice(0, units)].length) as [number, number];
    if (target.value !== "" && end > start) void attempt(app, { op: "add_reference", id: event.id, start, end, target: target.value });
    else app.notify("Select the words in the text first.");
    target.value = "";
  });
  return target;
}
