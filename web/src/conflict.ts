// When somebody else wrote in the meantime: which of their changes bear on the edit that was refused.

import type { Document } from "./document";
import type { Change, Operation, RecordJson } from "./types";

export interface Conflict {
  operations: Operation[];
  records: RecordJson[];
  /** The changes of others to elements that the edit names. None: the edit can be sent again without a question. */
  touched: { change: Change; record: RecordJson }[];
  /** The record of this very edit: it had arrived, only its answer was lost. */
  alreadyDone: RecordJson | null;
}

const REFERENCES = ["id", "ids", "object", "objects", "target", "parent", "arguments", "subject", "locative", "proposal"];

/** The ids of elements that operations name. */
export function namedIds(operations: Operation[]): Set<string> {
  const found = new Set<string>();
  const add = (value: unknown): void => {
    if (typeof value === "string" && value !== "") {
      found.add(value.replace(/^machine\//, ""));
      found.add(value.split("/")[0] ?? value);
    } else if (Array.isArray(value)) value.forEach(add);
    else if (value !== null && typeof value === "object") Object.values(value).forEach(add);
  };
  for (const operation of operations) {
    for (const field of REFERENCES) add(operation[field]);
    add(operation.roles);
  }
  return found;
}

export function changedId(change: Change): string {
  return change.kind.startsWith("key_frame") ? change.id.slice(0, change.id.lastIndexOf("@")) : change.id;
}

function isBlank(value: unknown): boolean {
  return value === undefined || value === null || value === "" || value === false || (typeof value === "object" && Object.keys(value).length === 0);
}

/** Whether what was sent says the same as what was recorded, where fields that have their default are left out. */
function same(a: unknown, b: unknown): boolean {
  if (a === b || (isBlank(a) && isBlank(b))) return true;
  if (typeof a !== "object" || typeof b !== "object" || a === null || b === null) return false;
  if (Array.isArray(a) !== Array.isArray(b)) return false;
  const left = a as Record<string, unknown>;
  const right = b as Record<string, unknown>;
  return Object.keys(left).every((key) => same(left[key], right[key]));
}

export function decideConflict(
  operations: Operation[], author: string, records: RecordJson[], document: Document, answerLost: boolean,
): Conflict {
  const sent = operations.length === 1 ? [operations[0]] : operations;
  const alreadyDone = answerLost
    ? (records.find((r) => {
        const done = Array.isArray(r.operation) ? r.operation : (r.operation.op === "batch" ? (r.operation.operations as Operation[]) : [r.operation]);
        return r.author === author && done.length === sent.length && sent.every((o, i) => same(o, done[i]));
      }) ?? null)
    : null;
  const ids = namedIds(operations);
  for (const id of [...ids]) {
    // A parent's span binds its children and theirs its own.
    const parent = document.event(id)?.parent;
    if (parent) ids.add(parent);
  }
  const touched = records.flatMap((record) =>
    record.changes.filter((change) => ids.has(changedId(change))).map((change) => ({ change, record })),
  );
  return { operations, records, touched, alreadyDone };
}
