// What the page knows and does: the open session and its layers, which are changed by what the server recorded only.
// Widgets listen to its events and call its methods; they never talk to each other.

import { Api, ApiError } from "./api";
import type { Conflict } from "./conflict";
import { Document, schemeFromJson, span } from "./document";
import { Edits, type Wish } from "./edits";
import type { ElementKind, LayerState, SaveState } from "./events";
import { Line } from "./live";
import type { AnnotatedObject, EcatEvent, LayerAnswer, LayerJson, LiveMessage, Person, Project, RecordJson, Relation, Scheme, SessionInfo } from "./types";
import { View } from "./view";

export const MACHINE = "machine";

export class App extends View {
  readonly api = new Api();
  project: Project | null = null;
  session: SessionInfo | null = null;
  scheme: Scheme = schemeFromJson(null);
  /** Seconds since the session's start of each frame of the annotated video; null without a clock. */
  times: Float64Array | null = null;
  /** The layers that are loaded, which are those shown; the machine's is loaded whenever there is one. */
  readonly layers = new Map<string, LayerState>();
  shown: string[] = [];
  activeLayer = "main";
  people: Person[] = [];
  save: SaveState = "saved";
  /** The event whose type was guessed when it was made, until somebody does something else. */
  guessed: string | null = null;
  /** Asks the person what to do about an edit that somebody else's made doubtful. Set by the shell. */
  askConflict: (conflict: Conflict) => Promise<boolean> = () => Promise.resolve(false);
  /** Asks a yes-or-no question. Set by the shell. */
  confirm: (title: string, text: string, yes: string) => Promise<boolean> = () => Promise.resolve(false);
  /** Asks for the annotator's name. Set by the shell. */
  askAuthor: () => Promise<string | null> = () => Promise.resolve(null);

  private readonly edits = new Edits(this, () => this.updateSave());
  private readonly line = new Line(
    this.api.live, (message) => this.onLive(message), (connected) => this.edits.setConnected(connected),
    () => ({ name: this.settings.author, layer: this.activeLayer, frame: this.cursor.frame, selection: this.primary?.id ?? null }),
  );
  private me = "";
  /** Where the choice of a layer is remembered. */
  private layerKey = "";
  private opening = 0;
  private turns: Promise<void> = Promise.resolve();
  private readonly early = new Map<string, RecordJson[]>();

  // --- the session

  get nFrames(): number {
    return this.session?.n_frames ?? 0;
  }

  secondsOf(frame: number): number | null {
    const times = this.times;
    if (times === null || times.length === 0) return null;
    return times[Math.max(0, Math.min(frame, times.length - 1))] ?? null;
  }

  /** Opens a session; false if another one was opened meanwhile. `quietly`: only to look at, unseen by the others. */
  async openSession(sid: string, quietly = false): Promise<boolean> {
    this.closeSession();
    const turn = ++this.opening;
    const project = this.project = await this.api.project();
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
    const wanted = names.includes(MACHINE) ? [this.activeLayer, MACHINE] : [this.activeLayer];
    await Promise.all(wanted.map((name) => this.load(name)));
    if (turn !== this.opening) return false;
    this.shown = wanted;
    if (!quietly) this.line.connect(sid);
    this.emit("session", this.session);
    this.emit("layers", null);
    return true;
  }

  closeSession(): void {
    this.opening++;
    this.turns = Promise.resolve();
    this.line.close();
    this.layers.clear();
    this.early.clear();
    this.shown = [];
    this.people = [];
    this.times = null;
    this.guessed = null;
    this.me = "";
    this.forgetPlace();
    if (this.session !== null) {
      this.session = null;
      this.emit("session", null);
    }
  }

  /** Fetches the session's description again: streams, layers, tables, scheme. */
  refreshSession(): Promise<void> {
    return this.inTurn(async (opening) => {
      if (this.session === null) return;
      const session = await this.api.session(this.session.id, this.layers.get(this.activeLayer)?.exists ? this.activeLayer : "");
      if (opening !== this.opening) return;
      this.session = session;
      this.scheme = schemeFromJson(session.scheme);
      this.emit("session", session);
    });
  }

  /** What is fetched again is asked for one after the other, so that the last answer is what there is; none is, once another session is open. */
  private inTurn(task: (opening: number) => Promise<void>): Promise<void> {
    const { opening } = this;
    const run = this.turns.then(() => (opening === this.opening ? task(opening) : undefined));
    this.turns = run.catch(() => undefined);
    return run;
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

  /** The machine's proposals that nobody has decided about in the edited layer; sub-events come with their events. */
  openProposals(): { events: EcatEvent[]; relations: Relation[] } {
    const machine = this.machine;
    if (machine === null) return { events: [], relations: [] };
    return {
      events: machine.events.list.filter((e) => e.parent === null && this.decided(e.id) === null),
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
    this.moved();
    await this.refreshSession();
  }

  async setShown(names: string[]): Promise<void> {
    for (const name of names) if (!this.layers.has(name)) await this.load(name);
    this.shown = names.includes(this.activeLayer) ? names : [this.activeLayer, ...names];
    this.emit("layers", null);
  }

  private async load(name: string): Promise<void> {
    const { session, opening } = this;
    if (session === null) throw new Error("No session is open.");
    const layer = emptyLayer(name);
    try {
      // One that nobody has made yet is made by the first edit.
      const known = session.layers.some((l) => l.name === name) || this.layers.get(name)?.elsewhere === true;
      if (known) this.put(layer, await this.api.layer(session.id, name, this.settings.author));
    } catch (error) {
      if (!(error instanceof ApiError) || error.status !== 404) throw error;
    }
    // Another session may be open by now, or records may have been told that this answer does not know of.
    if (opening === this.opening && layer.revision >= (this.layers.get(name)?.revision ?? 0)) this.layers.set(name, layer);
  }

  put(layer: LayerState, answer: LayerAnswer): void {
    layer.document = new Document(answer.layer);
    layer.revision = answer.revision;
    layer.canUndo = answer.can_undo;
    layer.canRedo = answer.can_redo;
    layer.exists = true;
  }

  private reload(name: string): void {
    this.inTurn(() => this.load(name)).then(() => {
      this.pruneSelection();
      this.emit("layer", { layer: name, changes: null });
    }).catch((error: unknown) => this.fail(error));
  }

  // --- edits

  /**
   * Sends operations as one step of undo and applies what the server recorded.
   * Rejects with an ApiError when it was refused; the person has then been told already.
   */
  edit(wish: Wish): Promise<RecordJson | null> {
    return this.inLayer((sid, layer) => this.edits.edit(sid, layer, wish));
  }

  undo(): Promise<RecordJson> {
    return this.inLayer((sid, layer) => this.edits.step(layer, (author) => this.api.undo(sid, layer.name, author)));
  }

  redo(): Promise<RecordJson> {
    return this.inLayer((sid, layer) => this.edits.step(layer, (author) => this.api.redo(sid, layer.name, author)));
  }

  restore(revision: number): Promise<RecordJson> {
    return this.inLayer((sid, layer) => this.edits.step(layer, (author) => this.api.restore(sid, layer.name, author, revision)));
  }

  private inLayer<T>(task: (sid: string, layer: LayerState) => Promise<T>): Promise<T> {
    const layer = this.layers.get(this.activeLayer);
    if (this.session === null || layer === undefined) return Promise.reject(new Error("no session is open"));
    return task(this.session.id, layer);
  }

  async author(): Promise<string> {
    if (this.settings.author === "") {
      const given = await this.askAuthor();
      if (given === null || given.trim() === "") throw new Error("An edit needs the name of its author.");
      this.set({ author: given.trim() });
    }
    return this.settings.author;
  }

  /** Applies a record in the order of revisions, once, whichever way it came. */
  receive(name: string, record: RecordJson): void {
    const layer = this.layers.get(name);
    if (layer === undefined || record.revision <= layer.revision) return;
    if (!layer.exists) {
      // Somebody else made it.
      layer.elsewhere = true;
      this.reload(name);
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
    if (this.early.delete(name)) this.reload(name);
  }

  // --- what the server tells

  onLive(message: LiveMessage): void {
    const layer = "layer" in message ? this.layers.get(message.layer) : undefined;
    if (message.type === "record") {
      // What this page did itself it knows from the answer, which also says what can be undone now.
      const news = layer !== undefined && message.record.revision > layer.revision;
      this.receive(message.layer, message.record);
      if (news && message.record.author === this.settings.author && this.edits.pending === 0) layer.canUndo = true;
      if (news && isReplacement(message.record)) this.notify(`Another program replaced the layer ${message.layer}.`, "What it wrote is shown; Ctrl+Z does not take it back, the history does.");
    } else if (message.type === "hello") this.onHello(message);
    else if (message.type === "presence") {
      this.people = message.people.filter((p) => p.id !== this.me);
      this.emit("people", this.people);
    } else if (message.type === "replaced") {
      if (layer !== undefined) this.reload(message.layer);
      this.refreshSession().catch((error: unknown) => this.fail(error));
    } else if (message.type === "tables") {
      this.refreshSession().then(() => this.emitTables(message.tables)).catch((error: unknown) => this.fail(error));
    } else if (message.type === "problem") {
      this.fail(new ApiError(500, { what: `The layer ${message.layer} could not be written as XML and tables.`, where: message.what, consequence: "Every edit is in the journal; it is tried again." }));
    } else if (message.type === "proxy") {
      const stream = this.session?.streams.find((s) => s.name === message.stream);
      if (stream === undefined) return;
      stream.proxy = { state: message.state, progress: message.progress, url: message.url, fps: message.fps };
      this.emit("proxy", { stream: stream.name, proxy: stream.proxy });
    }
  }

  /** The connection is there, perhaps again: what was missed while it was down is fetched. */
  private onHello(message: LiveMessage & { type: "hello" }): void {
    const again = this.me !== "";
    this.me = message.id;
    for (const [name, revision] of Object.entries(message.revisions)) {
      const layer = this.layers.get(name);
      if (layer === undefined) continue;
      if (!layer.exists) layer.elsewhere = true;
      // a layer without a history does not tell by its revision whether it is another one
      if (layer.revision < revision || (again && revision === 0 && layer.exists)) this.reload(name);
    }
    if (again || message.tables_sha256 !== this.session?.tables_sha256) this.refreshSession().then(() => this.emitTables()).catch(() => undefined);
  }

  private updateSave(): void {
    const next: SaveState = !this.edits.connected ? "offline" : this.edits.pending > 0 ? "saving" : "saved";
    if (next === this.save) return;
    this.save = next;
    this.emit("save", next);
  }

  protected moved(): void {
    this.line.moved();
  }

  /** Tells the widgets that tables are other ones now. */
  emitTables(tables: string[] | null = null): void {
    this.emit("tables", tables);
  }

  // --- the selection

  /** Says which event has a type that nobody chose, until somebody does something else. */
  guess(id: string | null): void {
    if (id === this.guessed) return;
    this.guessed = id;
    this.emit("guessed", id);
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
}

function isReplacement({ operation }: RecordJson): boolean {
  return !Array.isArray(operation) && operation.op === "replace";
}

function emptyLayer(name: string): LayerState {
  const layer: LayerJson = { name };
  return { name, document: new Document(layer), revision: 0, canUndo: false, canRedo: false, exists: false };
}

export { span };
export { SPEEDS } from "./view";
export type * from "./events";
