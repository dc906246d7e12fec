// Every edit of the layer with its author and time; any revision can be brought back, which is an edit itself.

import { changesOf, describe } from "./describe";
import { changeView, openDialog } from "./dialogs";
import { fill, h } from "./dom";
import type { App } from "./state";
import type { RecordJson } from "./types";

const PAGE = 200;

export function openHistory(app: App): void {
  const list = h("div", { role: "listbox", "aria-label": "Edits, the newest first", tabindex: 0, "data-testid": "history-list" });
  const detail = h("div.dialog-body");
  const { closed } = openDialog({
    title: `History of ${app.activeLayer}`, testId: "history", size: "wide-dialog", body: [h("div.split-view", null, list, detail)],
  });
  let records: RecordJson[] = [];
  let chosen: number | null = null;
  let oldest = Infinity;

  const show = (): void => {
    list.setAttribute("role", records.length > 0 ? "listbox" : "group");
    fill(list, records.map((r) => item(r, r.revision === chosen, () => {
      chosen = r.revision;
      show();
    })), oldest > 1 && h("button.button", { type: "button", onclick: () => void load() }, "Older edits"));
    const record = records.find((r) => r.revision === chosen);
    fill(detail, record === undefined ? h("p.muted", null, records.length === 0 ? "Nothing has been edited yet." : "Choose an edit to see what it changed.") : details(app, record));
  };
  const load = async (): Promise<void> => {
    const sid = app.session?.id;
    if (sid === undefined) return;
    const end = Number.isFinite(oldest) ? oldest : app.active.revision + 1;
    const start = Math.max(1, end - PAGE);
    if (end <= 1) return show();
    try {
      const answer = await app.api.history(sid, app.activeLayer, start, end - start);
      records = [...records, ...[...answer.records].sort((a, b) => b.revision - a.revision)];
      oldest = start;
    } catch (error) {
      app.fail(error);
    }
    show();
  };
  const off = app.on("layer", ({ layer }) => {
    if (layer !== app.activeLayer) return;
    records = [];
    oldest = Infinity;
    void load();
  });
  void closed.then(off);
  list.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (by === undefined || records.length === 0) return;
    event.preventDefault();
    const at = records.findIndex((r) => r.revision === chosen);
    chosen = (records[Math.max(0, Math.min(records.length - 1, at + by))] as RecordJson).revision;
    show();
    list.querySelector('[aria-selected="true"]')?.scrollIntoView({ block: "nearest" });
  });
  void load();
}

function saying(record: RecordJson): string {
  const { operation } = record;
  const again = !Array.isArray(operation) && ["undo", "redo", "restore"].includes(operation.op);
  return again ? `${describe(operation)}: ${changesOf(record)}` : describe(operation);
}

function item(record: RecordJson, selected: boolean, choose: () => void): HTMLElement {
  return h("div.list-row.history-row", { role: "option", "aria-selected": selected ? "true" : "false", onclick: choose, "data-testid": `revision-${record.revision}` },
    h("span.at", null, String(record.revision)), h("span.grow", null, saying(record)), h("span.at", null, record.author));
}

function details(app: App, record: RecordJson): (HTMLElement | null)[] {
  const restore = (revision: number) => (): void => {
    void app.restore(revision).then(() => app.notify(`The layer is again as after revision ${revision}.`, "Ctrl+Z takes this back.")).catch(() => undefined);
  };
  const shown = record.changes.slice(0, 50);
  return [
    h("p", null, h("strong", null, `Revision ${record.revision}`), ` by ${record.author}, ${new Date(record.time).toLocaleString("en-GB")}`),
    h("div.row", null,
      h("button.button", { type: "button", onclick: restore(record.revision), disabled: record.revision === app.active.revision, "data-testid": "restore" }, "Restore to here"),
      h("button.button", { type: "button", onclick: restore(record.revision - 1), "data-testid": "restore-before" }, "Restore to before this")),
    ...shown.map(changeView),
    ...(record.changes.length > shown.length ? [h("p.muted", null, `and ${record.changes.length - shown.length} more`)] : []),
  ];
}
