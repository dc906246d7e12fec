// What a person can do to the selected things, whichever way it was asked for: a key, a button, a menu.

import { changesOf } from "./describe";
import { type Document, span } from "./document";
import type { Wish } from "./edits";
import { type Context, enclosing, guessRoles, type Labelled, naming, press, pressAll, rolesField } from "./labelling";
import { goTo } from "./navigate";
import { neighbour, openWhole } from "./proposals";
import { type App, MACHINE, type Selected } from "./state";
import type { AnnotatedObject, EcatEvent, EventType, Operation, RecordJson } from "./types";

/** The id of the first element of a kind that a record added. */
export function addedId(record: RecordJson, kind: "object" | "event" | "relation"): string | null {
  return record.changes.find((c) => c.kind === kind && c.before === null)?.id ?? null;
}

/** Runs an edit; a refusal has already been shown. */
export async function attempt(app: App, wish: Wish): Promise<RecordJson | null> {
  try {
    return await app.edit(wish);
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
  if (!app.cursor.playing && otherTypes(app, known?.tier ?? "").length > 0) app.guess(addedId(record, "event"));
}

/** The types with a key that an event of this tier can have. */
export function otherTypes(app: App, tier: string): EventType[] {
  return app.scheme.event_types.filter((t) => t.key !== "" && (t.tier === tier || t.tier === ""));
}

/** A sub-event of the selected event: the marks if they lie inside, else from the end of the last one to the cursor. */
export async function newSubEvent(app: App): Promise<void> {
  const parent = ownEvent(app, "add a sub-event to it");
  if (parent === null) return;
  const { marks, cursor: { frame } } = app;
  const record = await attempt(app, (document) => {
    const now = document.event(parent.id);
    if (now === undefined) return null;
    const [start, end] = span(now);
    const last = document.children(now.id).at(-1);
    const from = Math.max(marks.start ?? (last === undefined ? start : span(last)[1]), start);
    const to = Math.min(marks.end ?? (frame > from ? frame : end), end);
    const tier = app.scheme.tiers.find((t) => t.parent === now.tier)?.name ?? "";
    if (to > from) return [{ op: "add_event", tier, parent: now.id, segments: [[from, to]] }];
    app.notify("There is no room left in the event for a sub-event; set the marks I and O inside it.");
    return null;
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
  // The type of an event that was just made is a guess: the next key corrects it.
  const guessed = app.guessed === null ? null : (app.document.event(app.guessed) ?? null);
  const meant = repeated ?? (guessed !== null && otherTypes(app, guessed.tier).includes(type) ? guessed : null);
  if (meant !== null && app.running.length === 0) return nameEvent(app, meant, type);
  return labelling(app, (frame, object) => press(app.running, type, frame, labelContext(app, object)));
}

export async function nameEvent(app: App, event: EcatEvent, type: EventType): Promise<void> {
  if (app.guessed === event.id) app.set({ lastType: type.name });
  app.guess(null);
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
export function moveEdge(app: App, event: EcatEvent, segment: number, edge: "start" | "end", frame: number): Promise<RecordJson | null> {
  return attempt(app, (document) => edgeMoved(app, document, event.id, segment, edge, frame));
}

async function edgeMoved(app: App, document: Document, id: string, segment: number, edge: "start" | "end", frame: number): Promise<Operation[] | null> {
  const event = document.event(id);
  if (event === undefined) return null;
  const hull = event.segments.flatMap((s, i) => (i !== segment ? [s.start_frame, s.end_frame] : edge === "start" ? [frame, s.end_frame] : [s.start_frame, frame]));
  const [low, high] = [Math.min(...hull), Math.max(...hull)];
  const cut = document.children(id).filter((c) => span(c)[0] < low || span(c)[1] > high);
  const operation: Operation = { op: "move_edge", id, segment, edge, frame };
  if (cut.length > 0) {
    const names = cut.map((c) => c.type || c.id).join(", ");
    if (!(await app.confirm("Cut the sub-events too?", `${names} would reach beyond the event.`, "Cut them"))) return null;
    operation.children = "clip";
  }
  return [operation];
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

/**
 * Moves an edge of the selected segment by frames; keeps the segment at least one frame long.  From where it is when
 * all edits before are done: pressed twice while the server is away, it moves by two.
 */
export async function nudge(app: App, edge: "start" | "end", by: number): Promise<void> {
  const event = ownEvent(app, "nudge its edges");
  if (event === null) return;
  const wished = app.primary?.segment;
  let frame = 0;
  const record = await attempt(app, (document) => {
    const segments = document.event(event.id)?.segments ?? [];
    const at = wished ?? (edge === "start" ? 0 : segments.length - 1);
    const segment = segments[at];
    if (segment === undefined) return null;
    frame = (edge === "start" ? segment.start_frame : segment.end_frame) + by;
    const low = edge === "start" ? 0 : segment.start_frame + 1;
    const high = edge === "start" ? segment.end_frame - 1 : app.nFrames;
    return frame < low || frame > high ? null : edgeMoved(app, document, event.id, at, edge, frame);
  });
  if (record !== null) app.seek(edge === "start" ? frame : frame - 1);
}

export async function toggleUnsure(app: App): Promise<void> {
  const events = ownEvents(app);
  if (events.length === 0) return void ownEvent(app, "mark it unsure");
  await attempt(app, (document) => {
    const now = events.map((e) => document.event(e.id)).filter((e) => e !== undefined);
    const unsure = !now.every((e) => e.unsure);
    return now.map((e) => ({ op: "edit_event", id: e.id, unsure }));
  });
}

/** The object is absent from the cursor on; or present again, where it is absent now. */
export async function markAbsent(app: App): Promise<void> {
  const object = app.selectedObject;
  if (object === null || app.primary?.layer !== app.activeLayer) return app.notify("Select an object to mark it absent.");
  await attempt(app, { op: "set_absent", object: object.id, frame: app.cursor.frame });
}

/** Plays the selected segment again and again, or no longer. */
export function toggleLoop(app: App): void {
  if (app.cursor.loop !== null) return app.setLoop(null);
  const event = app.selectedEvent;
  const segment = event?.segments[app.primary?.segment ?? 0];
  const { start, end } = app.marks;
  if (segment !== undefined) app.setLoop([segment.start_frame, segment.end_frame]);
  else if (start !== null && end !== null) app.setLoop([Math.min(start, end), Math.max(start, end)]);
  else return app.notify("Select an event, or set the marks I and O, to repeat a stretch.");
  app.setPlaying(true);
}

/** Enter: accepts selected proposals, confirms selected events, ends running labels. */
export async function confirmSelected(app: App): Promise<void> {
  if (app.running.length > 0) return closeLabels(app);
  app.guess(null);
  const proposals = app.selection.filter((s) => s.layer === MACHINE);
  if (proposals.length > 0) return acceptSelected(app);
  const open = ownEvents(app).filter((e) => e.status === "proposed");
  if (open.length > 0) await attempt(app, open.map((e) => ({ op: "edit_event", id: e.id, status: "confirmed" })));
}

export async function acceptSelected(app: App, adjusted: { start_frame?: number; end_frame?: number; type?: string } = {}): Promise<void> {
  const open = openSelected(app);
  const chosen = open.filter((s) => openWhole(app, s.id) === null);
  const part = open.find((s) => !chosen.includes(s));
  const whole = part === undefined ? null : openWhole(app, part.id);
  if (whole !== null && !open.some((s) => s.id === whole.id)) {
    app.notify(`This is a part of ${whole.type || "the event"} (${whole.id}), and comes with it when that is accepted.`);
  }
  const last = chosen.at(-1);
  if (last === undefined) return;
  const next = neighbour(app, last);
  const record = await attempt(app, chosen.map((s) => ({ op: "accept_proposal", proposal: `${MACHINE}/${s.id}`, ...(chosen.length === 1 ? adjusted : {}) })));
  if (record !== null) goTo(app, next);
}

export async function rejectSelected(app: App): Promise<void> {
  const chosen = openSelected(app);
  if (chosen.length === 0) return;
  const next = neighbour(app, chosen.at(-1) as Selected);
  const record = await attempt(app, chosen.map((s) => ({ op: "reject_proposal", proposal: `${MACHINE}/${s.id}` })));
  if (record !== null) goTo(app, next);
}

function openSelected(app: App): Selected[] {
  const chosen = app.selection.filter((s) => s.layer === MACHINE && s.kind !== "object" && app.decided(s.id) === null);
  if (chosen.length === 0) app.notify("Select an open proposal: one that is drawn hollow.");
  return chosen;
}

export function undo(app: App): void {
  void app.undo().then((r) => app.notify("Undone.", changesOf(r))).catch(() => undefined);
}

export function redo(app: App): void {
  void app.redo().then((r) => app.notify("Done again.", changesOf(r))).catch(() => undefined);
}
