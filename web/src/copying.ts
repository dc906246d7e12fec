// Copies of objects from another session: where it was seen last there, it begins here, as the same thing.

import { attempt } from "./actions";
import { closing, openDialog } from "./dialogs";
import { fill, h } from "./dom";
import { swatch } from "./scheme";
import type { App } from "./state";
import type { Neighbour, OtherObject } from "./types";

const MODES = { last_frame: "as they are at its end", last_appearance: "as they were seen last, also those that were gone by then" };
const OF_TABLES: ReadonlySet<string> = new Set(["rig", "marker_box"]);

export async function openCopying(app: App): Promise<void> {
  const sid = app.session?.id;
  if (sid === undefined) return;
  let known: Neighbour[];
  let before: string | undefined;
  try {
    [known, before] = await neighbours(app, sid);
  } catch (error) {
    return app.fail(error);
  }
  if (known.length === 0) return app.notify("There is no other session in this folder to copy from.");
  const session = h("select.input", { id: "copy-session", "data-testid": "copy-session" },
    known.map((n) => h("option", { value: n.name, selected: n.name === before }, n.name === before ? `${n.name} (the one before)` : n.name)));
  const mode = h("select.input", { id: "copy-mode", "data-testid": "copy-mode" }, Object.entries(MODES).map(([v, t]) => h("option", { value: v }, t)));
  const list = h("div.copy-list", { "data-testid": "copy-list" });
  const yes = closing("Copy", "yes", "primary", "copy-yes");
  let objects: OtherObject[] = [];
  const left = new Set<string>();
  const usable = (o: OtherObject): boolean => !OF_TABLES.has(o.kind) && (mode.value === "last_frame" ? o.at_end : o.drawn);
  const chosen = (): OtherObject[] => objects.filter((o) => usable(o) && !left.has(o.id));
  const show = (): void => {
    fill(list, objects.length === 0 ? h("p.empty", null, "There is nothing in it.") : objects.map((o) => h("label.check.row", null,
      h("input", { type: "checkbox", checked: usable(o) && !left.has(o.id), disabled: !usable(o), "data-testid": `copy-${o.id}`, "data-focus": o.id, onchange: () => {
        if (!left.delete(o.id)) left.add(o.id);
        show();
      } }), swatch(o.color), h("span", null, o.name || o.id), h("span.muted", null, why(o)))));
    yes.disabled = chosen().length === 0;
  };
  const why = (o: OtherObject): string => OF_TABLES.has(o.kind) ? "measured, found anew in each recording" : !o.drawn ? "never drawn" : usable(o) ? "" : "gone at its end";
  const load = (): void => {
    fill(list, h("p.muted", null, "Looking…"));
    yes.disabled = true;
    const { value } = session;
    app.api.otherObjects(sid, value, app.activeLayer).then((answer) => {
      // another one was chosen meanwhile: ids mean other things there
      if (session.value !== value) return;
      objects = answer.objects;
      left.clear();
      show();
    }).catch((error: unknown) => {
      app.fail(error);
      fill(list, h("p.empty", null, "It cannot be read."));
    });
  };
  session.addEventListener("change", load);
  mode.addEventListener("change", show);
  load();
  const { frame } = app.cursor;
  const row = (label: string, control: HTMLElement): HTMLElement[] => [h("label", { for: control.id }, label), control];
  const { closed } = openDialog({
    title: "Copy objects from another session", testId: "copying",
    body: [
      h("p.muted", null, `They begin at frame ${frame}, each the same thing as its original (IDENTITY); what held between them at the other session's end holds here.`),
      h("div.fields", null, row("Session", session), row("Objects", mode)), list,
    ],
    foot: [closing("Cancel", ""), yes],
  });
  if ((await closed) !== "yes") return;
  const ids = chosen().map((o) => o.id);
  const record = await attempt(app, { op: "copy_objects", session: session.value, frame, mode: mode.value, objects: ids });
  if (record === null) return;
  const added = record.changes.filter((c) => c.kind === "object" && c.before === null).map((c) => c.id);
  app.select(added.map((id) => ({ kind: "object", id, layer: app.activeLayer })));
  app.notify(`${added.length} ${added.length === 1 ? "object" : "objects"} copied from ${session.value}.`, "Ctrl+Z takes it back.");
}

/** The sessions beside this one, and the one before it in their order. */
async function neighbours(app: App, sid: string): Promise<[Neighbour[], string | undefined]> {
  const [known, project] = await Promise.all([app.api.others(sid), app.api.project()]);
  const order = project.sessions.map((s) => s.id);
  const before = known.filter((n) => order.indexOf(n.id) < order.indexOf(sid)).at(-1) ?? known.at(-1);
  return [known, before?.name];
}
