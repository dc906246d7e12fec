// Which lanes there are: events by tier with their parts below them, proposals, relations, objects.

import type { Document } from "../document";
import type { AnnotatedObject, EcatEvent, EventType, Relation, Scheme } from "../types";
import { colorOf } from "./colors";
import { type Interval, Intervals, spread } from "./intervals";

/** One segment of an event, or one relation, as it is drawn. */
export interface Bar extends Interval {
  readonly id: string;
  readonly what: "event" | "relation";
  readonly label: string;
  readonly color: string;
  /** Position of the segment in its event, and how many there are. */
  readonly segment: number;
  readonly segments: number;
  readonly hollow: boolean;
  readonly unsure: boolean;
  readonly denied: boolean;
}

interface RowBase {
  /** Stays the same while lanes are added and removed around it. */
  readonly key: string;
  readonly label: string;
  readonly depth: number;
  readonly height: number;
}
export interface GroupRow extends RowBase {
  readonly kind: "group";
  readonly layer: string;
  readonly count: number;
  readonly collapsed: boolean;
}
export interface BarRow extends RowBase {
  readonly kind: "bars";
  readonly layer: string;
  readonly tier: string;
  readonly proposals: boolean;
  /** Whether new events may be drawn here. */
  readonly editable: boolean;
  readonly bars: Intervals<Bar>;
  /** Whether any event here has several segments. */
  readonly broken: boolean;
}
export interface ObjectRow extends RowBase {
  readonly kind: "object";
  readonly layer: string;
  readonly object: AnnotatedObject;
  readonly relationFrames: readonly number[];
}
export type Row = GroupRow | BarRow | ObjectRow;

/** All alike: so whole rows are in view, however far it is scrolled. */
export const ROW_PX = 22;

/** What was made of a layer before: an edit touches one lane of many, the others stay as they are. */
export class LaneCache {
  readonly bars = new WeakMap<EcatEvent, readonly Bar[]>();
  readonly groups = new Map<string, { readonly events: readonly EcatEvent[]; readonly rows: readonly Row[] }>();
}

export interface LaneSource {
  readonly document: Document;
  readonly scheme: Scheme;
  readonly nFrames: number;
  readonly active: boolean;
  /** Whether this is a machine's layer: its events and relations are proposals. */
  readonly proposals: boolean;
  /** Ids (with their layer) that were decided about already. */
  readonly decided: ReadonlySet<string>;
  readonly collapsed: ReadonlySet<string>;
  readonly cache: LaneCache;
}

export type Section = "events" | "objects" | "relations";

/** The lanes of a layer, by section: those of all layers stand side by side. */
export function lanes(source: LaneSource): Record<Section, Row[]> {
  const { document, proposals } = source;
  const layer = document.name;
  const group = (section: Section, label: string, count: number, inner: () => Row[]): Row[] => {
    const key = `${layer}/${section}`;
    const collapsed = source.collapsed.has(key);
    const head: Row = { kind: "group", key, label: proposals ? label : `${label} · ${layer}`, layer, count, collapsed, depth: 0, height: ROW_PX };
    return collapsed ? [head] : [head, ...inner()];
  };
  const open = <T extends { id: string }>(list: readonly T[]) =>
    proposals ? list.filter((item) => !source.decided.has(`${layer}/${item.id}`)) : list;
  const events = open(document.events.list);
  const relations = open(document.relations.list);
  const objects = proposals ? [] : document.objects.list;
  return {
    events: proposals
      // parts are decided about with their events, and not counted
      ? (events.length ? group("events", "Proposed", events.filter((e) => e.parent === null).length, () => proposedRows(source, events)) : [])
      : group("events", "Events", events.length, () => eventRows(source, events)),
    objects: objects.length ? group("objects", "Objects", objects.length, () => objectRows(layer, objects, document.relations.list)) : [],
    relations: relations.length
      ? group("relations", proposals ? "Proposed relations" : "Relations", relations.length, () => relationRows(source, relations))
      : [],
  };
}

// --- events

/** Tiers in the order of the scheme's tree, then those that only the events name; each with its depth. */
function tierOrder(scheme: Scheme, used: Iterable<string>): Map<string, number> {
  const order = new Map<string, number>();
  const below = (parent: string | null, depth: number) => {
    for (const tier of scheme.tiers)
      if (tier.parent === parent && !order.has(tier.name)) {
        order.set(tier.name, depth);
        below(tier.name, depth + 1);
      }
  };
  below(null, 0);
  for (const name of [...used].sort()) if (!order.has(name)) order.set(name, 0);
  return order;
}

/** The tier of an event, which may be its parent's, and how deep it lies in it. */
function place(document: Document, event: EcatEvent, guard = 0): { tier: string; depth: number } {
  const parent = event.parent !== null && guard < 32 ? document.event(event.parent) : undefined;
  if (parent === undefined) return { tier: event.tier, depth: 0 };
  const above = place(document, parent, guard + 1);
  const tier = event.tier || above.tier;
  return { tier, depth: above.tier === tier ? above.depth + 1 : 0 };
}

export function eventColor(type: string, types: ReadonlyMap<string, EventType>): string {
  const chosen = types.get(type)?.color ?? "";
  return /^#[0-9a-f]{6}/i.test(chosen) ? chosen.slice(0, 7) : colorOf(type || "event");
}

export function eventLabel(event: EcatEvent): string {
  return (event.type || event.text || event.id) + (event.unsure ? " ?" : "");
}

/** Who proposes has lanes of their own, the first of which has their name. */
function proposedRows(source: LaneSource, events: readonly EcatEvent[]): Row[] {
  const byAuthor = new Map<string, EcatEvent[]>();
  for (const event of events) {
    const list = byAuthor.get(event.author);
    if (list) list.push(event);
    else byAuthor.set(event.author, [event]);
  }
  return [...byAuthor].sort(([a], [b]) => (a < b ? -1 : 1)).flatMap(([author, mine]) =>
    eventRows(source, mine, author).map((row, i) => (author === "" ? row : i === 0 ? { ...row, label: author } : { ...row, depth: Math.max(1, row.depth) })));
}

/** `author`: of whom all of the events are, where that makes a difference. */
function eventRows(source: LaneSource, events: readonly EcatEvent[], author = ""): Row[] {
  const { document, scheme } = source;
  const types = new Map(scheme.event_types.map((type) => [type.name, type]));
  const groups = new Map<string, Map<number, EcatEvent[]>>();
  for (const event of events) {
    if (!event.segments.length) continue;
    const { tier, depth } = place(document, event);
    let depths = groups.get(tier);
    if (!depths) groups.set(tier, (depths = new Map()));
    const list = depths.get(depth);
    if (list) list.push(event);
    else depths.set(depth, [event]);
  }
  const rows: Row[] = [];
  const order = tierOrder(scheme, groups.keys());
  if (source.active && !order.size) order.set("", 0);
  for (const [tier, indent] of order) {
    const depths = groups.get(tier) ?? new Map<number, EcatEvent[]>();
    if (!depths.size && !(source.active && !source.proposals)) continue;
    if (!depths.has(0)) depths.set(0, []);
    for (const depth of [...depths.keys()].sort((a, b) => a - b))
      rows.push(...eventLanes(source, { author, tier, indent, depth }, depths.get(depth)!, types));
  }
  return rows;
}

function eventLanes(
  source: LaneSource,
  { author, tier, indent, depth }: { author: string; tier: string; indent: number; depth: number },
  events: readonly EcatEvent[],
  types: ReadonlyMap<string, EventType>,
): readonly Row[] {
  const { cache, document, proposals } = source;
  const group = `${author}/${tier}/${depth}/${indent}/${source.active}`;
  const known = cache.groups.get(group);
  if (known?.events.length === events.length && known.events.every((event, i) => event === events[i])) return known.rows;
  const lane = spread(events.map(hull));
  const bars: Bar[][] = [[]];
  events.forEach((event, i) => (bars[lane[i]!] ??= []).push(...eventBars(source, event, types)));
  const rows = bars.map((list, i): Row => ({
    kind: "bars",
    key: `${document.name}/events/${author}/${tier}/${depth}/${i}`,
    label: i ? "" : depth ? "parts" : tier || "events",
    depth: indent + depth,
    height: ROW_PX,
    layer: document.name,
    tier,
    proposals,
    editable: source.active && !proposals && depth === 0,
    bars: new Intervals(list),
    broken: list.some((bar) => bar.segments > 1),
  }));
  cache.groups.set(group, { events, rows });
  return rows;
}

function eventBars(source: LaneSource, event: EcatEvent, types: ReadonlyMap<string, EventType>): readonly Bar[] {
  let bars = source.cache.bars.get(event);
  if (bars === undefined) {
    bars = event.segments.map((segment, k) => ({
      id: event.id,
      what: "event",
      start: segment.start_frame,
      end: Math.max(segment.end_frame, segment.start_frame + 1),
      label: eventLabel(event),
      color: eventColor(event.type, types),
      segment: k,
      segments: event.segments.length,
      hollow: source.proposals || event.status === "proposed",
      unsure: event.unsure,
      denied: false,
    }));
    source.cache.bars.set(event, bars);
  }
  return bars;
}

function hull(event: EcatEvent): Interval {
  let start = Number.POSITIVE_INFINITY;
  let end = Number.NEGATIVE_INFINITY;
  for (const segment of event.segments) {
    start = Math.min(start, segment.start_frame);
    end = Math.max(end, segment.end_frame);
  }
  return { start, end };
}

// --- relations

function relationRows(source: LaneSource, relations: readonly Relation[]): Row[] {
  const { document } = source;
  const byPredicate = new Map<string, Relation[]>();
  for (const relation of relations) {
    const list = byPredicate.get(relation.predicate);
    if (list) list.push(relation);
    else byPredicate.set(relation.predicate, [relation]);
  }
  const rows: Row[] = [];
  for (const [predicate, list] of [...byPredicate].sort(([a], [b]) => (a < b ? -1 : 1))) {
    const bars = list.map((relation) => relationBar(source, relation));
    const lane = spread(bars);
    const split: Bar[][] = [];
    bars.forEach((bar, i) => (split[lane[i]!] ??= []).push(bar));
    split.forEach((part, i) =>
      rows.push({
        kind: "bars",
        key: `${document.name}/relations/${predicate}/${i}`,
        label: i ? "" : predicate,
        depth: 0,
        height: ROW_PX,
        layer: document.name,
        tier: "",
        proposals: source.proposals,
        editable: false,
        bars: new Intervals(part),
        broken: false,
      }),
    );
  }
  return rows;
}

function relationBar(source: LaneSource, relation: Relation): Bar {
  const { document, nFrames, proposals } = source;
  const start = Math.max(0, relation.start_frame);
  const names = relation.arguments.map(({ target }) => document.object(target)?.name || target);
  return {
    id: relation.id,
    what: "relation",
    start,
    end: Math.max(start + 1, relation.end_frame ?? nFrames),
    label: `${relation.polarity ? "" : "not "}${names.join(", ")}`,
    color: relation.polarity ? colorOf(relation.predicate) : "#868e96",
    segment: 0,
    segments: 1,
    hollow: proposals || relation.status === "proposed",
    unsure: false,
    denied: !relation.polarity,
  };
}

// --- objects

function objectRows(layer: string, objects: readonly AnnotatedObject[], relations: readonly Relation[]): Row[] {
  const ticks = new Map<string, number[]>();
  for (const relation of relations)
    for (const { target } of relation.arguments) {
      const list = ticks.get(target);
      if (list) list.push(relation.start_frame);
      else ticks.set(target, [relation.start_frame]);
    }
  return objects.map((object) => ({
    kind: "object",
    key: `${layer}/objects/${object.id}`,
    label: object.name || object.id,
    depth: 0,
    height: ROW_PX,
    layer,
    object,
    relationFrames: ticks.get(object.id)?.sort((a, b) => a - b) ?? [],
  }));
}

/** When an object is there, as far as its key frames say. */
export function presence(object: AnnotatedObject, nFrames: number): Interval[] {
  if (!object.key_frames.length) return [];
  const found: Interval[] = [];
  let start: number | null = null;
  for (const key of object.key_frames) {
    if (key.present && start === null) start = key.frame;
    else if (!key.present && start !== null) {
      found.push({ start, end: key.frame });
      start = null;
    }
  }
  if (start !== null) found.push({ start, end: nFrames });
  return found;
}
