// What a person can do to the selected things, whichever way it was asked for: a key, a button, a menu.

import { span } from "./document";
import { type Context, enclosing, guessRoles, type Labelled, naming, press, pressAll, rolesField } from "./labelling";
import { type App, MACHINE, type Selected, SPEEDS } from "./state";
import type { AnnotatedObject, Change, EcatEvent, EventType, Operation, RecordJson, Relation } from "./types";

/** The id of the first element of a kind that a record added. */
export function addedId(record: RecordJson, kind: "object" | "event" | "relation"): string | null {
  return record.changes.find((c) => c.kind === kind && c.before === null)?.id ?? null;
}

/** Runs an edit; a refusal has already been shown. */
export async function attempt(app: App, operations: Operation | Operation[]): Promise<RecordJson | null> {
  try {
    return await app.edit(operations);
  } catch {
    return null;
  }
}

function selectOwn(app: App, kind: Selected["kind"], id: string | null): void {
  if (id !== null) app.select([{ kind, id, layer: app.activeLayer }]);
}

export function ownEvents(app: App): EcatEvent[] {
  return app.selection
    .filter((s) => s.kind === "event" && s.layer === app.activeLayer)
    .map((s) => app.document.event(s.id))
    .filter((e) => e !== undefined);
}

/** The selected event of the edited layer; says so when there is none. */
function ownEvent(app: App, wish: string): EcatEvent | null {
  const event = ownEvents(app).at(-1) ?? null;
  if (event === null) {
    app.notify(app.primary !== null && app.primary.layer !== app.activeLayer
      ? `This belongs to the layer ${app.primary.layer}, which is not the one you edit.`
      : `Select an event to ${wish}.`);
  }
  return event;
}

/** The span of a new event: the marks, or from the start mark to the cursor, or a second around the cursor. */
export function newSpan(app: App): [number, number] {
  const { start, end } = app.marks;
  const { frame } = app.cursor;
  const last = Math.max(1, app.nFrames);
  if (start !== null && end !== null) return start < end ? [start, end] : [end, start];
  if (start !== null && frame !== start) return [Math.min(start, frame), Math.max(start, frame)];
  if (end !== null && frame < end) return [frame, end];
  const length = Math.max(1, Math.round(app.session?.frame_rate_median ?? 30));
  return [Math.min(frame, last - 1), Math.min(last, frame + length)];
}

export async function newEvent(app: App, type = app.settings.lastType, span: [number, number] = newSpan(app)): Promise<void> {
  const known = app.scheme.event_types.find((t) => t.name === type) ?? app.scheme.event_types[0];
  const name = type === "" ? (known?.name ?? "") : type;
  const record = await addFound(app, name, known?.tier ?? app.settings.lastTier, span[0], span[1]);
  if (record === null) return;
  app.setMarks({ start: null, end: null });
  app.set({ lastType: name });
}

/** A sub-event of the selected event: the marks if they lie inside, else from the end of the last one to the cursor. */
export async function newSubEvent(app: App): Promise<void> {
  const parent = ownEvent(app, "add a sub-event to it");
  if (parent === null) return;
  const [start, end] = span(parent);
  const last = app.document.children(parent.id).at(-1);
  const from = app.marks.start ?? (last === undefined ? start : span(last)[1]);
  const to = app.marks.end ?? (app.cursor.frame > from ? app.cursor.frame : end);
  if (Math.min(to, end) <= Math.max(from, start)) {
    app.notify("There is no room left in the event for a sub-event; set the marks I and O inside it.");
    return;
  }
  const tier = app.scheme.tiers.find((t) => t.parent === parent.tier)?.name ?? "";
  const record = await attempt(app, {
    op: "add_event", tier, parent: parent.id, segments: [[Math.max(from, start), Math.min(to, end)]],
  });
  if (record !== null) {
    app.setMarks({ start: null, end: null });
    selectOwn(app, "event", addedId(record, "event"));
  }
}

/** The key of an event type was pressed. */
export function pressLabel(app: App, type: EventType): Promise<void> {
  // While an event is repeated the cursor goes in circles: the keys say what it is.
  const repeated = app.cursor.loop === null || app.primary?.layer !== app.activeLayer ? null : app.selectedEvent;
  if (repeated !== null && app.running.length === 0) return nameEvent(app, repeated, type);
  return labelling(app, (frame, object) => press(app.running, type, frame, labelContext(app, object)));
}

async function nameEvent(app: App, event: EcatEvent, type: EventType): Promise<void> {
  await attempt(app, naming(event, { type: type.name }, labelContext(app, await actedUpon(app))));
}

export function closeLabels(app: App): Promise<void> {
  return labelling(app, (frame, object) => pressAll(app.running, frame, labelContext(app, object)));
}

function labelContext(app: App, object: string | null): Context {
  return { document: app.document, scheme: app.scheme, object };
}

/** Keys may come faster than answers: each is worked out when the one before has been written. */
let labels: Promise<void> = Promise.resolve();

function labelling(app: App, work: (frame: number, object: string | null) => Labelled): Promise<void> {
  const { frame } = app.cursor;
  labels = labels.then(async () => {
    const { operations, running, written } = work(frame, await actedUpon(app));
    if (operations.length > 0) {
      if (app.document.scheme === "" && app.scheme.name !== "") operations.unshift({ op: "set_scheme", name: app.scheme.name });
      const record = await attempt(app, operations);
      if (record === null) return;
      const added = record.changes.filter((c) => c.kind === "event" && c.before === null).map((c) => c.id);
      if (written !== null) written.id = added[0];
      const whole = [...added.map((id) => app.document.event(id)), ...running.map((r) => app.document.event(r.id ?? ""))].find((e) => e !== undefined);
      const named = operations.find((o) => o.op === "edit_event")?.id;
      selectOwn(app, "event", typeof named === "string" ? named : (whole?.id ?? null));
    }
    app.setRunning(running);
  });
  return labels;
}

/** Adds an event with its parent and roles found. */
async function addFound(app: App, name: string, tier: string, start: number, end: number): Promise<RecordJson | null> {
  const type = app.scheme.event_types.find((t) => t.name === name);
  const parent = enclosing(app.document, tier, start, end, app.scheme);
  const roles = guessRoles(type, parent, await actedUpon(app), app.document);
  const record = await attempt(app, { op: "add_event", type: name, tier, segments: [[start, end]], parent: parent?.id ?? null, roles: rolesField(roles) });
  selectOwn(app, "event", record && addedId(record, "event"));
  return record;
}

/** The object that was selected last stays the one acted upon while events are labelled. */
const lastObject = new WeakMap<App, Selected>();

export function rememberObject(app: App): void {
  const selected = app.selection.findLast((s) => s.kind === "object");
  if (selected !== undefined) lastObject.set(app, selected);
}

async function actedUpon(app: App): Promise<string | null> {
  const chosen = lastObject.get(app);
  return chosen === undefined ? null : ownObject(app, chosen.layer, chosen.id);
}

/**
 * The id in the edited layer of an object of any layer: what the machine tracked is taken over where it is needed,
 * under its own id if that is free, because tables name it so.
 */
export async function ownObject(app: App, layer: string, id: string): Promise<string | null> {
  const theirs = app.layers.get(layer)?.document.object(id);
  if (layer === app.activeLayer || theirs === undefined) return layer === app.activeLayer && theirs ? id : null;
  const same = app.document.objects.list.find((o) => o.kind === theirs.kind && o.name === theirs.name);
  if (same !== undefined) return same.id;
  const { kind, name, color, semantic_type, dimensions, stream, line_width } = theirs;
  const free = app.document.object(id) === undefined ? { id } : {};
  const record = await attempt(app, { op: "add_object", kind, name, color, semantic_type, dimensions, stream, line_width, ...free });
  return record && addedId(record, "object");
}

/** Objects of the machine's that the edited layer has no copy of. */
export function trackedObjects(app: App): AnnotatedObject[] {
  const own = app.document.objects.list;
  return (app.machine?.objects.list ?? []).filter((m) => !own.some((o) => o.kind === m.kind && o.name === m.name));
}

export async function removeSelected(app: App): Promise<void> {
  const chosen = new Set(app.selection.map((s) => s.id));
  // What goes with its event anyway is not removed a second time.
  const own = app.selection.filter((s) => s.layer === app.activeLayer && !(s.kind === "event" && ancestors(app, s.id).some((id) => chosen.has(id))));
  if (own.length === 0) {
    if (app.primary?.layer === MACHINE) return rejectSelected(app);
    return;
  }
  const operations = own.map((s) => ({ op: `remove_${s.kind}`, id: s.id }));
  const record = await attempt(app, operations);
  if (record !== null) {
    app.select([]);
    const gone = record.changes.filter((c) => c.after === null && c.kind !== "key_frame").length;
    app.notify(gone > own.length ? `Removed, with ${gone - own.length} things that belonged to it.` : "Removed.", "Ctrl+Z brings it back.");
  }
}

function ancestors(app: App, id: string): string[] {
  const found: string[] = [];
  for (let at = app.document.event(id)?.parent ?? null; at !== null && found.length < 32; at = app.document.event(at)?.parent ?? null) found.push(at);
  return found;
}

/** Moves one edge of a segment; where sub-events would stick out, asks whether they are to be cut as well. */
export async function moveEdge(app: App, event: EcatEvent, segment: number, edge: "start" | "end", frame: number): Promise<RecordJson | null> {
  const hull = event.segments.flatMap((s, i) => (i !== segment ? [s.start_frame, s.end_frame] : edge === "start" ? [frame, s.end_frame] : [s.start_frame, frame]));
  const [low, high] = [Math.min(...hull), Math.max(...hull)];
  const cut = app.document.children(event.id).filter((c) => span(c)[0] < low || span(c)[1] > high);
  const operation: Operation = { op: "move_edge", id: event.id, segment, edge, frame };
  if (cut.length > 0) {
    const names = cut.map((c) => c.type || c.id).join(", ");
    if (!(await app.confirm("Cut the sub-events too?", `${names} would reach beyond the event.`, "Cut them"))) return null;
    operation.children = "clip";
  }
  return attempt(app, operation);
}

export async function split(app: App): Promise<void> {
  const event = ownEvent(app, "split it");
  if (event !== null) await attempt(app, { op: "split_event", id: event.id, frame: app.cursor.frame });
}

/** Merges the selected events, or the selected one with the next of its tier. */
export async function merge(app: App): Promise<void> {
  const chosen = ownEvents(app);
  let ids = chosen.map((e) => e.id);
  const only = chosen[0];
  if (chosen.length === 1 && only !== undefined) {
    const next = siblings(app, only).find((e) => span(e)[0] >= span(only)[1]);
    if (next === undefined) return app.notify("There is no later event on this tier to merge with.");
    ids = [only.id, next.id];
  }
  if (ids.length < 2) return void ownEvent(app, "merge it with the next");
  const record = await attempt(app, { op: "merge_events", ids });
  if (record !== null) selectOwn(app, "event", ids.find((id) => app.document.event(id) !== undefined) ?? null);
}

function siblings(app: App, event: EcatEvent): EcatEvent[] {
  return app.document.events.list
    .filter((e) => e.tier === event.tier && e.parent === event.parent)
    .sort((a, b) => span(a)[0] - span(b)[0]);
}

/** Moves an edge of the selected segment by frames; keeps the segment at least one frame long. */
export async function nudge(app: App, edge: "start" | "end", by: number): Promise<void> {
  const event = ownEvent(app, "nudge its edges");
  if (event === null) return;
  const at = app.primary?.segment ?? (edge === "start" ? 0 : event.segments.length - 1);
  const segment = event.segments[at];
  if (segment === undefined) return;
  const frame = (edge === "start" ? segment.start_frame : segment.end_frame) + by;
  const low = edge === "start" ? 0 : segment.start_frame + 1;
  const high = edge === "start" ? segment.end_frame - 1 : app.nFrames;
  if (frame < low || frame > high) return;
  if ((await moveEdge(app, event, at, edge, frame)) !== null) app.seek(edge === "start" ? frame : frame - 1);
}

export async function toggleUnsure(app: App): Promise<void> {
  const events = ownEvents(app);
  if (events.length === 0) return void ownEvent(app, "mark it unsure");
  const unsure = !events.every((e) => e.unsure);
  await attempt(app, events.map((e) => ({ op: "edit_event", id: e.id, unsure })));
}

/** The object is absent from the cursor on; or present again, where it is absent now. */
export async function markAbsent(app: App): Promise<void> {
  const object = app.selectedObject;
  if (object === null || app.primary?.layer !== app.activeLayer) return app.notify("Select an object to mark it absent.");
  await attempt(app, { op: "set_absent", object: object.id, frame: app.cursor.frame });
}

export function toggleLoop(app: App): void {
  if (app.cursor.loop !== null) return app.setLoop(null);
  const event = app.selectedEvent;
  const segment = event?.segments[app.primary?.segment ?? 0];
  const { start, end } = app.marks;
  if (segment !== undefined) app.setLoop([segment.start_frame, segment.end_frame]);
  else if (start !== null && end !== null) app.setLoop([Math.min(start, end), Math.max(start, end)]);
  else app.notify("Select an event, or set the marks I and O, to repeat a stretch.");
}

/** Enter: accepts selected proposals, confirms selected events, ends running labels. */
export async function confirmSelected(app: App): Promise<void> {
  if (app.running.length > 0) return closeLabels(app);
  const proposals = app.selection.filter((s) => s.layer === MACHINE);
  if (proposals.length > 0) return acceptSelected(app);
  const open = ownEvents(app).filter((e) => e.status === "proposed");
  if (open.length > 0) await attempt(app, open.map((e) => ({ op: "edit_event", id: e.id, status: "confirmed" })));
}

export async function acceptSelected(app: App, adjusted: { start_frame?: number; end_frame?: number; type?: string } = {}): Promise<void> {
  const chosen = openSelected(app);
  if (chosen.length === 0) return;
  const last = chosen.at(-1) as Selected;
  const next = neighbourProposal(app, last);
  const record = await attempt(app, chosen.map((s) => ({ op: "accept_proposal", proposal: `${MACHINE}/${s.id}`, ...(chosen.length === 1 ? adjusted : {}) })));
  if (record !== null) goTo(app, next);
}

export async function rejectSelected(app: App): Promise<void> {
  const chosen = openSelected(app);
  if (chosen.length === 0) return;
  const next = neighbourProposal(app, chosen.at(-1) as Selected);
  const record = await attempt(app, chosen.map((s) => ({ op: "reject_proposal", proposal: `${MACHINE}/${s.id}` })));
  if (record !== null) goTo(app, next);
}

function openSelected(app: App): Selected[] {
  const chosen = app.selection.filter((s) => s.layer === MACHINE && s.kind !== "object" && app.decided(s.id) === null);
  if (chosen.length === 0) app.notify("Select an open proposal: one that is drawn hollow.");
  return chosen;
}

/** The next open proposal of the same kind after this one, so that going through them takes one key each. */
function neighbourProposal(app: App, from: Selected): Selected | null {
  const open = app.openProposals();
  const list: (EcatEvent | Relation)[] = from.kind === "event" ? open.events.filter((e) => e.parent === null) : open.relations;
  const ordered = [...list].sort((a, b) => startOf(a) - startOf(b));
  const at = ordered.findIndex((e) => e.id === from.id);
  const next = ordered[at + 1] ?? ordered[at - 1];
  return next === undefined ? null : { kind: from.kind, id: next.id, layer: MACHINE };
}

export function startOf(element: EcatEvent | Relation): number {
  return "segments" in element ? span(element)[0] : element.start_frame;
}

/** Selects an element and moves the cursor to its start. */
export function goTo(app: App, selected: Selected | null): void {
  if (selected === null) return app.select([]);
  app.select([selected]);
  const document = app.layers.get(selected.layer)?.document;
  const element = selected.kind === "event" ? document?.event(selected.id) : selected.kind === "relation" ? document?.relation(selected.id) : undefined;
  if (element !== undefined) app.seek(startOf(element));
  else {
    const first = document?.object(selected.id)?.key_frames.find((k) => k.present);
    if (first !== undefined && app.cursor.frame < first.frame) app.seek(first.frame);
  }
}

/** Selects the previous (-1) or next (+1) event in time among those shown. */
export function stepEvent(app: App, by: -1 | 1): void {
  const all = app.shownLayers.flatMap((l) => l.document.events.list
    .filter((e) => l.name !== MACHINE || app.decided(e.id) === null)
    .map((e) => ({ layer: l.name, id: e.id, at: span(e) })));
  all.sort((a, b) => a.at[0] - b.at[0] || b.at[1] - a.at[1] || (a.id < b.id ? -1 : 1));
  const now = app.primary?.kind === "event" ? all.findIndex((e) => e.id === app.primary?.id && e.layer === app.primary.layer) : -1;
  const frame = app.cursor.frame;
  const next = now >= 0 ? all[now + by] : by > 0 ? all.find((e) => e.at[0] >= frame) : all.findLast((e) => e.at[0] <= frame);
  if (next !== undefined) goTo(app, { kind: "event", id: next.id, layer: next.layer });
}

/** Moves the cursor to the previous or next edge of any shown event. */
export function stepEdge(app: App, by: -1 | 1): void {
  let best: number | null = null;
  const frame = app.cursor.frame;
  for (const layer of app.shownLayers) {
    for (const event of layer.document.events.list) {
      for (const s of event.segments) {
        for (const edge of [s.start_frame, s.end_frame]) {
          if ((edge - frame) * by > 0 && (best === null || Math.abs(edge - frame) < Math.abs(best - frame))) best = edge;
        }
      }
    }
  }
  if (best !== null) app.seek(best);
}

export function changeSpeed(app: App, by: -1 | 1): void {
  const now = SPEEDS.findIndex((s) => s >= app.cursor.speed - 1e-6);
  app.setSpeed(SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, (now < 0 ? SPEEDS.length : now) + by))] ?? 1);
}

export function undo(app: App): void {
  void app.undo().then((r) => app.notify("Undone.", changesOf(r))).catch(() => undefined);
}

export function redo(app: App): void {
  void app.redo().then((r) => app.notify("Done again.", changesOf(r))).catch(() => undefined);
}

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
