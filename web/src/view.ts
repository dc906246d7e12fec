// Where somebody is and what they have chosen: cursor, marks, selection, settings; and what they are told.

import { ApiError } from "./api";
import { type Cursor, Emitter, type Marks, type Notice, type Running, type Selected, type Settings } from "./events";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 1.5, 2, 4];

const SETTINGS_KEY = "ecat.settings";
const DEFAULT_SETTINGS: Settings = {
  theme: "system", author: "", suggested: "", tool: "select", proposals: true, order: "time", lastType: "", lastTier: "", plots: [], panes: {},
  body: "whole", marks: true,
};
const MOST_MESSAGES = 200;

export abstract class View extends Emitter {
  cursor: Cursor = { frame: 0, playing: false, speed: 1, loop: null };
  selection: Selected[] = [];
  marks: Marks = { start: null, end: null };
  running: Running[] = [];
  settings: Settings = { ...DEFAULT_SETTINGS };
  /** Everything that was said, the oldest first. */
  readonly messages: (Notice & { at: Date })[] = [];

  constructor() {
    super();
    try {
      this.settings = { ...DEFAULT_SETTINGS, ...(JSON.parse(localStorage.getItem(SETTINGS_KEY) ?? "{}") as Partial<Settings>) };
    } catch {
      // Settings that cannot be read are forgotten.
    }
    this.settings.tool = "select";
  }

  abstract get nFrames(): number;

  /** Called when the others may want to know where somebody is. */
  protected abstract moved(): void;

  // --- messages

  notify(text: string, detail?: string): void {
    this.say({ kind: "info", text, detail });
  }

  fail(error: unknown): void {
    if (error instanceof ApiError) {
      const { where, consequence, fix } = error.error;
      this.say({ kind: "error", text: error.error.what, detail: [where, consequence, fix].filter(Boolean).join("\n") });
    } else if (error instanceof Error) this.say({ kind: "error", text: error.message });
  }

  private say(notice: Notice): void {
    this.messages.push({ ...notice, at: new Date() });
    if (this.messages.length > MOST_MESSAGES) this.messages.shift();
    this.emit("notice", notice);
  }

  // --- cursor, marks, selection, settings

  seek(frame: number, byPlayer = false): void {
    const next = Math.max(0, Math.min(Math.round(frame), Math.max(0, this.nFrames - 1)));
    if (next === this.cursor.frame) return;
    this.cursor.frame = next;
    this.emit("cursor", { ...this.cursor, byPlayer });
    this.moved();
  }

  setPlaying(playing: boolean): void {
    if (playing === this.cursor.playing) return;
    this.cursor.playing = playing;
    this.emit("cursor", { ...this.cursor, byPlayer: false });
  }

  setSpeed(speed: number): void {
    this.cursor.speed = Math.max(0.1, Math.min(4, speed));
    this.emit("cursor", { ...this.cursor, byPlayer: false });
  }

  setLoop(loop: [number, number] | null): void {
    this.cursor.loop = loop;
    this.emit("cursor", { ...this.cursor, byPlayer: false });
  }

  setMarks(marks: Partial<Marks>): void {
    this.marks = { ...this.marks, ...marks };
    this.emit("marks", this.marks);
  }

  setRunning(running: Running[]): void {
    this.running = running;
    this.emit("running", running);
  }

  select(selection: Selected[]): void {
    this.selection = selection;
    this.emit("selection", selection);
    this.moved();
  }

  /** The element selected last. */
  get primary(): Selected | null {
    return this.selection.at(-1) ?? null;
  }

  set(change: Partial<Settings>): void {
    this.settings = { ...this.settings, ...change };
    localStorage.setItem(SETTINGS_KEY, JSON.stringify(this.settings));
    this.emit("settings", this.settings);
    if (change.author !== undefined) this.moved();
  }

  protected forgetPlace(): void {
    this.cursor = { frame: 0, playing: false, speed: 1, loop: null };
    this.selection = [];
    this.marks = { start: null, end: null };
    this.running = [];
  }
}
