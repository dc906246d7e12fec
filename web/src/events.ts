// What the page tells its widgets: the values of the state, and the events by which they hear of changes.

import type { Document } from "./document";
import type { Order } from "./proposals";
import type { Change, Person, Proxy, SessionInfo } from "./types";

export type Tool = "select" | "rectangle" | "polygon" | "point";
export type SaveState = "saved" | "saving" | "offline";
export type ElementKind = "object" | "event" | "relation";

export interface Selected {
  kind: ElementKind;
  id: string;
  layer: string;
  /** Which segment of an event. */
  segment?: number;
}

export interface Cursor {
  frame: number;
  playing: boolean;
  speed: number;
  /** Frames [start, end) that playback repeats. */
  loop: [number, number] | null;
}

/** A label whose key has been pressed while playing and that is not closed yet. */
export interface Running {
  /** Empty for a whole whose parts are labelled before it. */
  type: string;
  tier: string;
  start: number;
  /** Its event, which grows, once it is written. */
  id?: string;
}

export interface Settings {
  theme: "system" | "light" | "dark";
  author: string;
  tool: Tool;
  /** Whether proposals of the machine layer are drawn (hollow). */
  proposals: boolean;
  /** In which order the machine's proposals are listed, and gone through. */
  order: Order;
  /** The tier and type that a new event takes. */
  /** The name that the server suggested when `author` was chosen. */
  suggested: string;
  lastType: string;
  lastTier: string;
  plots: string[];
  /** How much of skeletons is drawn. */
  body: "whole" | "upper";
  /** Whether the faces of markers are drawn. */
  marks: boolean;
  panes: Record<string, number>;
}

export interface LayerState {
  name: string;
  document: Document;
  revision: number;
  canUndo: boolean;
  canRedo: boolean;
  /** False: it does not exist on disk until the first edit. */
  exists: boolean;
  /** Somebody else has made it since. */
  elsewhere?: boolean;
}

/** `changes` is null when the whole layer is new. */
export interface LayerEvent {
  layer: string;
  changes: Change[] | null;
}

export interface Notice {
  kind: "info" | "error";
  text: string;
  detail?: string;
}

export interface AppEvents {
  /** Frame, playing, speed or loop changed. `byPlayer`: the player itself moved on, the video need not be sought. */
  cursor: Cursor & { byPlayer: boolean };
  /** An element of a shown layer changed. */
  layer: LayerEvent;
  /** Which layers are shown, and which one is edited. */
  layers: null;
  selection: Selected[];
  session: SessionInfo | null;
  settings: Settings;
  people: Person[];
  save: SaveState;
  running: Running[];
  /** The marks I and O. */
  marks: Marks;
  proxy: { stream: string; proxy: Proxy };
  /** Tables that are other ones now; null: perhaps all of them. */
  tables: string[] | null;
  /** The event whose type is a guess, or that it is none any more. */
  guessed: string | null;
  notice: Notice;
}

export interface Marks {
  start: number | null;
  end: number | null;
}

type Listener<K extends keyof AppEvents> = (value: AppEvents[K]) => void;

export class Emitter {
  private readonly listeners = new Map<keyof AppEvents, Set<Listener<never>>>();

  /** Calls `listener` at every event of that name; the function returned ends that. */
  on<K extends keyof AppEvents>(name: K, listener: Listener<K>): () => void {
    const set = this.listeners.get(name) ?? new Set();
    this.listeners.set(name, set);
    set.add(listener as Listener<never>);
    return () => set.delete(listener as Listener<never>);
  }

  protected emit<K extends keyof AppEvents>(name: K, value: AppEvents[K]): void {
    for (const listener of [...(this.listeners.get(name) ?? [])]) (listener as Listener<K>)(value);
  }
}
