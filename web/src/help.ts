// The overlay with every shortcut, made from the table that the keyboard itself uses.

import { openDialog } from "./dialogs";
import { h } from "./dom";
import { GROUPS, SHORTCUTS } from "./keyboard";
import type { App } from "./state";

export function openHelp(app: App): void {
  const typed = app.scheme.event_types.filter((t) => t.key !== "");
  const groups = GROUPS.map((group) => h("section", null, h("h3", null, group),
    SHORTCUTS.filter((s) => s.group === group).map((s) => line(s.show, s.label))));
  if (typed.length > 0) {
    groups.push(h("section", null, h("h3", null, `Labels of ${app.scheme.name}`), typed.map((t) => line([t.key], t.name)),
      h("p.muted", null, "Press to start, press again to end; the next label of the same tier ends the one before. Held down, it ends when you let go. Right after E, the key says what the new event is.")));
  }
  openDialog({ title: "Keyboard", testId: "help", size: "full-dialog", body: [h("div.columns", null, groups)] });
}

function line(keys: string[], label: string): HTMLElement {
  return h("div.shortcut", null, h("span", null, label), h("span.keys", null, keys.map((k) => h("kbd", null, k))));
}
