// The selected object: what it is, where it is drawn, when it is there, what takes part in.

import { attempt, markAbsent, removeSelected } from "../actions";
import { goTo } from "../navigate";
import { span } from "../document";
import { clock, h, iconButton } from "../dom";
import { swatch } from "../scheme";
import { canHaveHulls, extent, generateHulls, hullsOf } from "../hulls";
import type { App, LayerState } from "../state";
import type { AnnotatedObject, KeyFrame } from "../types";
import { choice, field, numberInput, propertyRows, section, textField } from "./fields";

const SHOWN_KEYS = 200;
const MEASURED: ReadonlySet<string> = new Set(["rig", "marker_box"]);
const HULLED: ReadonlySet<string> = new Set(["rectangle", "polygon"]);

export function objectPanel(app: App, layer: LayerState, object: AnnotatedObject): HTMLElement[] {
  const own = layer.name === app.activeLayer;
  const edit = (change: Record<string, unknown>) => void attempt(app, { op: "edit_object", id: object.id, ...change });
  const drawn = object.origin === "manual";
  return [
    h("div.headline", null, swatch(object.color), h("strong", null, object.name || object.id), h("span.mono.muted", null, object.id), h("span.spacer"),
      h("span.chip", null, object.kind.replaceAll("_", " ")), object.origin !== "manual" && h("span.chip", null, object.origin)),
    own ? null : h("p.hint", null, `In the layer ${layer.name}, which is not the one you edit.`),
    h("div.fields", null,
      textField("Name", object.name, (name) => edit({ name }), { disabled: !own, testId: "object-name" }),
      textField("Semantic", object.semantic_type, (semantic_type) => edit({ semantic_type }), { disabled: !own, testId: "object-semantic", suggestions: semanticTypes(app) }),
      field("Colour", colorInput(object, edit, !own)),
      field("Between", choice("Between", object.interpolation, [["linear", "moves in a straight line"], ["hold", "stays until the next"]], (interpolation) => edit({ interpolation }), { disabled: !own, testId: "object-interpolation" })),
      field("Stream", choice("Stream", object.stream, [["", "the annotated video"], ...(app.session?.streams ?? []).map((s) => s.name)], (stream) => edit({ stream }), { disabled: !own })),
    ),
    drawn || object.key_frames.length > 0 ? presence(app, object, own) : null,
    HULLED.has(object.kind) ? inSpace(app, object) : null,
    object.key_frames.length > 0 ? keyFrames(app, object, own) : null,
    takesPart(app, layer, object),
    section("Properties", [], ...propertyRows(object.properties, (name, value) => void attempt(app, { op: "set_property", target: object.id, name, value }), !own)),
    own ? h("div.actions", null, h("button.button.danger", { type: "button", onclick: () => void removeSelected(app), "data-testid": "remove-object" }, "Remove the object")) : null,
  ].filter((e) => e !== null);
}

function semanticTypes(app: App): string[] {
  return [...new Set(app.document.objects.list.map((o) => o.semantic_type).filter(Boolean))].slice(0, 50);
}

function colorInput(object: AnnotatedObject, edit: (change: Record<string, unknown>) => void, disabled: boolean): HTMLElement {
  const input = h("input.input", { type: "color", value: object.color.slice(0, 7), disabled, "data-focus": "Colour", "aria-label": "Colour", "data-testid": "object-color" });
  input.addEventListener("change", () => edit({ color: `${input.value}${object.color.slice(7) || "ff"}` }));
  const width = numberInput("Line width", object.line_width, (line_width) => line_width !== null && edit({ line_width }), { min: 1, max: 10, disabled });
  return h("div.row", null, input, h("span.muted", null, "line"), width);
}

/** The stretches where the object is there, as its key frames say. */
export function presenceSpans(keys: KeyFrame[], nFrames: number): [number, number][] {
  const found: [number, number][] = [];
  let start: number | null = null;
  for (const key of [...keys].sort((a, b) => a.frame - b.frame)) {
    if (key.present && start === null) start = key.frame;
    else if (!key.present && start !== null) {
      found.push([start, key.frame]);
      start = null;
    }
  }
  if (start !== null) found.push([start, nFrames]);
  return found;
}

function presence(app: App, object: AnnotatedObject, own: boolean): HTMLElement {
  const spans = presenceSpans(object.key_frames, app.nFrames);
  const here = spans.some(([s, e]) => s <= app.cursor.frame && app.cursor.frame < e);
  const start = numberInput("Present from frame", spans[0]?.[0] ?? 0, () => undefined, { disabled: !own, max: app.nFrames, testId: "presence-start" });
  const end = numberInput("Present to frame", spans.at(-1)?.[1] ?? app.nFrames, () => undefined, { disabled: !own, max: app.nFrames, testId: "presence-end" });
  const set = (): void => void attempt(app, { op: "set_presence", object: object.id, start_frame: start.valueAsNumber, end_frame: end.valueAsNumber });
  return section("Present", [h("span.chip", { class: here ? "chip good" : "chip" }, here ? "here now" : "not here now")],
    ...spans.map(([s, e]) => h("div.row", null, h("button.link-button", { type: "button", onclick: () => app.seek(s) }, `${s} – ${e}`), h("span.muted", null, `${clock(app.secondsOf(s))} – ${clock(app.secondsOf(e))}`))),
    own && h("div.row", null, start, h("span.muted", null, "to"), end,
      h("button.button", { type: "button", onclick: set, "data-testid": "presence-set" }, "Set"),
      h("button.button", { type: "button", onclick: () => void markAbsent(app), title: "Absent from the cursor on (A)", "data-testid": "set-absent" }, "Absent here")));
}

/** The object's hull at the cursor, as depth sees it. */
function inSpace(app: App, object: AnnotatedObject): HTMLElement | null {
  if (!canHaveHulls(app)) return null;
  const hull = hullsOf(app).at(app.cursor.frame).find((found) => found.object === object.id);
  const make = h("button.button", {
    type: "button", "data-testid": "generate-3d", title: "Follows the drawn shapes through the images, and finds their hulls in the depth images",
    onclick: () => void generateHulls(app, object),
  }, "Generate 3-D");
  const size = hull === undefined ? "" : extent(hull.corners).map((m) => (100 * m).toFixed(1)).join(" × ");
  return section("3-D", [make], h("p.muted", { "data-testid": "hull" }, hull === undefined
    ? `No hull at this frame${hullsOf(app).there ? "" : " yet"}.`
    : `Hull of ${hull.corners.length} corners, ${size} cm (right × down × away), from a shape that was ${hull.status}.`));
}

function keyFrames(app: App, object: AnnotatedObject, own: boolean): HTMLElement {
  const here = object.key_frames.some((k) => k.frame === app.cursor.frame && k.present);
  const keys = object.key_frames;
  const near = keys.findIndex((k) => k.frame >= app.cursor.frame);
  const from = keys.length <= SHOWN_KEYS ? 0 : Math.max(0, Math.min(keys.length - SHOWN_KEYS, near - SHOWN_KEYS / 2));
  const rows = keys.slice(from, from + SHOWN_KEYS).map((key) => h("div.row", { "data-testid": `key-${key.frame}` },
    h("button.link-button", { type: "button", onclick: () => app.seek(key.frame) }, String(key.frame)),
    h("span.muted", null, clock(app.secondsOf(key.frame))),
    h("span.spacer"), key.present ? null : h("span.chip", null, "absent from here"),
    own ? iconButton("close", `Remove the key frame at ${key.frame}`, () => void attempt(app, { op: "remove_key_frame", object: object.id, frame: key.frame })) : null));
  const add = own && !here && !MEASURED.has(object.kind) ? h("button.button", {
    type: "button", "data-testid": "add-key", "data-focus": "add key", title: "The shape that is shown here, or the nearest one, begins to count at this frame",
    onclick: () => void attempt(app, { op: "set_key_frame", object: object.id, frame: app.cursor.frame }),
  }, `Key frame at ${app.cursor.frame}`) : null;
  const all = h("details.section", null, h("summary", null, `Key frames (${keys.length})`),
    h("div", null, add, keys.length > rows.length && h("p.muted", null, `The ${rows.length} around the cursor.`), rows));
  all.open = keys.length <= 12;
  return all;
}

function takesPart(app: App, layer: LayerState, object: AnnotatedObject): HTMLElement {
  const events = layer.document.events.list.filter((e) => e.roles.some((r) => r.target.split("/")[0] === object.id)).slice(0, 50);
  const relations = layer.document.relations.list.filter((r) => r.arguments.some((a) => a.target === object.id)).slice(0, 50);
  return section("Takes part in", [],
    ...events.map((e) => h("div.row", null,
      h("button.link-button", { type: "button", onclick: () => goTo(app, { kind: "event", id: e.id, layer: layer.name }) }, e.type || e.text.slice(0, 40) || e.id),
      h("span.muted", null, e.roles.filter((r) => r.target.split("/")[0] === object.id).map((r) => r.name).join(", ")), h("span.spacer"),
      h("span.muted", null, span(e).join("–")))),
    ...relations.map((r) => h("div.row", null,
      h("button.link-button", { type: "button", onclick: () => goTo(app, { kind: "relation", id: r.id, layer: layer.name }) }, `${r.polarity ? "" : "not "}${r.predicate}`),
      h("span.muted", null, r.arguments.map((a) => layer.document.object(a.target)?.name || a.target).join(", ")))),
    events.length + relations.length === 0 && h("p.empty", null, "No event and no relation yet."));
}

