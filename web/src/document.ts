// A layer as the page holds it: looked up by id, changed only by the changes that the server recorded.

import type { AnnotatedObject, Change, Decision, EcatEvent, KeyFrame, LayerJson, Relation, Scheme } from "./types";

type Json = Record<string, unknown>;

function keyFrame(json: Json): KeyFrame {
  return { frame: 0, t_ns: null, present: true, coordinates: [], ...json } as KeyFrame;
}

function segments(json: Json): EcatEvent["segments"] {
  const list = (json.segments ?? []) as Json[];
  return list.map((s) => ({ start_frame: 0, end_frame: 0, start_ns: null, end_ns: null, ...s })) as EcatEvent["segments"];
}

export function objectFromJson(json: Json): AnnotatedObject {
  return {
    id: "", name: "", kind: "other", origin: "manual", dimensions: 2, semantic_type: "", stream: "",
    color: "#ff0000ff", line_width: 1, interpolation: "linear", properties: [],
    ...json,
    key_frames: ((json.key_frames ?? []) as Json[]).map(keyFrame),
    key_frames_3d: ((json.key_frames_3d ?? []) as Json[]).map(keyFrame),
  } as AnnotatedObject;
}

export function eventFromJson(json: Json): EcatEvent {
  return {
    id: "", type: "", tier: "", parent: null, status: "confirmed", unsure: false, author: "", text: "",
    links: [], references: [], predicates: [], properties: [],
    ...json,
    segments: segments(json),
    roles: ((json.roles ?? []) as Json[]).map((r) => ({ kind: "object", name: "", target: "", ...r })),
  } as EcatEvent;
}

export function relationFromJson(json: Json): Relation {
  return {
    id: "", predicate: "", start_frame: 0, end_frame: null, start_ns: null, end_ns: null, polarity: true,
    source: "marked", status: "confirmed", author: "", arguments: [], ...json,
  } as Relation;
}

function decisionFromJson(json: Json): Decision {
  return { proposal: "", verdict: "accepted", result: "", author: "", ...json } as Decision;
}

export function schemeFromJson(json: Partial<Scheme> | null | undefined): Scheme {
  const given = json ?? {};
  return {
    name: "", version: "1", closed: false, constraints: [], ...given,
    tiers: (given.tiers ?? []).map((t) => ({ ...{ parent: null, constraint: "none" as const }, ...t })),
    event_types: (given.event_types ?? []).map((t) => ({
      ...{ tier: "", voxml: "", key: "", color: "" }, ...t,
      roles: (t.roles ?? []).map((r) => ({ ...{ kind: "object" as const, required: false }, ...r })),
    })),
    predicates: (given.predicates ?? []).map((p) => ({ ...{ arity: 2, target: "object" as const }, ...p })),
  };
}

/** Elements in the order of the layer, found by id in constant time. */
export class Elements<T> {
  readonly list: T[] = [];
  private readonly byId = new Map<string, T>();

  constructor(items: T[], private readonly idOf: (item: T) => string) {
    for (const item of items) {
      this.list.push(item);
      this.byId.set(idOf(item), item);
    }
  }

  get(id: string): T | undefined {
    return this.byId.get(id);
  }

  put(id: string, index: number, item: T | null): void {
    const old = this.byId.get(id);
    if (old !== undefined) {
      const at = this.list[index] === old ? index : this.list.indexOf(old);
      if (item === null) {
        this.list.splice(at, 1);
        this.byId.delete(id);
      } else {
        this.list[at] = item;
        this.byId.delete(id);
        this.byId.set(this.idOf(item), item);
      }
    } else if (item !== null) {
      this.list.splice(Math.max(0, Math.min(index, this.list.length)), 0, item);
      this.byId.set(this.idOf(item), item);
    }
  }
}

export class Document {
  readonly objects: Elements<AnnotatedObject>;
  readonly events: Elements<EcatEvent>;
  readonly relations: Elements<Relation>;
  readonly decisions: Elements<Decision>;
  readonly name: string;
  scheme: string;
  private readonly childIds = new Map<string, Set<string>>();

  constructor(layer: LayerJson) {
    this.name = layer.name;
    this.scheme = layer.scheme ?? "";
    this.objects = new Elements((layer.objects ?? []).map((o) => objectFromJson(o as Json)), (o) => o.id);
    this.events = new Elements((layer.events ?? []).map((e) => eventFromJson(e as Json)), (e) => e.id);
    this.relations = new Elements((layer.relations ?? []).map((r) => relationFromJson(r as Json)), (r) => r.id);
    this.decisions = new Elements((layer.decisions ?? []).map((d) => decisionFromJson(d as Json)), (d) => d.proposal);
    for (const event of this.events.list) this.adopt(event);
  }

  object(id: string): AnnotatedObject | undefined {
    return this.objects.get(id);
  }

  event(id: string): EcatEvent | undefined {
    return this.events.get(id);
  }

  relation(id: string): Relation | undefined {
    return this.relations.get(id);
  }

  /** The sub-events of an event, by start. */
  children(id: string): EcatEvent[] {
    const ids = this.childIds.get(id);
    if (ids === undefined) return [];
    return [...ids].map((child) => this.events.get(child)).filter((e) => e !== undefined).sort((a, b) => span(a)[0] - span(b)[0]);
  }

  /** How deep an event lies below its ancestors: 0 without a parent. */
  depth(event: EcatEvent): number {
    let depth = 0;
    for (let at = event.parent; at !== null && depth < 64; depth++) at = this.events.get(at)?.parent ?? null;
    return depth;
  }

  apply(changes: Change[]): void {
    for (const change of changes) {
      if (change.kind === "object") this.applyObject(change);
      else if (change.kind === "event") this.applyEvent(change);
      else if (change.kind === "relation") {
        this.relations.put(change.id, change.index, change.after && relationFromJson(change.after));
      } else if (change.kind === "decision") {
        this.decisions.put(change.id, change.index, change.after && decisionFromJson(change.after));
      } else if (change.kind === "layer") {
        if (change.after !== null) this.scheme = (change.after.scheme as string | undefined) ?? "";
      } else this.applyKeyFrame(change);
    }
  }

  private applyObject(change: Change): void {
    const old = this.objects.get(change.id);
    if (change.after === null) return this.objects.put(change.id, change.index, null);
    const next = objectFromJson(change.after);
    if (old !== undefined) {
      // A change of an object that stays says nothing about its key frames.
      next.key_frames = old.key_frames;
      next.key_frames_3d = old.key_frames_3d;
    }
    return this.objects.put(change.id, change.index, next);
  }

  private applyEvent(change: Change): void {
    const old = this.events.get(change.id);
    if (old?.parent) this.childIds.get(old.parent)?.delete(old.id);
    const next = change.after && eventFromJson(change.after);
    this.events.put(change.id, change.index, next);
    if (next !== null) this.adopt(next);
  }

  private applyKeyFrame(change: Change): void {
    const cut = change.id.lastIndexOf("@");
    const old = this.objects.get(change.id.slice(0, cut));
    if (old === undefined) return;
    const frame = Number(change.id.slice(cut + 1));
    const list = change.kind === "key_frame" ? "key_frames" : "key_frames_3d";
    const keys = old[list].filter((k) => k.frame !== frame);
    if (change.after !== null) keys.splice(Math.max(0, Math.min(change.index, keys.length)), 0, keyFrame({ frame, ...change.after }));
    this.objects.put(old.id, change.index, { ...old, [list]: keys });
  }

  private adopt(event: EcatEvent): void {
    if (event.parent === null) return;
    const siblings = this.childIds.get(event.parent);
    if (siblings) siblings.add(event.id);
    else this.childIds.set(event.parent, new Set([event.id]));
  }
}

/** The hull of an event's segments, [start, end). */
export function span(event: EcatEvent): [number, number] {
  let start = Infinity;
  let end = -Infinity;
  for (const s of event.segments) {
    start = Math.min(start, s.start_frame);
    end = Math.max(end, s.end_frame);
  }
  return [start, end];
}
