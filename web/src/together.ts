// Edits of all sessions of the project, one step of undo in each.

import { closing, openDialog } from "./dialogs";
import { h } from "./dom";
import { follow } from "./jobs";
import type { App } from "./state";
import type { Operation } from "./types";

interface Outcome {
  id: string;
  revision: number | null;
  changes: number;
  error: string | null;
}

/** `make`: also where the layer is not there yet. */
export async function editAll(app: App, title: string, layer: string, operations: Operation[], make: boolean): Promise<void> {
  const author = await app.author().catch((error: unknown) => app.fail(error));
  if (author === undefined) return;
  const job = await follow(app, title, () => app.api.editAll({ author, layer, operations, make }));
  if (job === null) return;
  const outcomes = (job.result?.sessions ?? []) as Outcome[];
  const failed = outcomes.filter((o) => o.error !== null);
  const done = outcomes.filter((o) => o.error === null && o.revision !== null).length;
  app.notify(`${done} of ${outcomes.length} sessions were edited.`, "Ctrl+Z in a session takes it back there.");
  if (failed.length === 0) return;
  openDialog({
    title: `${failed.length} ${failed.length === 1 ? "session was" : "sessions were"} left as they were`, testId: "failures", size: "wide-dialog",
    body: [h("table", null, h("tbody", null, failed.slice(0, 200).map((o) => h("tr", null, h("td", null, o.id), h("td", null, o.error)))))],
    foot: [closing("Close", "", "primary")],
  });
}

/** Marks the names of objects in the texts of all events. */
export function findEverywhere(app: App, layer: string): Promise<void> {
  return editAll(app, "Finding objects in all texts", layer, [{ op: "find_references" }], false);
}
