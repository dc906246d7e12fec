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
}
export interface ObjectRow extends RowBase {
  readonly kind: "object";
  readonly layer: string;
  readonly object: AnnotatedObject;
  readonly relationFrames: readonly number[];
}
export interface PlotRow extends RowBase {
  readonly kind: "plot";
  readonly series: string;
}
export type Row = GroupRow | BarRow | ObjectRow | PlotRow;

export const HEIGHT = { group: 22, bars: 22, object: 20, plot: 52 } as const;

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
}

export function lanes(source: LaneSource): Row[] {
  const { document, proposals } = source;
  const layer = document.name;
  const rows: Row[] = [];
  const group = (name: string, label: string, count: number, inner: () => Row[]) => {
    const key = `${layer}/${name}`;
    const collapsed = source.collapsed.has(key);
    rows.push({ kind: "group", key, label, layer, count, collapsed, depth: 0, height: HEIGHT.group });
    if (!collapsed) rows.push(...inner());
  };
  const open = <T extends { id: string }>(list: readonly T[]) =>
    proposals ? list.filter((item) => !source.decided.has(`${layer}/${item.id}`)) : list;
  const events = open(document.events.list);
  const relations = open(document.relations.list);
  const title = proposals ? "Proposals" : "Events";
  if (events.length || !proposals) group("events", `${title} · ${layer}`, events.length, () => eventRows(source, events));
  if (relations.length)
    group("relations", `${proposals ? "Proposed relations" : "Relations"} · ${layer}`, relations.length, () =>
      relationRows(source, relations),
    );
  const objects = document.objects.list;
  if (objects.length && !proposals)
    group("objects", `Objects · ${layer}`, objects.length, () => objectRows(layer, objects, document.relations.list));
  return rows;
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

interface Place {
  readonly tier: string;
  readonly depth: number;
}

function places(document: Document, events: readonly EcatEvent[]): Map<string, Place> {
  const found = new Map<string, Place>();
  const place = (event: EcatEvent, guard: number): Place => {
    const known = found.get(event.id);
    if (known) return known;
    const parent = event.parent !== null && guard < 32 ? document.event(event.parent) : undefined;
    const above = parent && place(parent, guard + 1);
    const tier = event.tier || above?.tier || "";
    const made = { tier, depth: above && above.tier === tier ? above.depth + 1 : 0 };
    found.set(event.id, made);
    return made;
  };
  for (const event of events) place(event, 0);
  return found;
}

export function eventColor(type: string, types: ReadonlyMap<string, EventType>): string {
  const chosen = types.get(type)?.color ?? "";
  return /^#[0-9a-f]{6}/i.test(chosen) ? chosen.slice(0, 7) : colorOf(type || "event");
}

export function eventLabel(event: EcatEvent): string {
  return (event.type || event.text || event.id) + (event.unsure ? " ?" : "");
}

function eventRows(source: LaneSource, events: readonly EcatEvent[]): Row[] {
  const { document, scheme } = source;
  const types = new Map(scheme.event_types.map((type) => [type.name, type]));
  const where = places(document, events);
  const groups = new Map<string, Map<number, EcatEvent[]>>();
  for (const event of events) {
    if (!event.segments.length) continue;
    const { tier, depth } = where.get(event.id)!;
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
      rows.push(...eventLanes(source, tier, indent, depth, depths.get(depth)!, types));
  }
  return rows;
}

function eventLanes(
  source: LaneSource,
  tier: string,
  indent: number,
  depth: number,
  events: readonly EcatEvent[],
  types: ReadonlyMap<string, EventType>,
): Row[] {
  const hulls = events.map((event) => hull(event));
  const lane = spread(hulls);
  const bars: Bar[][] = [[]];
  events.forEach((event, i) => {
    const list = (bars[lane[i]!] ??= []);
    event.segments.forEach((segment, k) =>
      list.push({
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
      }),
    );
  });
  const name = tier || "events";
  return bars.map((list, i) => ({
    kind: "bars",
    key: `${source.document.name}/events/${tier}/${depth}/${i}`,
    label: i ? "" : depth ? "parts" : name,
    depth: indent + depth,
    height: HEIGHT.bars,
    layer: source.document.name,
    tier,
    proposals: source.proposals,
    editable: source.active && !source.proposals && depth === 0,
    bars: new Intervals(list),
  }));
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
        height: HEIGHT.bars,
        layer: document.name,
        tier: "",
        proposals: source.proposals,
        editable: false,
        bars: new Intervals(part),
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
    height: HEIGHT.object,
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
