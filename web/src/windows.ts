// The windows tool: many events of one length at fixed steps, for labelling stretch by stretch; in one session or in all.

import { attempt } from "./actions";
import { closing, openDialog } from "./dialogs";
import { h } from "./dom";
import { type App } from "./state";
import { editAll } from "./together";

const EXISTING = { skip: "skip windows that are there already", add: "add them to what is there", replace: "replace events with the same span", clear: "remove all events of the tier first" };

/** `everywhere`: in all sessions of the project, which are so many. Without an open session there is no other choice. */
export async function openWindows(app: App, sessions: number): Promise<void> {
  const here = app.session !== null;
  const number = (name: string, value: number, least: number): HTMLInputElement =>
    h("input.input", { type: "number", min: least, max: here ? app.nFrames : null, step: 1, value, id: `windows-${name}`, "data-testid": `windows-${name}` });
  const text = (name: string, list = ""): HTMLInputElement =>
    h("input.input", { type: "text", id: `windows-${name}`, list: list || null, "data-testid": `windows-${name}` });
  const fields = { start: number("start", 0, 0), step: number("step", 20, 1), duration: number("duration", 20, 1), type: text("type", "windows-types"), tier: text("tier"), text: text("text") };
  fields.tier.value = app.scheme.tiers[0]?.name ?? "";
  const select = (name: string, options: Record<string, string>): HTMLSelectElement =>
    h("select.input", { id: `windows-${name}`, "data-testid": `windows-${name}` }, Object.entries(options).map(([v, t]) => h("option", { value: v }, t)));
  const existing = select("existing", EXISTING);
  const scope = select("scope", { ...(here ? { session: "this session" } : {}), ...(sessions > 1 || !here ? { project: `all ${sessions} sessions of the project` } : {}) });
  const layer = text("layer");
  layer.value = app.project?.layer || app.activeLayer;
  const count = h("p.muted", { role: "status" });
  const plan = (): { start: number; step: number; duration: number; n: number } => {
    const [start, step, duration] = [fields.start, fields.step, fields.duration].map((f) => Math.round(f.valueAsNumber)) as [number, number, number];
    const valid = step >= 1 && duration >= 1 && start >= 0;
    return { start, step, duration, n: valid ? (scope.value === "project" ? 1 : Math.max(0, Math.floor((app.nFrames - start - duration) / step) + 1)) : 0 };
  };
  const refresh = (): void => {
    const { n } = plan();
    count.textContent = n === 0 ? "No window fits." : scope.value === "project" ? "As many as each session holds; one step of undo in each." : `${n} windows, one step of undo.`;
  };
  const row = (label: string, control: HTMLElement): HTMLElement[] => [h("label", { for: control.id }, label), control];
  const { element, closed } = openDialog({
    title: "Windows", testId: "windows",
    body: [
      h("p.muted", null, "Adds events of equal length at equal steps, as a template for labelling stretch by stretch. Start, step and duration are frames."),
      h("div.fields", null, row("Start", fields.start), row("Step", fields.step), row("Duration", fields.duration), row("Type", fields.type),
        row("Tier", fields.tier), row("Text", fields.text), row("Existing", existing), row("In", scope), here ? null : row("Layer", layer)),
      h("datalist", { id: "windows-types" }, app.scheme.event_types.map((t) => h("option", { value: t.name }))), count,
    ],
    foot: [closing("Cancel", ""), closing("Add windows", "yes", "primary", "windows-yes")],
  });
  element.addEventListener("input", refresh);
  refresh();
  const value = await closed;
  const { start, step, duration, n } = plan();
  if (value !== "yes" || n === 0) return;
  const operation = { op: "add_windows", start, step, duration, type: fields.type.value, tier: fields.tier.value, text: fields.text.value, existing: existing.value };
  if (scope.value === "session") await attempt(app, operation);
  else await editAll(app, "Adding windows to all sessions", layer.value.trim() || "main", [operation], true);
}
