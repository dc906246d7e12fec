// Labelling with one key per event type while the recording plays.
// A key begins its type; pressed again it ends it; on the same tier the next type ends the one before.

import { type Document, span } from "./document";
import type { Running } from "./state";
import type { EcatEvent, EventType, Operation, Role, Scheme } from "./types";

export interface Labelled {
  running: Running[];
  /** Labels that ended with this key, in the order in which they are to be written. */
  closed: { label: Running; end: number }[];
}

/** Presses the key of `type` at `frame`. */
export function press(running: Running[], type: EventType, frame: number, scheme: Scheme): Labelled {
  const same = running.find((r) => r.type === type.name);
  if (same !== undefined) {
    // An event that ends takes its running sub-events with it.
    const ending = running.filter((r) => r === same || isBelow(r.tier, same.tier, scheme));
    return { running: running.filter((r) => !ending.includes(r)), closed: close(ending, frame, scheme) };
  }
  const ending = running.filter((r) => r.tier === type.tier || isBelow(r.tier, type.tier, scheme));
  const begun: Running = { type: type.name, tier: type.tier, start: frame };
  return { running: [...running.filter((r) => !ending.includes(r)), begun], closed: close(ending, frame, scheme) };
}

/**
 * Where an event starts whose key is pressed only once its parts have been labelled: at the first of the parts that
 * follow one another without a gap up to the one that runs.  Null: nothing of the tiers below runs.
 */
export function partsStart(document: Document, running: Running[], type: EventType, scheme: Scheme): number | null {
  if (running.some((r) => r.tier === type.tier)) return null;
  const part = running.find((r) => isBelow(r.tier, type.tier, scheme));
  if (part === undefined) return null;
  let start = part.start;
  for (const event of document.events.list.filter((e) => e.parent === null && e.tier === part.tier).sort((a, b) => span(b)[1] - span(a)[1])) {
    const [s, e] = span(event);
    if (e === start && s < start) start = s;
  }
  return start;
}

/** Ends everything that runs. */
export function pressAll(running: Running[], frame: number, scheme: Scheme): Labelled {
  return { running: [], closed: close(running, frame, scheme) };
}

function close(ending: Running[], frame: number, scheme: Scheme): Labelled["closed"] {
  // Parents first, so that their sub-events find them.
  const depth = (r: Running): number => tierDepth(r.tier, scheme);
  return ending.filter((r) => frame > r.start).sort((a, b) => depth(a) - depth(b)).map((label) => ({ label, end: frame }));
}

export function isBelow(tier: string, ancestor: string, scheme: Scheme): boolean {
  for (let at = parentTier(tier, scheme), steps = 0; at !== null && steps < 16; at = parentTier(at, scheme), steps++) {
    if (at === ancestor) return true;
  }
  return false;
}

export function parentTier(tier: string, scheme: Scheme): string | null {
  return scheme.tiers.find((t) => t.name === tier)?.parent ?? null;
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

/** Parentless events of the tiers below, inside [start, end): the sub-events that were labelled before their event ended. */
export function orphans(document: Document, tier: string, start: number, end: number, scheme: Scheme): EcatEvent[] {
  return document.events.list.filter((event) => {
    const [s, e] = span(event);
    return event.parent === null && s >= start && e <= end && parentTier(event.tier, scheme) === tier;
  });
}

/**
 * The roles that a new event can take without asking: those of its parent by name, then the selected object, which
 * is what is acted upon, then the only person there is.
 */
export function guessRoles(type: EventType | undefined, parent: EcatEvent | null, objectId: string | null, document: Document): Record<string, Pick<Role, "target" | "kind">> {
  const found: Record<string, Pick<Role, "target" | "kind">> = {};
  const wanted = type?.roles ?? [];
  for (const role of wanted) {
    const given = parent?.roles.find((r) => r.name === role.name && r.kind === role.kind);
    if (given !== undefined) found[role.name] = { target: given.target, kind: given.kind };
  }
  const free = wanted.filter((r) => r.kind === "object" && found[r.name] === undefined);
  const used = new Set(Object.values(found).map((r) => r.target));
  const selected = objectId === null ? undefined : document.object(objectId);
  if (selected !== undefined && !used.has(selected.id)) {
    const agent = selected.kind === "rig";
    const role = agent
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

export function rolesField(roles: Record<string, Pick<Role, "target" | "kind">>): Operation["roles"] {
  // Only objects can be given by their id alone; the rest is set by set_role.
  return Object.fromEntries(Object.entries(roles).filter(([, r]) => r.kind === "object").map(([name, r]) => [name, r.target]));
}
