// The windows tool: many events of one length at fixed steps, for labelling stretch by stretch.

import { attempt } from "./actions";
import { closing, openDialog } from "./dialogs";
import { h } from "./dom";
import type { App } from "./state";

const EXISTING = { add: "add them to what is there", skip: "skip windows that are there already", replace: "replace events with the same span", clear: "remove all events of the tier first" };

export function openWindows(app: App): void {
  const number = (name: string, value: number, least: number): HTMLInputElement =>
    h("input.input", { type: "number", min: least, max: app.nFrames, step: 1, value, id: `windows-${name}`, "data-testid": `windows-${name}` });
  const text = (name: string, list = ""): HTMLInputElement =>
    h("input.input", { type: "text", id: `windows-${name}`, list: list || null, "data-testid": `windows-${name}` });
  const fields = { start: number("start", 0, 0), step: number("step", 20, 1), duration: number("duration", 20, 1), type: text("type", "windows-types"), tier: text("tier"), text: text("text") };
  fields.tier.value = app.scheme.tiers[0]?.name ?? "";
  const existing = h("select.input", { id: "windows-existing", "data-testid": "windows-existing" }, Object.entries(EXISTING).map(([v, t]) => h("option", { value: v }, t)));
  const count = h("p.muted", { role: "status" });
  const plan = (): { start: number; step: number; duration: number; n: number } => {
    const [start, step, duration] = [fields.start, fields.step, fields.duration].map((f) => Math.round(f.valueAsNumber)) as [number, number, number];
    const n = step >= 1 && duration >= 1 && start >= 0 ? Math.max(0, Math.floor((app.nFrames - start - duration) / step) + 1) : 0;
    return { start, step, duration, n };
  };
  const refresh = (): void => {
    const { n } = plan();
    count.textContent = n === 0 ? "No window fits." : `${n} windows, one step of undo.`;
  };
  const row = (label: string, control: HTMLElement): HTMLElement[] => [h("label", { for: control.id }, label), control];
  const { element, closed } = openDialog({
    title: "Windows", testId: "windows",
    body: [
      h("p.muted", null, "Adds events of equal length at equal steps, as a template for labelling stretch by stretch."),
      h("div.fields", null, row("Start, frame", fields.start), row("Step, frames", fields.step), row("Duration, frames", fields.duration), row("Type", fields.type),
        row("Tier", fields.tier), row("Text", fields.text), row("Existing", existing)),
      h("datalist", { id: "windows-types" }, app.scheme.event_types.map((t) => h("option", { value: t.name }))), count,
    ],
    foot: [closing("Cancel", ""), closing("Add windows", "yes", "primary", "windows-yes")],
  });
  element.addEventListener("input", refresh);
  refresh();
  void closed.then((value) => {
    const { start, step, duration, n } = plan();
    if (value !== "yes" || n === 0) return;
    void attempt(app, { op: "add_windows", start, step, duration, type: fields.type.value, tier: fields.tier.value, text: fields.text.value, existing: existing.value });
  });
}
