import { describe, expect, it } from "vitest";
import { Document, schemeFromJson } from "../src/document";
import { guessRoles, press, pressAll } from "../src/labelling";
import type { Running } from "../src/state";
import type { EventType } from "../src/types";

const scheme = schemeFromJson({
  name: "test",
  tiers: [{ name: "event", parent: null, constraint: "none" }, { name: "sub-event", parent: "event", constraint: "included_in" }],
  event_types: [
    { name: "slide", tier: "event", roles: [{ name: "Agent" }, { name: "Theme", required: true }] },
    { name: "grasp", tier: "sub-event" }, { name: "move", tier: "sub-event" }, { name: "look", tier: "" },
  ] as unknown as EventType[],
});
const [slide, grasp, move, look] = scheme.event_types as [EventType, EventType, EventType, EventType];
const event = (id: string, start: number, end: number, more: object = {}) =>
  ({ id, tier: "event", segments: [{ start_frame: start, end_frame: end, start_ns: null, end_ns: null }], ...more });
const context = (...events: object[]) => ({ document: new Document({ name: "main", events }), scheme, object: null });
const running = (type: string, tier: string, start: number, id?: string): Running => ({ type, tier, start, ...(id === undefined ? {} : { id }) });
const brief = (operations: { op: string; type?: unknown; segments?: unknown; frame?: unknown }[]) => operations.map((o) => [o.op, o.type ?? o.frame, o.segments]);

describe("labelling while playing", () => {
  it("starts with a key and ends with the same key", () => {
    const first = press([], look, 10, context());
    expect(first.running).toEqual([running("look", "", 10)]);
    expect(first.operations).toEqual([]);
    const second = press(first.running, look, 30, context());
    expect(second.running).toEqual([]);
    expect(brief(second.operations)).toEqual([["add_event", "look", [[10, 30]]]]);
  });

  it("writes a running whole with its first part, and lets it grow with the next", () => {
    const labels = press(press([], slide, 0, context()).running, grasp, 5, context()).running;
    const next = press(labels, move, 20, context());
    expect(brief(next.operations)).toEqual([["add_event", "slide", [[0, 20]]], ["add_event", "grasp", [[5, 20]]]]);
    expect(next.written?.type).toBe("slide");
    if (next.written) next.written.id = "a1";
    const last = press(next.running, slide, 40, context(event("a1", 0, 20, { type: "slide" })));
    expect(brief(last.operations)).toEqual([["move_edge", 40, undefined], ["add_event", "move", [[20, 40]]]]);
    expect(last.running).toEqual([]);
  });

  it("gives parts that come first a whole without a name, which gets its name last", () => {
    const first = press([running("grasp", "sub-event", 10)], move, 20, context());
    expect(brief(first.operations)).toEqual([["add_event", "", [[10, 20]]], ["add_event", "grasp", [[10, 20]]]]);
    if (first.written) first.written.id = "a1";
    const last = press(first.running, slide, 30, context(event("a1", 10, 20)));
    expect(brief(last.operations)).toEqual([["move_edge", 30, undefined], ["add_event", "move", [[20, 30]]], ["edit_event", "slide", undefined]]);
  });

  it("begins another whole where parts do not follow one another", () => {
    const labels = [running("", "event", 10, "a1")];
    const later = press(labels, grasp, 50, context(event("a1", 10, 20)));
    expect(later.running).toEqual([running("grasp", "sub-event", 50)]);
  });

  it("needs no whole of its own inside an event that is there", () => {
    const ended = press([running("grasp", "sub-event", 10)], grasp, 20, context(event("a7", 0, 90)));
    expect(ended.operations).toMatchObject([{ op: "add_event", type: "grasp", parent: "a7" }]);
  });

  it("writes nothing for a label without length", () => {
    expect(pressAll([running("grasp", "sub-event", 7)], 7, context())).toMatchObject({ operations: [], running: [] });
  });
});

describe("roles that nobody needs to be asked for", () => {
  const document = new Document({ name: "main", objects: [{ id: "o1", kind: "rig" }, { id: "o2", kind: "rectangle" }] });
  it("takes the selected object as what is acted upon, and the only person as who acts", () => {
    expect(guessRoles(slide, null, "o2", document)).toEqual({ Theme: { target: "o2", kind: "object" }, Agent: { target: "o1", kind: "object" } });
  });
  it("never fills two roles with one object", () => {
    expect(guessRoles(slide, null, "o1", document)).toEqual({ Agent: { target: "o1", kind: "object" } });
  });
});
