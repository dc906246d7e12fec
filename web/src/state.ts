// What the page knows and does: the open session, its layers, the cursor, the selection, the settings.
// Widgets listen to its events and call its methods; they never talk to each other.

import { Api, ApiError, liveMessage } from "./api";
import { type Conflict, decideConflict } from "./conflict";
import { Document, schemeFromJson, span } from "./document";
import { type Cursor, type ElementKind, Emitter, type LayerState, type Marks, type Running, type SaveState, type Selected, type Settings } from "./events";
import type {
  AnnotatedObject, EcatEvent, EditAnswer, LayerAnswer, LayerJson, Operation, Person, RecordJson, Relation, Scheme, SessionInfo,
} from "./types";

export const MACHINE = "machine";
export const SPEEDS = [0.1, 0.25, 0.5, 1, 1.5, 2, 4];

const SETTINGS_KEY = "ecat.settings";
const DEFAULT_SETTINGS: Settings = {
  theme: "system", author: "", suggested: "", tool: "select", proposals: true, lastType: "", lastTier: "", plots: [], panes: {},
};

export class App extends Emitter {
  readonly api = new Api();
  session: SessionInfo | null = null;
  scheme: Scheme = schemeFromJson(null);
  /** Seconds since the session's start of each frame of the annotated video; null without a clock. */
  times: Float64Array | null = null;
  /** The layers that are loaded, which are those shown; the machine's is loaded whenever there is one. */
  readonly layers = new Map<string, LayerState>();
  shown: string[] = [];
  activeLayer = "main";
  cursor: Cursor = { frame: 0, playing: false, speed: 1, loop: null };
  selection: Selected[] = [];
  marks: Marks = { start: null, end: null };
  running: Running[] = [];
  people: Person[] = [];
  settings: Settings = { ...DEFAULT_SETTINGS };
  save: SaveState = "saved";
  /** Asks the person what to do about an edit that somebody else's made doubtful. Set by the shell. */
  askConflict: (conflict: Conflict) => Promise<boolean> = () => Promise.resolve(false);
  /** Asks a yes-or-no question. Set by the shell. */
  confirm: (title: string, text: string, yes: string) => Promise<boolean> = () => Promise.resolve(false);
  /** Asks for the annotator's name. Set by the shell. */
  askAuthor: () => Promise<string | null> = () => Promise.resolve(null);

  private socket: WebSocket | null = null;
  private me = "";
  /** Where the choice of a layer is remembered. */
  private layerKey = "";
  private opening = 0;
  private queue: Promise<unknown> = Promise.resolve();
  private pending = 0;
  private connected = true;
  private presenceTimer = 0;
  private reconnectTimer = 0;
  private readonly early = new Map<string, RecordJson[]>();

  constructor() {
    super();
    try {
      this.settings = { ...DEFAULT_SETTINGS, ...(JSON.parse(localStorage.getItem(SETTINGS_KEY) ?? "{}") as Partial<Settings>) };
    } catch {
      // Settings that cannot be read are forgotten.
    }
    this.settings.tool = "select";
  }

  // --- messages

  notify(text: string, detail?: string): void {
    this.emit("notice", { kind: "info", text, detail });
  }

  fail(error: unknown): void {
    if (error instanceof ApiError) {
      const { where, consequence, fix } = error.error;
      this.emit("notice", { kind: "error", text: error.error.what, detail: [where, consequence, fix].filter(Boolean).join(" ") });
    } else if (error instanceof Error) this.emit("notice", { kind: "error", text: error.message });
  }

  // --- the session

  get nFrames(): number {
    return this.session?.n_frames ?? 0;
  }

  secondsOf(frame: number): number | null {
    const times = this.times;
    if (times === null || times.length === 0) return null;
    return times[Math.max(0, Math.min(frame, times.length - 1))] ?? null;
  }

  /** Opens a session; false if another one was opened meanwhile. */
  async openSession(sid: string): Promise<boolean> {
    this.closeSession();
    const turn = ++this.opening;
    const project = await this.api.project();
    const first = project.layer || "main";
    // What was chosen here holds as long as the server begins with the same layer, and suggests the same name.
    this.layerKey = `ecat.layer.${first}.${sid}`;
    const last = localStorage.getItem(this.layerKey);
    const wished = last !== null && last !== MACHINE ? last : first;
    const session = await this.api.session(sid, wished);
    const times = session.video === null ? null : await this.api.times(sid, session.video).catch(() => null);
    if (turn !== this.opening) return false;
    if (project.author !== this.settings.suggested) this.set({ author: project.author || this.settings.author, suggested: project.author });
    const names = session.layers.map((l) => l.name);
    const own = names.filter((n) => n !== MACHINE);
    this.activeLayer = own.length === 0 || own.includes(wished) || last !== null || wished !== "main" ? wished : (own[0] as string);
    this.session = session;
    this.scheme = schemeFromJson(session.scheme);
    this.times = times;
    this.cursor = { frame: 0, playing: false, speed: 1, loop: null };
    const wanted = names.includes(MACHINE) ? [this.activeLayer, MACHINE] : [this.activeLayer];
    await Promise.all(wanted.map((name) => this.load(name)));
    if (turn !== this.opening) return false;
    this.shown = wanted;
    this.connect(sid);
    this.emit("session", this.session);
    this.emit("layers", null);
    return true;
  }

  closeSession(): void {
    this.opening++;
    const socket = this.socket;
    this.socket = null;
    socket?.close();
    clearTimeout(this.reconnectTimer);
    this.layers.clear();
    this.early.clear();
    this.shown = [];
    this.selection = [];
    this.marks = { start: null, end: null };
    this.running = [];
    this.people = [];
    this.times = null;
    if (this.session !== null) {
      this.session = null;
      this.emit("session", null);
    }
  }

  /** Fetches the session's description again: streams, layers, scheme. */
  async refreshSession(): Promise<void> {
    if (this.session === null) return;
    this.session = await this.api.session(this.session.id, this.layers.get(this.activeLayer)?.exists ? this.activeLayer : "");
    this.scheme = schemeFromJson(this.session.scheme);
    this.emit("session", this.session);
  }

  // --- layers

  get active(): LayerState {
    return this.layers.get(this.activeLayer) ?? emptyLayer(this.activeLayer);
  }

  get document(): Document {
    return this.active.document;
  }

  get machine(): Document | null {
    return this.layers.get(MACHINE)?.document ?? null;
  }

  /** The documents to draw: the edited one first, then the others, without the machine's proposals when those are hidden. */
  get shownLayers(): LayerState[] {
    const names = [this.activeLayer, ...this.shown.filter((n) => n !== this.activeLayer)];
    return names
      .filter((n) => n !== MACHINE || this.settings.proposals)
      .map((n) => this.layers.get(n))
      .filter((l) => l !== undefined);
  }

  /** The machine's proposals that nobody has decided about in the edited layer. */
  openProposals(): { events: EcatEvent[]; relations: Relation[] } {
    const machine = this.machine;
    if (machine === null) return { events: [], relations: [] };
    return {
      events: machine.events.list.filter((e) => this.decided(e.id) === null),
      relations: machine.relations.list.filter((r) => this.decided(r.id) === null),
    };
  }

  /** The verdict of the edited layer on a proposal of the machine's; null if there is none. */
  decided(id: string): "accepted" | "rejected" | null {
    return this.document.decisions.get(`${MACHINE}/${id}`)?.verdict ?? null;
  }

  /** Edits the layer `name` from now on; `remember`: also when the session is opened again. */
  async setActiveLayer(name: string, remember = true): Promise<void> {
    if (this.session === null || name === MACHINE) return;
    if (!this.layers.has(name)) await this.load(name);
    this.activeLayer = name;
    if (remember) localStorage.setItem(this.layerKey, name);
    if (!this.shown.includes(name)) this.shown = [name, ...this.shown];
    this.select([]);
    this.emit("layers", null);
    this.presence();
    await this.refreshSession();
  }

  async setShown(names: string[]): Promise<void> {
    for (const name of names) if (!this.layers.has(name)) await this.load(name);
    this.shown = names.includes(this.activeLayer) ? names : [this.activeLayer, ...names];
    this.emit("layers", null);
  }

  private async load(name: string): Promise<void> {
    const session = this.session;
    if (session === null) throw new Error("No session is open.");
    const layer = emptyLayer(name);
    try {
      // One that nobody has made yet is made by the first edit.
      const known = session.layers.some((l) => l.name === name) || this.layers.get(name)?.elsewhere === true;
      if (known) this.put(layer, await this.api.layer(session.id, name, this.settings.author));
      this.layers.set(name, layer);
    } catch (error) {
      if (!(error instanceof ApiError) || error.status !== 404) throw error;
      this.layers.set(name, layer);
    }
  }

  private put(layer: LayerState, answer: LayerAnswer): void {
    layer.document = new Document(answer.layer);
    layer.revision = answer.revision;
    layer.canUndo = answer.can_undo;
    layer.canRedo = answer.can_redo;
    layer.exists = true;
  }

  private async reload(name: string): Promise<void> {
    await this.load(name);
    this.emit("layer", { layer: name, changes: null });
  }

  // --- edits

  /**
   * Sends operations as one step of undo and applies what the server recorded.
   * Rejects with an ApiError when it was refused; the person has then been told already.
   */
  edit(operations: Operation | Operation[]): Promise<RecordJson> {
    const list = Array.isArray(operations) ? operations : [operations];
    return this.enqueue(async (sid, layer) => {
      const author = await this.author();
      if (!layer.exists) {
        this.put(layer, await this.api.createLayer(sid, layer.name, author));
      }
      return this.send(sid, layer, author, list);
    });
  }

  undo(): Promise<RecordJson> {
    return this.enqueue(async (sid, layer) => this.api.undo(sid, layer.name, await this.author()));
  }

  redo(): Promise<RecordJson> {
    return this.enqueue(async (sid, layer) => this.api.redo(sid, layer.name, await this.author()));
  }

  restore(revision: number): Promise<RecordJson> {
    return this.enqueue(async (sid, layer) => this.api.restore(sid, layer.name, await this.author(), revision));
  }

  private enqueue(task: (sid: string, layer: LayerState) => Promise<EditAnswer>): Promise<RecordJson> {
    const session = this.session;
    const layer = this.layers.get(this.activeLayer);
    if (session === null || layer === undefined) return Promise.reject(new Error("no session is open"));
    this.pending++;
    this.updateSave();
    const run = this.queue.then(async () => {
      try {
        const answer = await task(session.id, layer);
        layer.canUndo = answer.can_undo;
        layer.canRedo = answer.can_redo;
        this.receive(layer.name, answer.record);
        return answer.record;
      } catch (error) {
        this.fail(error);
        throw error;
      } finally {
        this.pending--;
        this.updateSave();
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
        const answer = await this.api.operations(sid, layer.name, { base, author, operations });
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
          for (const record of error.records) this.receive(layer.name, record);
          answerLost = false;
          if (conflict.alreadyDone !== null) return { record: conflict.alreadyDone, can_undo: true, can_redo: false };
          if (conflict.touched.length > 0 && !(await this.askConflict(conflict))) {
            throw new Error("Your change was left out; what the other person wrote is shown.");
          }
        } else throw error;
      }
    }
  }

  private async author(): Promise<string> {
    if (this.settings.author === "") {
      const given = await this.askAuthor();
      if (given === null || given.trim() === "") throw new Error("An edit needs the name of its author.");
      this.set({ author: given.trim() });
    }
    return this.settings.author;
  }

  /** Applies a record in the order of revisions, once, whichever way it came. */
  private receive(name: string, record: RecordJson): void {
    const layer = this.layers.get(name);
    if (layer === undefined || record.revision <= layer.revision) return;
    if (!layer.exists) {
      // Somebody else made it.
      layer.elsewhere = true;
      this.reload(name).catch((error: unknown) => this.fail(error));
      return;
    }
    if (record.revision > layer.revision + 1) {
      const early = this.early.get(name) ?? [];
      this.early.set(name, [...early, record]);
      setTimeout(() => this.fillGap(name), 500);
      return;
    }
    layer.document.apply(record.changes);
    layer.revision = record.revision;
    layer.exists = true;
    this.pruneSelection();
    this.emit("layer", { layer: name, changes: record.changes });
    if (name === this.activeLayer && record.changes.some((c) => c.kind === "layer" && c.before?.scheme !== c.after?.scheme)) {
      this.refreshSession().catch((error: unknown) => this.fail(error));
    }
    const early = this.early.get(name);
    if (early !== undefined) {
      this.early.delete(name);
      for (const next of early.sort((a, b) => a.revision - b.revision)) this.receive(name, next);
    }
  }

  private fillGap(name: string): void {
    if (!this.early.has(name)) return;
    this.early.delete(name);
    this.reload(name).catch((error: unknown) => this.fail(error));
  }

  // --- connection

  private connect(sid: string): void {
    const socket = this.api.live(sid);
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.setConnected(true);
      this.presence();
    });
    socket.addEventListener("message", (message) => this.onLive(message.data));
    socket.addEventListener("close", () => {
      if (this.socket !== socket) return;
      this.setConnected(false);
      this.reconnectTimer = window.setTimeout(() => this.connect(sid), 1000);
    });
  }

  private onLive(data: unknown): void {
    const message = liveMessage(data);
    if (message === null) return;
    if (message.type === "record") {
      const layer = this.layers.get(message.layer);
      // What this page did itself it knows from the answer, which also says what can be undone now.
      const news = layer !== undefined && message.record.revision > layer.revision;
      this.receive(message.layer, message.record);
      if (news && message.record.author === this.settings.author && this.pending === 0) layer.canUndo = true;
    } else if (message.type === "hello") {
      this.me = message.id;
      // What was missed while the connection was down.
      for (const [name, revision] of Object.entries(message.revisions)) {
        const layer = this.layers.get(name);
        if (layer !== undefined && layer.revision < revision && (layer.exists || (layer.elsewhere = true))) this.reload(name).catch((error: unknown) => this.fail(error));
      }
    } else if (message.type === "presence") {
      this.people = message.people.filter((p) => p.id !== this.me);
      this.emit("people", this.people);
    } else if (message.type === "proxy") {
      const stream = this.session?.streams.find((s) => s.name === message.stream);
      if (stream === undefined) return;
      stream.proxy = { state: message.state, progress: message.progress, url: message.url, fps: message.fps };
      this.emit("proxy", { stream: stream.name, proxy: stream.proxy });
    }
  }

  private setConnected(connected: boolean): void {
    this.connected = connected;
    this.updateSave();
  }

  private updateSave(): void {
    const next: SaveState = !this.connected ? "offline" : this.pending > 0 ? "saving" : "saved";
    if (next === this.save) return;
    this.save = next;
    this.emit("save", next);
  }

  private presence(): void {
    clearTimeout(this.presenceTimer);
    this.presenceTimer = window.setTimeout(() => {
      if (this.socket?.readyState !== WebSocket.OPEN) return;
      const selection = this.selection.at(-1)?.id ?? null;
      const { author: name } = this.settings;
      this.socket.send(JSON.stringify({ type: "presence", name, layer: this.activeLayer, frame: this.cursor.frame, selection }));
    }, 200);
  }

  // --- cursor, marks, selection, settings

  seek(frame: number, byPlayer = false): void {
    const next = Math.max(0, Math.min(Math.round(frame), Math.max(0, this.nFrames - 1)));
    if (next === this.cursor.frame) return;
    this.cursor.frame = next;
    this.emit("cursor", { ...this.cursor, byPlayer });
    this.presence();
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
    this.presence();
  }

  /** The element selected last. */
  get primary(): Selected | null {
    return this.selection.at(-1) ?? null;
  }

  get selectedObject(): AnnotatedObject | null {
    return this.lookup("object", (d, id) => d.object(id));
  }

  get selectedEvent(): EcatEvent | null {
    return this.lookup("event", (d, id) => d.event(id));
  }

  get selectedRelation(): Relation | null {
    return this.lookup("relation", (d, id) => d.relation(id));
  }

  private lookup<T>(kind: ElementKind, find: (document: Document, id: string) => T | undefined): T | null {
    const last = this.selection.findLast((s) => s.kind === kind);
    const document = last === undefined ? undefined : this.layers.get(last.layer)?.document;
    return last === undefined || document === undefined ? null : (find(document, last.id) ?? null);
  }

  private pruneSelection(): void {
    const kept = this.selection.filter((s) => {
      const document = this.layers.get(s.layer)?.document;
      return document !== undefined && document[`${s.kind}s`].get(s.id) !== undefined;
    });
    if (kept.length !== this.selection.length) this.select(kept);
  }

  set(change: Partial<Settings>): void {
    this.settings = { ...this.settings, ...change };
    localStorage.setItem(SETTINGS_KEY, JSON.stringify(this.settings));
    this.emit("settings", this.settings);
    if (change.author !== undefined) this.presence();
  }
}

function emptyLayer(name: string): LayerState {
  const layer: LayerJson = { name };
  return { name, document: new Document(layer), revision: 0, canUndo: false, canRedo: false, exists: false };
}

export { span };
export type * from "./events";
