import { describe, expect, it } from "vitest";
import { decideConflict, namedIds } from "../src/conflict";
import { Document } from "../src/document";
import { holdsAt, intervals } from "../src/holding";
import { pieces } from "../src/inspector/text";
import { keyName } from "../src/keyboard";
import type { Change, RecordJson, Relation } from "../src/types";

const change = (kind: Change["kind"], id: string, before: object | null, after: object | null, index = -1): Change =>
  ({ kind, id, index, before: before as Change["before"], after: after as Change["after"] });

describe("a layer that follows its records", () => {
  it("takes elements in and out at their places", () => {
    const document = new Document({ name: "main", events: [{ id: "a1" }, { id: "a3" }] });
    document.apply([change("event", "a2", null, { id: "a2", parent: "a1" }, 1)]);
    expect(document.events.list.map((e) => e.id)).toEqual(["a1", "a2", "a3"]);
    expect(document.children("a1").map((e) => e.id)).toEqual(["a2"]);
    document.apply([change("event", "a2", { id: "a2" }, { id: "a2", parent: "a3" })]);
    expect(document.children("a1")).toEqual([]);
    document.apply([change("event", "a2", { id: "a2" }, null, 1)]);
    expect(document.children("a3")).toEqual([]);
    expect(document.events.list.length).toBe(2);
  });

  it("keeps the key frames of an object whose name changes", () => {
    const document = new Document({ name: "main", objects: [{ id: "o1", key_frames: [{ frame: 3, t_ns: null, present: true, coordinates: [1, 2] }] }] });
    document.apply([change("object", "o1", { id: "o1" }, { id: "o1", name: "cup" }), change("key_frame", "o1@1", null, { frame: 1, coordinates: [0, 0] }, 0)]);
    expect(document.object("o1")?.name).toBe("cup");
    expect(document.object("o1")?.key_frames.map((k) => k.frame)).toEqual([1, 3]);
  });
});

describe("an edit that was based on an older revision", () => {
  const record = (changes: Change[], operation: RecordJson["operation"] = { op: "edit_event", id: "a1" }, author = "bob"): RecordJson =>
    ({ revision: 4, author, time: "", operation, changes });
  const document = new Document({ name: "main", events: [{ id: "a1" }, { id: "a2", parent: "a1" }] });

  it("is sent again without a question when others touched other things", () => {
    const conflict = decideConflict([{ op: "edit_event", id: "a9", text: "x" }], "ann", [record([change("event", "a1", {}, {})])], document, false);
    expect(conflict.touched).toEqual([]);
  });
  it("asks when the same event, or the one that it is a part of, was changed", () => {
    const conflict = decideConflict([{ op: "move_edge", id: "a2" }], "ann", [record([change("event", "a1", {}, {})])], document, false);
    expect(conflict.touched.length).toBe(1);
  });
  it("knows its own record when only the answer was lost", () => {
    const operation = { op: "edit_event", id: "a1", text: "x" };
    expect(decideConflict([operation], "ann", [record([], operation, "ann")], document, true).alreadyDone?.revision).toBe(4);
  });
  it("finds the ids that roles name", () => {
    expect(namedIds([{ op: "add_event", roles: { Theme: "o2", Agent: "o1/HandRight" } }])).toEqual(new Set(["o2", "o1", "o1/HandRight"]));
  });
});

describe("small things", () => {
  it("cuts a text at its references by characters, not by UTF-16 units", () => {
    expect(pieces("🙂 the cup", [{ start: 6, end: 9, target: "o1" }]).map((p) => p.text)).toEqual(["🙂 the ", "cup"]);
  });
  it("names keys by what they produce", () => {
    const key = (k: string, more: object = {}) => keyName({ key: k, ctrlKey: false, metaKey: false, altKey: false, shiftKey: false, ...more });
    expect([key("Z", { ctrlKey: true, shiftKey: true }), key("{", { shiftKey: true }), key("ArrowLeft", { shiftKey: true }), key("?", { shiftKey: true })])
      .toEqual(["ctrl+shift+z", "{", "shift+arrowleft", "?"]);
  });
  it("lets a later fact end the one that it contradicts", () => {
    const relation = (id: string, start: number, more: Partial<Relation> = {}): Relation => ({
      id, predicate: "ON", start_frame: start, end_frame: null, start_ns: null, end_ns: null, polarity: true, source: "marked", status: "confirmed", author: "",
      arguments: [{ target: "o1" }, { target: "o2" }], ...more,
    });
    const held = intervals([relation("r1", 5), relation("r2", 20, { polarity: false })], { name: "", version: "1", closed: false, tiers: [], event_types: [], predicates: [], constraints: [] }, () => undefined);
    expect([holdsAt(held.get("r1"), 4), holdsAt(held.get("r1"), 5), holdsAt(held.get("r1"), 19), holdsAt(held.get("r1"), 20)]).toEqual([false, true, true, false]);
  });
});
