// The JSON of the server, and the elements of a layer as the page holds them.
// Frames count the images of the annotated video from zero; intervals are half-open; 2-D coordinates are pixels.

export type ObjectKind = "rectangle" | "polygon" | "marker_box" | "rig" | "point" | "other";
export type Status = "proposed" | "confirmed";

export interface Property {
  name: string;
  value: string;
}

export interface KeyFrame {
  frame: number;
  t_ns: number | null;
  /** False: absent from this frame on. */
  present: boolean;
  coordinates: number[];
}

export interface AnnotatedObject {
  id: string;
  name: string;
  kind: ObjectKind;
  origin: "manual" | "tracked" | "provided";
  dimensions: 2 | 3;
  semantic_type: string;
  stream: string;
  /** #rrggbbaa */
  color: string;
  line_width: number;
  interpolation: "linear" | "hold";
  properties: Property[];
  key_frames: KeyFrame[];
  key_frames_3d: KeyFrame[];
}

export interface Segment {
  start_frame: number;
  end_frame: number;
  start_ns: number | null;
  end_ns: number | null;
}

export type RoleKind = "object" | "joint" | "event";

export interface Role {
  name: string;
  target: string;
  kind: RoleKind;
}

export interface Link {
  type: string;
  target: string;
}

export interface TextReference {
  start: number;
  end: number;
  target: string;
}

export interface TextPredicate {
  start: number;
  end: number;
  type: string;
}

export interface EcatEvent {
  id: string;
  type: string;
  tier: string;
  parent: string | null;
  status: Status;
  unsure: boolean;
  author: string;
  text: string;
  segments: Segment[];
  roles: Role[];
  links: Link[];
  references: TextReference[];
  predicates: TextPredicate[];
  properties: Property[];
}

export interface Relation {
  id: string;
  predicate: string;
  start_frame: number;
  /** Null: until contradicted. */
  end_frame: number | null;
  start_ns: number | null;
  end_ns: number | null;
  polarity: boolean;
  source: "marked" | "computed";
  status: Status;
  author: string;
  arguments: { target: string }[];
}

export interface Decision {
  /** `machine/<id>` */
  proposal: string;
  verdict: "accepted" | "rejected";
  result: string;
  author: string;
}

/** A layer as the server sends it: fields that have their default value are left out. */
export interface LayerJson {
  name: string;
  scheme?: string;
  object_counter?: number;
  event_counter?: number;
  relation_counter?: number;
  objects?: Partial<AnnotatedObject>[];
  events?: Partial<EcatEvent>[];
  relations?: Partial<Relation>[];
  decisions?: Partial<Decision>[];
}

export interface Change {
  kind: "object" | "event" | "relation" | "decision" | "key_frame" | "key_frame_3d" | "layer";
  id: string;
  /** Position of the element in its list. */
  index: number;
  before: Record<string, unknown> | null;
  after: Record<string, unknown> | null;
}

export interface Operation {
  op: string;
  [field: string]: unknown;
}

export interface RecordJson {
  revision: number;
  author: string;
  time: string;
  operation: Operation | Operation[];
  changes: Change[];
}

export interface LayerAnswer {
  revision: number;
  saved_revision: number;
  can_undo: boolean;
  can_redo: boolean;
  layer: LayerJson;
}

export interface EditAnswer {
  record: RecordJson;
  can_undo: boolean;
  can_redo: boolean;
}

export interface ErrorJson {
  what: string;
  where?: string;
  consequence?: string;
  fix?: string;
  kind?: string;
}

// --- coding scheme

export interface Tier {
  name: string;
  parent: string | null;
  constraint: "none" | "included_in" | "subdivision" | "no_overlap";
}

export interface RoleType {
  name: string;
  kind: RoleKind;
  required: boolean;
}

export interface EventType {
  name: string;
  tier: string;
  voxml: string;
  /** The keyboard key that labels it, or "". */
  key: string;
  color: string;
  roles: RoleType[];
}

export interface PredicateType {
  name: string;
  arity: number;
  target: "object" | "event";
}

export interface Constraint {
  kind: "UNIQUE" | "EXCLUSIVE";
  predicates: string;
  unique_argument: number;
}

export interface Scheme {
  name: string;
  version: string;
  closed: boolean;
  tiers: Tier[];
  event_types: EventType[];
  predicates: PredicateType[];
  constraints: Constraint[];
}

// --- project and session

export interface SessionSummary {
  id: string;
  name: string;
  /** The way to its folder. */
  path: string;
  /** The way to its project; "" for what is served. */
  project: string;
  n_frames: number;
  duration_s: number | null;
  streams: string[];
  layers: string[];
  n_events: number;
  n_objects: number;
  n_relations: number;
  created: string | null;
  /** Why it cannot be read. */
  error: string | null;
}

export interface Project {
  name: string;
  root: string;
  projects: { path: string; name: string }[];
  sessions: SessionSummary[];
  /** False if one session is all there is. */
  whole: boolean;
  /** What `ecat annotate` was told to suggest. */
  author: string;
  layer: string;
}

export interface Proxy {
  state: "ready" | "making" | "absent" | "failed";
  progress: number | null;
  url: string | null;
  fps: number | null;
}

export interface StreamInfo {
  name: string;
  kind: string;
  n_frames: number;
  width_px: number | null;
  height_px: number | null;
  camera: string;
  present: boolean;
  proxy: Proxy;
}

export interface LayerSummary {
  name: string;
  revision: number;
  n_events: number;
  n_objects: number;
  n_relations: number;
}

export interface SessionInfo {
  id: string;
  name: string;
  n_frames: number;
  duration_s: number | null;
  clock: string;
  /** Name of the annotated stream; null when the session has none. */
  video: string | null;
  streams: StreamInfo[];
  layers: LayerSummary[];
  tables: string[];
  /** Another one as soon as a stage has written a table. */
  tables_sha256: string;
  scheme: Partial<Scheme> | null;
  schemes: string[];
  frame_rate_median: number | null;
  cameras: Camera[];
  bodies: Body[];
  boxes: Box[];
  plane: Plane | null;
  problems: string[];
}

/** Joints of a body in the table `joints`, and the bones between them. */
export interface Body {
  body: number;
  object_id: string | null;
  joints: string[];
  bones: [string, string][];
}

/** Edge lengths of an object's box along its x, y, z axes. */
export interface Box {
  object_id: string;
  name: string;
  size_m: [number, number, number];
}

/** A pinhole camera; `rotation` (x, y, z, w) and `translation_m` take its points to `camera/<reference>`. */
export interface Camera {
  name: string;
  width_px: number;
  height_px: number;
  fx_px: number;
  fy_px: number;
  cx_px: number;
  cy_px: number;
  mirrored: boolean;
  reference: string;
  distortion: number[];
  rotation: number[];
  translation_m: number[];
}

/** The table in `camera/depth`; `origin` and `rotation` (x, y, z, w) take points of `table` there. */
export interface Plane {
  normal: (number | null)[];
  d: number | null;
  origin: (number | null)[];
  rotation: (number | null)[];
  outline: (number | null)[][];
}

export interface SeriesInfo {
  name: string;
  title: string;
  unit: string;
}

export interface Person {
  id: string;
  name: string;
  layer: string | null;
  frame: number | null;
  selection: string | string[] | null;
}

export type LiveMessage =
  | { type: "hello"; id: string; revisions: Record<string, number>; tables_sha256: string }
  | { type: "record"; layer: string; record: RecordJson }
  | { type: "presence"; people: Person[] }
  | { type: "saved"; layer: string; revision: number }
  | { type: "replaced"; layer: string; revision: number }
  | { type: "tables"; tables: string[] }
  | { type: "problem"; layer: string; what: string }
  | ({ type: "proxy"; stream: string } & Proxy);

export interface TableColumn {
  name: string;
  values: Float32Array | Float64Array | Int32Array;
  /** Of a dictionary-encoded column: the text of each code; code -1 is null. */
  dictionary: string[] | null;
}

export interface ColumnTable {
  rows: number;
  columns: Map<string, TableColumn>;
}

// --- agreement

export interface Disagreement {
  kind: "object" | "event" | "relation";
  /** Ids in the two layers; null where one of them says nothing. */
  first: string | null;
  second: string | null;
  differs: string[];
  label: string;
  start_frame: number;
  end_frame: number;
}

export interface Agreement {
  layers: string[];
  figures: AgreementFigures;
  /** Objects of the first and of the second layer that are the same thing. */
  objects: [string, string][];
  disagreements: Disagreement[];
}

export interface AgreementFigures {
  tiers: Record<string, { observed: number | null; cohen_kappa: number | null; fleiss_kappa: number | null; krippendorff_alpha: number | null }>;
  events: { of: string; name: string; least_iou: number; f1: number | null }[];
}

// --- surveys

export interface SurveySummary {
  name: string;
  question: string;
  items: number;
  /** How many items each has answered. */
  raters: Record<string, number>;
}

export interface SurveyItem {
  id: string;
  /** Id of the session that the stretch is of; null if it is gone. */
  session: string | null;
  start_frame: number;
  end_frame: number;
}

export interface Survey {
  name: string;
  question: string;
  kind: "choice" | "score";
  choices: string[];
  least: number;
  most: number;
  items: SurveyItem[];
  /** The last answers of the rater who asks, by item. */
  answers: Record<string, { answer: string | number; comment: string }>;
}

// --- the project as a whole

/** Something that takes a while; `total` 0: nobody knows how long. */
export interface Job {
  id: string;
  what: string;
  state: "waiting" | "running" | "done" | "failed" | "stopped";
  step: string;
  done: number;
  total: number;
  result: Record<string, unknown> | null;
  error: ErrorJson | null;
}

export interface Archived {
  id: string;
  name: string;
  place: string;
  when: string;
}

/** Another session of the same folder: `name` is what annotations call it by. */
export interface Neighbour {
  id: string;
  name: string;
}

export interface OtherObject {
  id: string;
  name: string;
  kind: ObjectKind;
  color: string;
  /** Whether it is drawn there, at all and at the session's end. */
  drawn: boolean;
  at_end: boolean;
}

export interface OtherObjects {
  session: string;
  layer: string;
  objects: OtherObject[];
}
