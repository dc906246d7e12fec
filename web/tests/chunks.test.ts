import { describe, expect, it } from "vitest";
import { Chunks } from "../src/chunks";
import type { App } from "../src/state";
import type { ColumnTable } from "../src/types";

/** A server that answers when it is told to. */
class Slow {
  readonly asked: ((rows: number | null) => void)[] = [];
  loaded = 0;
  readonly chunks: Chunks;

  constructor() {
    const columns = (): Promise<ColumnTable> => new Promise((resolve, reject) => {
      this.asked.push((rows) => (rows === null ? reject(new Error("away")) : resolve(table(rows))));
    });
    this.chunks = new Chunks({ session: { id: "s", tables: ["poses"] }, api: { columns } } as unknown as App, "poses", [], () => this.loaded++);
  }

  async answer(nth: number, rows: number | null): Promise<void> {
    this.asked[nth]!(rows);
    await new Promise((resolve) => setTimeout(resolve));
  }

  get rows(): number | null {
    return this.chunks.at(0)?.table.rows ?? null;
  }
}

const table = (rows: number): ColumnTable => ({ rows, columns: new Map([["frame", { name: "frame", values: new Int32Array(rows), dictionary: null }]]) });

describe("rows of a table that is written anew", () => {
  it("are asked for once", async () => {
    const slow = new Slow();
    expect([slow.rows, slow.rows]).toEqual([null, null]);
    await slow.answer(0, 3);
    expect([slow.rows, slow.asked.length, slow.loaded]).toEqual([3, 1, 1]);
  });

  it("are those of before until the new ones have come", async () => {
    const slow = new Slow();
    expect(slow.rows).toBe(null);
    await slow.answer(0, 3);
    slow.chunks.renew();
    expect(slow.rows).toBe(3);
    await slow.answer(1, 5);
    expect(slow.rows).toBe(5);
  });

  it("are the last ones, whichever answer comes last", async () => {
    const slow = new Slow();
    expect(slow.rows).toBe(null);
    slow.chunks.renew();
    expect(slow.rows).toBe(null);
    await slow.answer(1, 5);
    await slow.answer(0, 3);
    expect(slow.rows).toBe(5);
  });

  it("are none where they cannot be had", async () => {
    const slow = new Slow();
    expect(slow.rows).toBe(null);
    await slow.answer(0, 3);
    slow.chunks.renew();
    expect(slow.rows).toBe(3);
    await slow.answer(1, null);
    expect([slow.rows, slow.asked.length]).toEqual([null, 2]);
  });
});
