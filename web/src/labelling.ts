// Labelling with one key per event type while the recording plays.
//
// A key begins its type; pressed again it ends it; on the same tier the next type ends the one before.  A part has to lie
// in a whole, so the whole is written with its first part and grows with each: what was labelled is on the disk at
// every key, also when the whole gets its name last.

import { type Document, span } from "./document";
import type { Running } from "./state";
import type { EcatEvent, EventType, Operation, Role, Scheme } from "./types";

export interface Context {
  document: Document;
  scheme: Scheme;
  /** The object that is acted upon. */
  object: string | null;
}

/** What a key does: operations that are one step, and the labels that run then. */
export interface Labelled {
  operations: Operation[];
  running: Running[];
  /** The label whose event is the first one that the operations add. */
  written: Running | null;
}

/** Presses the key of `type` at `frame`. */
export function press(running: Running[], type: EventType, frame: number, context: Context): Labelled {
  const below = running.filter((r) => isBelow(r.tier, type.tier, context.scheme));
  const same = running.find((r) => r.type === type.name && r.type !== "");
  if (same !== undefined) return end([same, ...below], without(running, [same, ...below]), frame, context);

  const unnamed = running.find((r) => r.tier === type.tier && r.type === "");
  if (unnamed !== undefined && (below.length > 0 || endOf(unnamed, context) === frame)) {
    return end([{ ...unnamed, type: type.name }, ...below], without(running, [unnamed, ...below]), frame, context);
  }
  const first = below[0];
  if (first !== undefined && !running.some((r) => r.tier === type.tier)) {
    const start = Math.min(...below.map((r) => r.start));
    return end([{ type: type.name, tier: type.tier, start }, ...below], without(running, below), frame, context);
  }
  const ending = running.filter((r) => (r.tier === type.tier && r.type !== "") || below.includes(r));
  const ended = end(ending, without(running, [...ending, ...(unnamed ? [unnamed] : [])]), frame, context);
  // A whole without a name ends where its parts stop following one another.
  const kept = ended.running.filter((r) => r.type !== "" || ending.length > 0 || endOf(r, context) === frame);
  return { ...ended, running: [...kept, { type: type.name, tier: type.tier, start: frame }] };
}

/** Ends everything that runs. */
export function pressAll(running: Running[], frame: number, context: Context): Labelled {
  return { ...end(running, [], frame, context), running: [] };
}

function without(running: Running[], some: Running[]): Running[] {
  return running.filter((r) => !some.includes(r));
}

function written(label: Running, { document }: Context): EcatEvent | undefined {
  return label.id === undefined ? undefined : document.event(label.id);
}

function endOf(label: Running, context: Context): number | null {
  const event = written(label, context);
  return event === undefined ? null : span(event)[1];
}

function end(ending: Running[], staying: Running[], frame: number, context: Context): Labelled {
  const { document, scheme } = context;
  const made: Labelled = { operations: [], running: [...staying], written: null };
  const reaches = new Map<Running, number>();
  const grow = (label: Running): void => {
    const event = written(label, context);
    if (event === undefined) {
      if (!reaches.has(label)) made.operations.push(addition(label, frame, context, null));
      made.written = label;
    } else if ((reaches.get(label) ?? span(event)[1]) < frame) {
      made.operations.push({ op: "move_edge", id: event.id, segment: event.segments.length - 1, edge: "end", frame });
    }
    reaches.set(label, frame);
  };
  // Parts first: a whole that is not written yet is written with its first part.
  for (const label of [...ending].sort((a, b) => tierDepth(b.tier, scheme) - tierDepth(a.tier, scheme))) {
    const above = parentTier(label.tier, scheme);
    const event = written(label, context);
    if (event !== undefined) {
      grow(label);
      if (event.type !== label.type) made.operations.push(...naming(event, label, context));
      continue;
    }
    if (frame <= label.start || reaches.has(label)) continue;
    const around = enclosing(document, label.tier, label.start, frame, scheme);
    let whole = around === null && above !== null ? [...ending, ...made.running].find((r) => r.tier === above) : undefined;
    if (around === null && above !== null) {
      if (whole === undefined) {
        whole = { type: "", tier: above, start: label.start };
        made.running.push(whole);
      }
      grow(whole);
    }
    const named = around ?? (whole === undefined ? undefined : written(whole, context)) ?? null;
    made.operations.push(addition(label, frame, context, named));
  }
  return made;
}

/** Without a parent named, the server takes the shortest event around. */
function addition(label: Running, frame: number, context: Context, parent: EcatEvent | null): Operation {
  const type = context.scheme.event_types.find((t) => t.name === label.type);
  const roles = guessRoles(type, parent, context.object, context.document);
  return { op: "add_event", type: label.type, tier: label.tier, segments: [[label.start, frame]], roles: rolesField(roles), ...(parent ? { parent: parent.id } : {}) };
}

/** What gives an event the type of a label, and the roles that can be guessed. */
export function naming(event: EcatEvent, label: Pick<Running, "type">, { document, scheme, object }: Context): Operation[] {
  const type = scheme.event_types.find((t) => t.name === label.type);
  const roles = guessRoles(type, null, object, document);
  const filled = new Set(event.roles.map((r) => r.name));
  return [
    { op: "edit_event", id: event.id, type: label.type },
    ...Object.entries(roles).filter(([name]) => !filled.has(name)).map(([role, { target }]) => ({ op: "set_role", id: event.id, role, target })),
  ];
}

export function isBelow(tier: string, ancestor: string, scheme: Scheme): boolean {
  for (let at = parentTier(tier, scheme), steps = 0; at !== null && steps < 16; at = parentTier(at, scheme), steps++) {
    if (at === ancestor) return true;
  }
  return false;
}

/** The tier whose events those of `tier` are parts of. */
export function parentTier(tier: string, scheme: Scheme): string | null {
  const found = scheme.tiers.find((t) => t.name === tier);
  return found === undefined || found.constraint === "none" || found.constraint === "no_overlap" ? null : found.parent;
}

function tierDepth(tier: string, scheme: Scheme): number {
  let depth = 0;
  for (let at = parentTier(tier, scheme); at !== null && depth < 16; at = parentTier(at, scheme)) depth++;
  return depth;
}

/** The shortest event of the tier above that holds [start, end). */
export function enclosing(document: Document, tier: string, start: number, end: number, scheme: Scheme): EcatEvent | null {
  const above = parentTier(tier, scheme);
  if (above === null) return null;
  let best: EcatEvent | null = null;
  for (const event of document.events.list) {
    const [s, e] = span(event);
    if (event.tier !== above || s > start || e < end) continue;
    if (best === null || e - s < span(best)[1] - span(best)[0]) best = event;
  }
  return best;
}

type Guess = Record<string, Pick<Role, "target" | "kind">>;

/**
 * The roles that a new event can take without asking: those of its parent by name, then the selected object, which
 * is what is acted upon, then the only person there is.
 */
export function guessRoles(type: EventType | undefined, parent: EcatEvent | null, objectId: string | null, document: Document): Guess {
  const found: Guess = {};
  const wanted = type?.roles ?? [];
  for (const role of wanted) {
    const given = parent?.roles.find((r) => r.name === role.name && r.kind === role.kind);
    if (given !== undefined) found[role.name] = { target: given.target, kind: given.kind };
  }
  const used = new Set(Object.values(found).map((r) => r.target));
  const free = wanted.filter((r) => r.kind === "object" && found[r.name] === undefined);
  const selected = objectId === null ? undefined : document.object(objectId);
  if (selected !== undefined && !used.has(selected.id)) {
    const role = selected.kind === "rig"
      ? free.find((r) => r.name === "Agent")
      : (free.find((r) => r.name === "Theme") ?? free.find((r) => r.required) ?? free.find((r) => r.name !== "Agent"));
    if (role !== undefined) {
      found[role.name] = { target: selected.id, kind: "object" };
      used.add(selected.id);
    }
  }
  const rigs = document.objects.list.filter((o) => o.kind === "rig");
  const only = rigs[0];
  if (rigs.length === 1 && only !== undefined && !used.has(only.id) && free.some((r) => r.name === "Agent") && found.Agent === undefined) {
    found.Agent = { target: only.id, kind: "object" };
  }
  return found;
}

export function rolesField(roles: Guess): Record<string, string> {
  return Object.fromEntries(Object.entries(roles).map(([name, r]) => [name, r.target]));
}
