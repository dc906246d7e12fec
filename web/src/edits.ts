// Edits on their way: sent one after the other, each once, however the connection fares; shown when they are recorded.

import { type Api, ApiError } from "./api";
import { type Conflict, decideConflict } from "./conflict";
import type { Document } from "./document";
import type { LayerState } from "./events";
import type { EditAnswer, LayerAnswer, Operation, RecordJson } from "./types";

/** Operations, or what makes them once everything asked before has been done; null or none: nothing is to be done. */
export type Wish = Operation | Operation[] | ((document: Document) => Operation[] | null | Promise<Operation[] | null>);

export interface EditsHost {
  readonly api: Api;
  /** The author's name; asked for if nobody knows it. */
  author(): Promise<string>;
  askConflict: (conflict: Conflict) => Promise<boolean>;
  /** Takes over a layer that was just made. */
  put(layer: LayerState, answer: LayerAnswer): void;
  receive(layer: string, record: RecordJson): void;
  fail(error: unknown): void;
}

export class Edits {
  pending = 0;
  connected = true;
  private queue: Promise<unknown> = Promise.resolve();

  constructor(private readonly host: EditsHost, private readonly changed: () => void) {}

  setConnected(connected: boolean): void {
    this.connected = connected;
    this.changed();
  }

  /** Sends operations as one step of undo; null if there turned out to be none. */
  async edit(sid: string, layer: LayerState, wish: Wish): Promise<RecordJson | null> {
    return this.enqueue(layer, async () => {
      const operations = typeof wish === "function" ? await wish(layer.document) : Array.isArray(wish) ? wish : [wish];
      if (operations === null || operations.length === 0) return null;
      const author = await this.host.author();
      if (!layer.exists) this.host.put(layer, await this.host.api.createLayer(sid, layer.name, author));
      return this.send(sid, layer, author, operations);
    });
  }

  /** Undo, redo or restore. */
  async step(layer: LayerState, task: (author: string) => Promise<EditAnswer>): Promise<RecordJson> {
    return (await this.enqueue(layer, async () => task(await this.host.author()))) as RecordJson;
  }

  private enqueue(layer: LayerState, task: () => Promise<EditAnswer | null>): Promise<RecordJson | null> {
    this.pending++;
    this.changed();
    const run = this.queue.then(async () => {
      try {
        const answer = await task();
        if (answer === null) return null;
        layer.canUndo = answer.can_undo;
        layer.canRedo = answer.can_redo;
        this.host.receive(layer.name, answer.record);
        return answer.record;
      } catch (error) {
        this.host.fail(error);
        throw error;
      } finally {
        this.pending--;
        this.changed();
      }
    });
    this.queue = run.catch(() => undefined);
    return run;
  }

  private async send(sid: string, layer: LayerState, author: string, operations: Operation[]): Promise<EditAnswer> {
    let answerLost = false;
    let base = layer.revision;
    for (let attempt = 0; ; attempt++) {
      // Where an answer was lost, the edit may have been made: only an unchanged base tells.
      if (!answerLost) base = layer.revision;
      try {
        const answer = await this.host.api.operations(sid, layer.name, { base, author, operations });
        this.setConnected(true);
        return answer;
      } catch (error) {
        if (!(error instanceof ApiError)) throw error;
        this.setConnected(!error.offline);
        if (error.offline) {
          answerLost = true;
          await new Promise((resolve) => setTimeout(resolve, Math.min(5000, 250 * 2 ** attempt)));
        } else if (error.status === 409 && error.records.length > 0) {
          const conflict = decideConflict(operations, author, error.records, layer.document, answerLost);
          for (const record of error.records) this.host.receive(layer.name, record);
          answerLost = false;
          if (conflict.alreadyDone !== null) return { record: conflict.alreadyDone, can_undo: true, can_redo: false };
          if (conflict.touched.length > 0 && !(await this.host.askConflict(conflict))) {
            throw new Error("Your change was left out; what the other person wrote is shown.");
          }
        } else throw error;
      }
    }
  }
}
