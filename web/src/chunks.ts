// Per-frame tables, fetched in stretches around the cursor: an hour of skeletons is not held in the page.

import type { App } from "./state";
import { lowerBound } from "./timeline/intervals";
import type { ColumnTable } from "./types";

const CHUNK_FRAMES = 600;
const MOST_KEPT = 6;

/** Rows `[from, to)` of a fetched stretch: those of one frame. */
export interface FrameRows {
  readonly table: ColumnTable;
  readonly from: number;
  readonly to: number;
}

interface Stretch {
  /** What was fetched last; null while nothing has come. */
  table: ColumnTable | null;
  /** As of which turn it was asked for. */
  turn: number;
}

export class Chunks {
  private readonly kept = new Map<number, Stretch>();
  private turn = 0;

  /** `columns` without `frame`, by which the table has to be sorted. */
  constructor(
    private readonly app: App,
    private readonly table: string,
    private readonly columns: readonly string[],
    private readonly onLoaded: () => void,
  ) {}

  get there(): boolean {
    return this.app.session?.tables.includes(this.table) ?? false;
  }

  /** The rows of a frame; null while they are on their way. */
  at(frame: number): FrameRows | null {
    const table = this.chunk(Math.floor(frame / CHUNK_FRAMES));
    if (!table) return null;
    const frames = table.columns.get("frame")!.values;
    return { table, from: lowerBound(frames, frame), to: lowerBound(frames, frame + 1) };
  }

  /** The stretch that holds a frame, and the frames it spans. */
  around(frame: number): { table: ColumnTable; start: number; end: number } | null {
    const index = Math.floor(frame / CHUNK_FRAMES);
    const table = this.chunk(index);
    return table ? { table, start: index * CHUNK_FRAMES, end: (index + 1) * CHUNK_FRAMES } : null;
  }

  private chunk(index: number): ColumnTable | null {
    const { session } = this.app;
    if (session === null || !this.there) return null;
    const found = this.kept.get(index) ?? { table: null, turn: -1 };
    // the one used last goes last
    this.kept.delete(index);
    this.kept.set(index, found);
    if (this.kept.size > MOST_KEPT) this.kept.delete(this.kept.keys().next().value!);
    if (found.turn !== this.turn) this.fetch(session.id, index, found);
    return found.table;
  }

  private fetch(sid: string, index: number, found: Stretch): void {
    const turn = (found.turn = this.turn);
    const filter = { start_frame: index * CHUNK_FRAMES, end_frame: (index + 1) * CHUNK_FRAMES };
    this.app.api.columns(sid, this.table, ["frame", ...this.columns], filter).catch(
      () => null, // what is not there is not drawn; asking again at every frame would not bring it
    ).then((table) => {
      // asked again meanwhile: this is what was there before
      if (found.turn !== turn) return;
      found.table = table;
      this.onLoaded();
    });
  }

  /** Another table is there: what was fetched is shown until the new one has come. */
  renew(): void {
    this.turn++;
  }

  /** Forgets everything: another session is opened. */
  clear(): void {
    this.kept.clear();
  }
}

/** The text of a dictionary-encoded value; "" for null. */
export function textAt(table: ColumnTable, column: string, row: number): string {
  const found = table.columns.get(column);
  return found?.dictionary?.[found.values[row]!] ?? "";
}

export function numberAt(table: ColumnTable, column: string, row: number): number {
  return table.columns.get(column)?.values[row] ?? Number.NaN;
}
