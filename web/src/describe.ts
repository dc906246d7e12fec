// What an edit did, in a few words.

import type { Change, Operation, RecordJson } from "./types";

/** "event a4 removed", for a change. */
export function titleOf(change: Change): string {
  const verb = change.before === null ? "added" : change.after === null ? "removed" : "changed";
  return [change.kind.replaceAll("_", " "), change.id, verb].filter(Boolean).join(" ");
}

/** What an edit came to, in a few words: an undo and a redo do not say it themselves. */
export function changesOf(record: RecordJson): string {
  const [first, ...more] = record.changes.filter((c) => c.kind !== "layer" || record.changes.length === 1);
  return first === undefined ? "" : more.length === 0 ? titleOf(first) : `${titleOf(first)} and ${more.length} more`;
}

const WORDS: Record<string, string> = {
  add_object: "add object", edit_object: "edit object", remove_object: "remove object", set_property: "set property",
  set_key_frame: "set key frame", set_absent: "mark absent", remove_key_frame: "remove key frame", set_presence: "set presence",
  copy_objects: "copy objects", add_event: "add event", edit_event: "edit event", remove_event: "remove event",
  set_segments: "set segments", move_edge: "move edge", move_event: "move event", add_segment: "add segment",
  remove_segment: "remove segment", split_event: "split event", merge_events: "merge events", set_parent: "set parent",
  link_events: "link events", unlink_events: "unlink events", set_role: "set role", add_reference: "add reference",
  remove_reference: "remove reference", find_references: "find references", set_predicates: "set predicates", set_slots: "set slots",
  add_relation: "add relation", edit_relation: "edit relation", remove_relation: "remove relation",
  accept_proposal: "accept proposal", reject_proposal: "reject proposal", set_scheme: "choose coding scheme",
  add_windows: "add windows", undo: "undo", redo: "redo", restore: "restore", replace: "replaced from outside",
};

/** An operation in a few words, for the history. */
export function describe(operation: Operation | Operation[]): string {
  if (Array.isArray(operation)) {
    // Of a step of several, what was added says more than what had to make room for it.
    const first = operation.find((o) => o.op === "edit_event" && o.type) ?? operation.find((o) => o.op.startsWith("add_") && o.type) ?? operation[0];
    return first === undefined ? "nothing" : operation.length === 1 ? describe(first) : `${describe(first)} and ${operation.length - 1} more`;
  }
  const inner = operation.operations;
  if (Array.isArray(inner)) return describe(inner as Operation[]);
  const subject = [operation.id, operation.object, operation.target, operation.proposal].find((v) => typeof v === "string" && v !== "");
  const what = [operation.type, operation.predicate, operation.name, operation.role].find((v) => typeof v === "string" && v !== "");
  const revision = operation.op === "undo" ? operation.undoes : operation.op === "redo" ? operation.redoes : operation.op === "restore" ? operation.revision : undefined;
  return [WORDS[operation.op] ?? operation.op, what, subject, revision === undefined ? "" : `#${String(revision)}`].filter(Boolean).join(" ");
}
