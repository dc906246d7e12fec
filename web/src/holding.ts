// Which relations hold when: a positive fact ends those that conflict with it, a negative one ends its counterpart;
// a fact holds while all its objects are there.  The same rules as ecat.model.holding.

import type { AnnotatedObject, Relation, Scheme } from "./types";

/** Half-open stretches; Infinity: to the end. */
export type Stretches = [number, number][];

export function presence(object: AnnotatedObject | undefined): Stretches {
  if (object === undefined || object.key_frames.length === 0) return [[-1, Infinity]];
  const found: Stretches = [];
  let start: number | null = null;
  for (const key of object.key_frames) {
    if (key.present && start === null) start = key.frame;
    else if (!key.present && start !== null) {
      found.push([start, key.frame]);
      start = null;
    }
  }
  if (start !== null) found.push([start, Infinity]);
  return found;
}

const targets = (relation: Relation): string => relation.arguments.map((a) => a.target).join("\0");

function conflicts(scheme: Scheme, first: Relation, second: Relation): boolean {
  return scheme.constraints.some((c) => {
    const names = c.predicates.split(",").map((n) => n.trim());
    if (c.kind === "UNIQUE") {
      const k = c.unique_argument - 1;
      if (first.predicate !== names[0] || second.predicate !== names[0] || first.arguments.length !== second.arguments.length) return false;
      if (k < 0 || k >= first.arguments.length) return false;
      return first.arguments.every((a, i) => (a.target === second.arguments[i]?.target) === (i !== k));
    }
    return names.includes(first.predicate) && names.includes(second.predicate) && first.predicate !== second.predicate
      && first.arguments.length === 1 && second.arguments.length === 1 && targets(first) === targets(second);
  });
}

function common(first: Stretches, second: Stretches): Stretches {
  return first.flatMap(([a, b]) => second.map(([c, d]): [number, number] => [Math.max(a, c), Math.min(b, d)])).filter(([s, e]) => s < e);
}

/** When each positive relation holds, by its id. */
export function intervals(relations: Relation[], scheme: Scheme, find: (id: string) => AnnotatedObject | undefined): Map<string, Stretches> {
  const ends = new Map<Relation, number>();
  // Only facts with a common predicate or constraint can end one another; within such a group there are few.
  const held = new Map<string, Relation[]>();
  const group = (name: string): string => scheme.constraints.find((c) => c.predicates.split(",").map((n) => n.trim()).includes(name))?.predicates ?? name;
  for (const relation of [...relations].sort((a, b) => a.start_frame - b.start_frame)) {
    const key = group(relation.predicate);
    let open = held.get(key) ?? [];
    if (relation.end_frame === null) {
      open = open.filter((old) => {
        const same = old.predicate === relation.predicate && targets(old) === targets(relation);
        if (!same && !(relation.polarity && conflicts(scheme, old, relation))) return true;
        ends.set(old, relation.start_frame);
        return false;
      });
    }
    if (relation.polarity) {
      ends.set(relation, relation.end_frame ?? Infinity);
      if (relation.end_frame === null) open.push(relation);
    }
    held.set(key, open);
  }
  const found = new Map<string, Stretches>();
  for (const [relation, end] of ends) {
    let stretches: Stretches = relation.start_frame < end ? [[relation.start_frame, end]] : [];
    if (relation.end_frame === null && relation.predicate !== "IDENTITY") {
      for (const a of relation.arguments) stretches = common(stretches, presence(find(a.target)));
    }
    found.set(relation.id, stretches);
  }
  return found;
}

export function holdsAt(stretches: Stretches | undefined, frame: number): boolean {
  return stretches?.some(([s, e]) => s <= frame && frame < e) ?? false;
}
