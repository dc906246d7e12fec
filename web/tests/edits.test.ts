import { describe, expect, it } from "vitest";
import { Document } from "../src/document";
import { ApiError } from "../src/api";
import { Edits, type EditsHost } from "../src/edits";
import type { LayerState } from "../src/events";
import { convexOutline } from "../src/space/solid";
import type { Operation } from "../src/types";

/** A server that counts; whether it answers is up to the test. */
class Counting {
  value = 0;
  away = false;
  sent: Operation[][] = [];
  readonly told: string[] = [];
  readonly layer: LayerState = {
    name: "main", document: new Document({ name: "main", events: [{ id: "a1", segments: [{ start_frame: 0, end_frame: 10, start_ns: null, end_ns: null }] }] }),
    revision: 0, canUndo: false, canRedo: false, exists: true,
  };
  readonly edits = new Edits({
    api: { operations: (_: string, __: string, body: { operations: Operation[] }) => this.answer(body.operations) },
    author: () => Promise.resolve("ann"),
    askConflict: () => Promise.resolve(false),
    put: () => undefined,
    receive: (_: string, record: { changes: never[] }) => {
      this.layer.revision++;
      this.layer.document.apply(record.changes);
    },
    fail: (error: unknown) => this.told.push(String(error)),
  } as unknown as EditsHost, () => undefined);

  private answer(operations: Operation[]): Promise<unknown> {
    if (this.away) return Promise.reject(new ApiError(0, { what: "away" }));
    this.sent.push(operations);
    const event = this.layer.document.event("a1")!;
    const before = { id: "a1", segments: event.segments };
    const after = { id: "a1", segments: [{ ...event.segments[0]!, end_frame: Number(operations[0]!.frame) }] };
    const change = { kind: "event", id: "a1", index: -1, before, after };
    return Promise.resolve({ record: { revision: this.layer.revision + 1, author: "ann", time: "", operation: operations, changes: [change] }, can_undo: true, can_redo: false });
  }
}

const longer = (document: Document): Operation[] => [{ op: "move_edge", frame: document.event("a1")!.segments[0]!.end_frame + 1 }];

describe("edits on their way", () => {
  it("are worked out when those before them are done", async () => {
    const server = new Counting();
    await Promise.all([1, 2, 3].map(() => server.edits.edit("s", server.layer, longer)));
    expect(server.sent.map(([o]) => o?.frame)).toEqual([11, 12, 13]);
  });

  it("wait for the server, and are then what they were meant to be", async () => {
    const server = new Counting();
    server.away = true;
    const both = [server.edits.edit("s", server.layer, longer), server.edits.edit("s", server.layer, longer)];
    await new Promise((resolve) => setTimeout(resolve, 50));
    expect(server.edits.connected).toBe(false);
    server.away = false;
    await Promise.all(both);
    expect(server.layer.document.event("a1")?.segments[0]?.end_frame).toBe(12);
    expect(server.edits.pending).toBe(0);
  });

  it("are none where nothing is to be done, and one that fails stops no other", async () => {
    const server = new Counting();
    expect(await server.edits.edit("s", server.layer, () => null)).toBeNull();
    const failing = server.edits.edit("s", server.layer, () => { throw new Error("no"); });
    const next = server.edits.edit("s", server.layer, longer);
    await expect(failing).rejects.toThrow("no");
    expect((await next)?.revision).toBe(1);
    expect(server.told).toEqual(["Error: no"]);
  });
});

describe("the outline of a convex body", () => {
  it("has the corners that are seen, in order", () => {
    const square = [{ x: 0, y: 0 }, { x: 2, y: 0 }, { x: 2, y: 2 }, { x: 0, y: 2 }];
    const inner = [{ x: 1, y: 1 }, { x: 1, y: 0 }, { x: 0.5, y: 1.5 }];
    const outline = convexOutline([inner[0]!, square[2]!, inner[1]!, square[0]!, square[3]!, inner[2]!, square[1]!]);
    expect(outline).toHaveLength(4);
    expect(new Set(outline)).toEqual(new Set(square));
    const area = outline.reduce((sum, p, i) => sum + p.x * outline[(i + 1) % 4]!.y - p.y * outline[(i + 1) % 4]!.x, 0) / 2;
    expect(Math.abs(area)).toBe(4);
  });

  it("of fewer than three points is these", () => {
    expect(convexOutline([{ x: 1, y: 2 }])).toEqual([{ x: 1, y: 2 }]);
  });
});
