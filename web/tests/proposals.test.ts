import { describe, expect, it } from "vitest";
import { Document, relationFromJson, schemeFromJson } from "../src/document";
import { confidence, inOrder, neighbour, openWhole, origin, tally } from "../src/proposals";
import { LaneCache, lanes, ROW_PX } from "../src/timeline/lanes";

type Json = Record<string, unknown>;

function event(id: string, start: number, sure: string | null, more: Json = {}): Json {
  return {
    id, type: "push", tier: "whole", status: "proposed", author: "model", segments: [{ start_frame: start, end_frame: start + 10 }],
    properties: sure === null ? [] : [{ name: "confidence", value: sure }], ...more,
  };
}

const machine = new Document({
  name: "machine",
  events: [
    event("a1", 30, "0.50"), event("a2", 10, "0.90", { author: "rules 4" }), event("a3", 20, null), event("a4", 0, "0.50"),
    event("a5", 12, "0.90", { author: "rules 4", parent: "a2", tier: "part" }),
  ],
});

describe("a proposal", () => {
  it("says how sure the machine was, and who it is from", () => {
    expect(machine.events.list.map(confidence)).toEqual([0.5, 0.9, null, 0.5, 0.9]);
    expect(origin(machine.event("a2")!)).toBe("confidence 0.90 · rules 4");
    expect(origin(machine.event("a3")!)).toBe("model");
  });

  it("is as sure as nobody said where its confidence is no number", () => {
    expect(["", "high", "Infinity"].map((said) => confidence(new Document({ name: "m", events: [event("a1", 0, said)] }).event("a1")!))).toEqual([null, null, null]);
    expect(confidence(relationFromJson({ id: "r1", predicate: "ON" }))).toBeNull();
  });
});

describe("proposals", () => {
  it("are listed in time or by confidence, equal ones in time, those without any last", () => {
    const ids = (order: "time" | "surest" | "doubtful"): string => inOrder(machine.events.list, order).map((e) => e.id).join(" ");
    expect(ids("time")).toBe("a4 a2 a5 a3 a1");
    expect(ids("surest")).toBe("a2 a5 a4 a1 a3");
    expect(ids("doubtful")).toBe("a4 a1 a2 a5 a3");
  });

  it("are counted in words", () => {
    const some = machine.events.list;
    expect(tally({ events: some, relations: [] })).toBe("5 events");
    expect(tally({ events: some.slice(0, 1), relations: [relationFromJson({ id: "r1" }), relationFromJson({ id: "r2" })] })).toBe("1 event and 2 relations");
    expect(tally({ events: [], relations: [] })).toBe("");
  });
});

describe("a proposed part", () => {
  const [event, relation] = ["event", "relation"] as const;
  const deciding = (decisions: Record<string, "accepted" | "rejected">): Parameters<typeof neighbour>[0] => {
    const decided = (id: string) => decisions[id] ?? null;
    const events = machine.events.list.filter((e) => e.parent === null && decided(e.id) === null);
    return { machine, decided, openProposals: () => ({ events, relations: [relationFromJson({ id: "r1" })] }), settings: { order: "time" } as never };
  };

  it("comes with its whole until that is accepted", () => {
    expect(openWhole(deciding({}), "a5")?.id).toBe("a2");
    expect(openWhole(deciding({ a2: "accepted" }), "a5")).toBeNull();
    expect(["a2", "r1"].map((id) => openWhole(deciding({}), id))).toEqual([null, null]);
  });

  it("leads to its whole, which is to be decided about; then to the next in order, as any other does", () => {
    const next = (kind: "event" | "relation", id: string, decisions: Parameters<typeof deciding>[0] = {}) => neighbour(deciding(decisions), { kind, id, layer: "machine" });
    expect(next(event, "a5")).toEqual({ kind: "event", id: "a2", layer: "machine" });
    expect(next(event, "a5", { a2: "accepted" })?.id).toBe("a3");
    expect(["a4", "a2", "a3", "a1"].map((id) => next(event, id)?.id)).toEqual(["a2", "a3", "a1", "a3"]);
    expect(next(relation, "r1")).toBeNull();
  });
});

describe("the lanes of proposals", () => {
  const scheme = schemeFromJson({ tiers: [{ name: "whole", parent: null, constraint: "none" }, { name: "part", parent: "whole", constraint: "none" }] });
  const rows = lanes({
    document: machine, scheme, nFrames: 100, active: false, proposals: true, decided: new Set(["machine/a1"]), collapsed: new Set(), cache: new LaneCache(),
  }).events;

  it("count what is decided about: open ones, each with its parts", () => {
    expect(rows[0]).toMatchObject({ kind: "group", label: "Proposed", count: 3 });
  });

  it("are apart for everybody who proposes, under their name", () => {
    const found = rows.flatMap((row) => (row.kind === "bars" ? [[row.label, row.depth, row.bars.items.map((bar) => bar.id).join(" ")]] : []));
    expect(found).toEqual([["model", 0, "a4 a3"], ["rules 4", 0, "a2"], ["part", 1, "a5"]]);
    expect(new Set(rows.map((row) => row.key)).size).toBe(rows.length);
  });

  it("are as high as any other, so that whole ones are in view", () => {
    expect(new Set(rows.map((row) => row.height))).toEqual(new Set([ROW_PX]));
  });
});
