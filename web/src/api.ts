// The server's HTTP and WebSocket interface.  Every failure is an ApiError that says what, where, consequence and fix.

import type {
  Agreement, Archived, ColumnTable, EditAnswer, ErrorJson, Job, LayerAnswer, LiveMessage, Neighbour, Operation, OtherObjects, Project,
  RecordJson, SeriesInfo, SessionInfo, Survey, SurveySummary, TableColumn,
} from "./types";

export class ApiError extends Error {
  constructor(readonly status: number, readonly error: ErrorJson, readonly records: RecordJson[] = [], readonly revision = -1) {
    super(error.what);
  }

  /** The server could not be reached, or answered with nothing of ours. */
  get offline(): boolean {
    return this.status === 0;
  }
}

const path = (...parts: string[]): string => `api/${parts.map(encodeURIComponent).join("/")}`;

async function request(url: string, init?: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(url, { credentials: "same-origin", ...init });
  } catch (cause) {
    if (cause instanceof DOMException && cause.name === "AbortError") throw cause;
    throw new ApiError(0, { what: "The server does not answer.", fix: "Is `ecat annotate` still running?" });
  }
  if (response.ok) return response;
  let body: { error?: ErrorJson; records?: RecordJson[]; revision?: number } = {};
  try {
    body = (await response.json()) as typeof body;
  } catch {
    // Not ours: a proxy's page, say.
  }
  const error = body.error ?? { what: `The server answered ${response.status} ${response.statusText}.` };
  throw new ApiError(response.status, error, body.records ?? [], body.revision ?? -1);
}

async function getJson<T>(url: string, signal?: AbortSignal): Promise<T> {
  return (await (await request(url, { signal })).json()) as T;
}

function postJson<T>(url: string, body: unknown): Promise<T> {
  return send("POST", url, body);
}

async function send<T>(method: string, url: string, body?: unknown): Promise<T> {
  const init = { method, headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  return (await (await request(url, init)).json()) as T;
}

export class Api {
  readonly project = () => getJson<Project>(path("project"));
  /** `layer`: whose coding scheme is meant. */
  readonly session = (sid: string, layer = "") =>
    getJson<SessionInfo>(`${path("sessions", sid)}${layer === "" ? "" : `?layer=${encodeURIComponent(layer)}`}`);
  /** `author`: whose undo and redo are asked about. */
  readonly layer = (sid: string, layer: string, author: string) =>
    getJson<LayerAnswer>(`${path("sessions", sid, "layers", layer)}${author === "" ? "" : `?author=${encodeURIComponent(author)}`}`);

  readonly createLayer = (sid: string, layer: string, author: string) =>
    postJson<LayerAnswer>(path("sessions", sid, "layers", layer), { author });

  readonly operations = (sid: string, layer: string, body: { base: number; author: string; operations: Operation[] }) =>
    postJson<EditAnswer>(path("sessions", sid, "layers", layer, "operations"), body);

  readonly undo = (sid: string, layer: string, author: string) =>
    postJson<EditAnswer>(path("sessions", sid, "layers", layer, "undo"), { author });

  readonly redo = (sid: string, layer: string, author: string) =>
    postJson<EditAnswer>(path("sessions", sid, "layers", layer, "redo"), { author });

  readonly restore = (sid: string, layer: string, author: string, revision: number) =>
    postJson<EditAnswer>(path("sessions", sid, "layers", layer, "restore"), { author, revision });

  readonly save = (sid: string, layer: string) => postJson<unknown>(path("sessions", sid, "layers", layer, "save"), {});

  readonly history = (sid: string, layer: string, start: number, limit: number) =>
    getJson<{ records: RecordJson[]; revision: number }>(
      `${path("sessions", sid, "layers", layer, "history")}?start=${start}&limit=${limit}`,
    );

  readonly at = (sid: string, layer: string, revision: number) =>
    getJson<LayerAnswer>(path("sessions", sid, "layers", layer, "at", String(revision)));

  readonly agreement = (sid: string, layers: string[]) =>
    getJson<Agreement>(`${path("sessions", sid, "agreement")}?layers=${layers.map(encodeURIComponent).join(",")}`);

  readonly surveys = () => getJson<SurveySummary[]>(path("surveys"));
  readonly survey = (name: string, rater: string) => getJson<Survey>(`${path("surveys", name)}?rater=${encodeURIComponent(rater)}`);
  readonly answerSurvey = (name: string, body: { item: string; rater: string; answer: string | number; comment: string }) =>
    postJson<unknown>(path("surveys", name), body);

  readonly series = (sid: string) => getJson<SeriesInfo[]>(path("sessions", sid, "series"));
  readonly seriesValues = (sid: string, name: string, signal?: AbortSignal) =>
    getTable(path("sessions", sid, "series", name), signal);

  readonly depthAt = (sid: string, stream: string, frame: number, u: number, v: number, signal?: AbortSignal) =>
    getJson<{ depth_m: number | null; x: number | null; y: number | null; z: number | null }>(
      `${path("sessions", sid, "depth", stream, String(frame))}?u=${u}&v=${v}`, signal,
    );

  /** Columns of a table as typed arrays; `filter` takes object_id, start_frame, end_frame. */
  readonly columns = (sid: string, table: string, columns: string[], filter: Record<string, string | number> = {}, signal?: AbortSignal) => {
    const query = new URLSearchParams({ columns: columns.join(",") });
    for (const [key, value] of Object.entries(filter)) query.set(key, String(value));
    return getTable(`${path("sessions", sid, "columns", table)}?${query}`, signal);
  };

  /** Seconds since the session's start, one per image of the stream. */
  readonly times = async (sid: string, stream: string): Promise<Float64Array> =>
    new Float64Array(await (await request(path("sessions", sid, "times", stream))).arrayBuffer());

  readonly mediaUrl = (sid: string, stream: string) => path("sessions", sid, "media", stream);
  readonly frameUrl = (sid: string, stream: string, frame: number) => path("sessions", sid, "frames", stream, `${frame}.jpg`);

  readonly depthRange = (sid: string, stream: string) =>
    getJson<{ near_m: number; far_m: number }>(path("sessions", sid, "depth", stream, "range"));

  // --- what goes on behind the page

  readonly process = (sid: string, stages: string[] | null) => postJson<Job>(path("sessions", sid, "process"), { stages });
  readonly addSkeletons = (sid: string, body: { layer: string; author: string; upload: string }) =>
    postJson<Job>(path("sessions", sid, "skeletons"), body);
  readonly addFiles = (sid: string, upload: string) => postJson<Job>(path("sessions", sid, "files"), { upload });
  readonly removeFile = (sid: string, stream: string) => postJson<unknown>(path("sessions", sid, "files", stream, "removal"), { name: stream });
  readonly job = (id: string) => getJson<Job>(path("jobs", id));
  readonly stopJob = (id: string) => send<Job>("DELETE", path("jobs", id));

  /** Sends files, each by its name or its path below the folder that was chosen; the upload's id. */
  readonly upload = async (files: File[], told: (done: number, total: number) => void): Promise<string> => {
    const { id } = await postJson<{ id: string }>(path("uploads"), {});
    const total = files.reduce((sum, f) => sum + f.size, 0);
    let done = 0;
    for (const file of files) {
      told(done, total);
      await request(path("uploads", id, ...(file.webkitRelativePath || file.name).split("/")), { method: "PUT", body: file });
      done += file.size;
    }
    return id;
  };

  // --- the project

  readonly makeProject = (name: string, inside: string) => postJson<{ path: string }>(path("project", "projects"), { name, inside });
  readonly importUpload = (body: { name: string; inside: string; upload: string }) => postJson<Job>(path("project", "imports"), body);
  readonly editAll = (body: { author: string; layer: string; operations: Operation[]; make: boolean }) =>
    postJson<Job>(path("project", "operations"), body);
  readonly remove = (sid: string, name: string, keep: boolean) =>
    postJson<{ archived: string | null }>(path("sessions", sid, "removal"), { name, keep });
  readonly archive = () => getJson<Archived[]>(path("project", "archive"));
  readonly restoreArchived = (id: string) => postJson<{ id: string | null }>(path("project", "archive", id, "restore"), {});
  readonly dropArchived = (id: string, name: string) => postJson<unknown>(path("project", "archive", id, "removal"), { name, keep: false });
  readonly others = (sid: string) => getJson<Neighbour[]>(path("sessions", sid, "others"));
  readonly otherObjects = (sid: string, name: string, layer: string) =>
    getJson<OtherObjects>(`${path("sessions", sid, "others", name)}?layer=${encodeURIComponent(layer)}`);

  readonly fileUrl = (sid: string, stream: string) => path("sessions", sid, "files", stream);

  readonly live = (sid: string): WebSocket => {
    const url = new URL(path("sessions", sid, "live"), location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    return new WebSocket(url);
  };
}

export function liveMessage(data: unknown): LiveMessage | null {
  try {
    return JSON.parse(String(data)) as LiveMessage;
  } catch {
    return null;
  }
}

interface TableHeader {
  rows: number;
  columns: { name: string; type: "f4" | "f8" | "i4" | "dict"; offset: number; values?: string[] }[];
}

async function getTable(url: string, signal?: AbortSignal): Promise<ColumnTable> {
  const buffer = await (await request(url, { signal })).arrayBuffer();
  return decodeTable(buffer);
}

/** uint32 length of the header, the header as JSON, then the arrays, each at its offset from the start of the arrays. */
export function decodeTable(buffer: ArrayBuffer): ColumnTable {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length))) as TableHeader;
  const data = Math.ceil((4 + length) / 8) * 8;
  const columns = new Map<string, TableColumn>();
  for (const { name, type, offset, values } of header.columns) {
    const at = data + offset;
    const array =
      type === "f4" ? new Float32Array(buffer, at, header.rows)
      : type === "f8" ? new Float64Array(buffer, at, header.rows)
      : new Int32Array(buffer, at, header.rows);
    columns.set(name, { name, values: array, dictionary: type === "dict" ? (values ?? []) : null });
  }
  return { rows: header.rows, columns };
}
