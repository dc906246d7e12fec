import { describe, expect, it } from "vitest";
import { Document, schemeFromJson } from "../src/document";
import { guessRoles, partsStart, press, pressAll } from "../src/labelling";
import type { Running } from "../src/state";
import type { EventType } from "../src/types";

const scheme = schemeFromJson({
  name: "test",
  tiers: [{ name: "event", parent: null, constraint: "none" }, { name: "sub-event", parent: "event", constraint: "included_in" }],
  event_types: [
    { name: "slide", tier: "event", roles: [{ name: "Agent" }, { name: "Theme", required: true }] },
    { name: "grasp", tier: "sub-event" }, { name: "move", tier: "sub-event" },
  ] as unknown as EventType[],
});
const [slide, grasp, move] = scheme.event_types as [EventType, EventType, EventType];

describe("labelling while playing", () => {
  it("starts with a key and ends with the same key", () => {
    const first = press([], grasp, 10, scheme);
    expect(first).toEqual({ running: [{ type: "grasp", tier: "sub-event", start: 10 }], closed: [] });
    const second = press(first.running, grasp, 30, scheme);
    expect(second.running).toEqual([]);
    expect(second.closed).toEqual([{ label: first.running[0], end: 30 }]);
  });

  it("ends a label when the next one of its tier begins, and leaves the tier above running", () => {
    const running = press(press([], slide, 0, scheme).running, grasp, 5, scheme).running;
    const next = press(running, move, 20, scheme);
    expect(next.closed).toEqual([{ label: { type: "grasp", tier: "sub-event", start: 5 }, end: 20 }]);
    expect(next.running.map((r) => r.type)).toEqual(["slide", "move"]);
  });

  it("ends an event together with its running sub-event, the event first", () => {
    const running = press(press([], slide, 0, scheme).running, grasp, 5, scheme).running;
    expect(press(running, slide, 40, scheme).closed.map((c) => c.label.type)).toEqual(["slide", "grasp"]);
  });

  it("writes nothing for a label without length", () => {
    const running: Running[] = [{ type: "grasp", tier: "sub-event", start: 7 }];
    expect(pressAll(running, 7, scheme)).toEqual({ running: [], closed: [] });
  });

  it("puts an event around parts that were labelled before it, as far as they follow one another", () => {
    const part = (id: string, start: number, end: number) => ({ id, tier: "sub-event", segments: [{ start_frame: start, end_frame: end, start_ns: null, end_ns: null }] });
    const document = new Document({ name: "main", events: [part("a1", 0, 4), part("a2", 10, 20), part("a3", 20, 30)] });
    expect(partsStart(document, [{ type: "move", tier: "sub-event", start: 30 }], slide, scheme)).toBe(10);
    expect(partsStart(document, [], slide, scheme)).toBeNull();
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
