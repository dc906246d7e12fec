// The selected event: type, stretch, roles, text, place among the others.

import { attempt, merge, moveEdge, nameEvent, newSubEvent, otherTypes, ownObject, removeSelected, split, toggleLoop, trackedObjects } from "../actions";
import { goTo } from "../navigate";
import { span } from "../document";
import { clock, h, iconButton } from "../dom";
import { type App, type LayerState, MACHINE } from "../state";
import type { EcatEvent, Role } from "../types";
import { check, choice, field, numberInput, propertyRows, section, textField, textInput } from "./fields";
import { textSection } from "./text";

export function eventPanel(app: App, layer: LayerState, event: EcatEvent): HTMLElement[] {
  const own = layer.name === app.activeLayer;
  const edit = (change: Record<string, unknown>) => void attempt(app, { op: "edit_event", id: event.id, ...change });
  const types = app.scheme.event_types.filter((t) => t.tier === "" || event.tier === "" || t.tier === event.tier);
  const confirmed = event.status === "confirmed";
  return [
    h("div.headline", null, h("strong", null, event.type || "untyped event"), h("span.mono.muted", null, event.id), h("span.spacer"),
      event.unsure ? h("span.chip.warn", null, "unsure") : null, h(`span.chip.${confirmed ? "good" : "warn"}`, { "data-testid": "event-status" }, event.status)),
    own ? null : h("p.hint", null, `In the layer ${layer.name}, which is not the one you edit.`),
    own && app.guessed === event.id ? guess(app, event) : null,
    h("div.fields", null,
      textField("Type", event.type, (type) => edit({ type }), { disabled: !own, testId: "event-type", suggestions: types.map((t) => t.name) }),
      textField("Tier", event.tier, (tier) => edit({ tier }), { disabled: !own, testId: "event-tier", suggestions: tiers(app) }),
      field("Parent", parentChoice(app, layer, event, own)),
      h("span.label", null, "State"),
      h("div.row", null, check("Unsure", event.unsure, (unsure) => edit({ unsure }), { disabled: !own, testId: "event-unsure" }),
        check("Confirmed", confirmed, (yes) => edit({ status: yes ? "confirmed" : "proposed" }), { disabled: !own, testId: "event-confirmed" }),
        h("span.spacer"), h("span.muted", { title: "Author" }, event.author)),
    ),
    segmentSection(app, event, own),
    roleSection(app, layer, event, own),
    textSection(app, layer, event, own),
    subEventSection(app, layer, event, own),
    linkSection(app, layer, event, own),
    slotSection(app, event, own),
    section("Properties", [], ...propertyRows(event.properties, (name, value) => void attempt(app, { op: "set_property", target: event.id, name, value }), !own)),
    own ? actions(app) : null,
  ].filter((e) => e !== null);
}

/** The type was not chosen yet: what it was taken to be, and the key for each other one. */
function guess(app: App, event: EcatEvent): HTMLElement {
  return h("div.guess", { "data-testid": "guess", role: "group", "aria-label": "Type of the new event" },
    h("p", null, "Taken to be ", h("strong", null, event.type || "of no type"), ". Another key says what it is:"),
    h("div.actions", null, otherTypes(app, event.tier).map((t) => h("button.button", {
      type: "button", "aria-pressed": String(t.name === event.type), "data-testid": `guess-${t.name}`, onclick: () => void nameEvent(app, event, t),
    }, h("kbd", null, t.key), ` ${t.name}`))));
}

function tiers(app: App): string[] {
  return [...new Set([...app.scheme.tiers.map((t) => t.name), ...app.document.events.list.slice(0, 500).map((e) => e.tier)])].filter(Boolean);
}

function eventName(event: EcatEvent): string {
  return `${event.type || event.text.slice(0, 30) || "event"} ${event.id}`;
}

function parentChoice(app: App, layer: LayerState, event: EcatEvent, own: boolean): HTMLElement {
  const [start, end] = span(event);
  const around = layer.document.events.list.filter((e) => {
    const [s, t] = span(e);
    return e.id !== event.id && s <= start && t >= end && e.parent !== event.id;
  });
  const options: [string, string][] = [["", "none"], ...around.slice(0, 60).map((e): [string, string] => [e.id, eventName(e)])];
  return choice("Parent", event.parent ?? "", options, (parent) => void attempt(app, { op: "set_parent", id: event.id, parent: parent || null }), { disabled: !own, testId: "event-parent" });
}

function segmentSection(app: App, event: EcatEvent, own: boolean): HTMLElement {
  const rows = event.segments.map((s, i) => {
    const move = (edge: "start" | "end") => (frame: number | null): void => {
      if (frame !== null) void moveEdge(app, event, i, edge, frame);
    };
    return h("div.row", { "data-testid": `segment-${i}` },
      numberInput(`Start of segment ${i + 1}`, s.start_frame, move("start"), { disabled: !own, max: app.nFrames, testId: `segment-${i}-start` }),
      numberInput(`End of segment ${i + 1}`, s.end_frame, move("end"), { disabled: !own, max: app.nFrames, testId: `segment-${i}-end` }),
      h("span.muted", { title: "Start and length in seconds" }, `${clock(app.secondsOf(s.start_frame))} · ${length(app, s.start_frame, s.end_frame)}`),
      h("span.spacer"),
      iconButton("jump", `Go to segment ${i + 1}`, () => {
        app.select([{ kind: "event", id: event.id, layer: app.primary?.layer ?? app.activeLayer, segment: i }]);
        app.seek(s.start_frame);
      }),
      own && event.segments.length > 1 ? iconButton("close", `Remove segment ${i + 1}`, () => void attempt(app, { op: "remove_segment", id: event.id, segment: i })) : null);
  });
  const add = own ? iconButton("plus", "Add a segment from the marks I and O", () => {
    const { start, end } = app.marks;
    const from = start ?? app.cursor.frame;
    const to = end ?? Math.min(app.nFrames, from + 30);
    void attempt(app, { op: "add_segment", id: event.id, start_frame: Math.min(from, to), end_frame: Math.max(from, to) });
  }, { "data-testid": "add-segment" }) : null;
  return section(event.segments.length > 1 ? "Segments" : "Segment", [add], ...rows);
}

function length(app: App, start: number, end: number): string {
  const a = app.secondsOf(start);
  const b = app.secondsOf(end);
  return a === null || b === null ? `${end - start} fr` : `${(b - a).toFixed(2)} s`;
}

function roleSection(app: App, layer: LayerState, event: EcatEvent, own: boolean): HTMLElement {
  const type = app.scheme.event_types.find((t) => t.name === event.type);
  const named = new Set(event.roles.map((r) => r.name));
  const missing = (type?.roles ?? []).filter((r) => !named.has(r.name)).map((r): Role & { required: boolean } => ({ name: r.name, target: "", kind: r.kind, required: r.required }));
  const rows = [...event.roles, ...missing].map((role) => roleRow(app, layer, event, role, own));
  return section("Roles", [], ...rows, own && newRole(app, layer, event));
}

/** `kind:target` of everything that can take a role, with its name. */
function targets(app: App, layer: LayerState, event: EcatEvent, current: Role | null): [string, string][] {
  const { objects, events } = layer.document;
  const list: [string, string][] = objects.list.map((o): [string, string] => [`object:${o.id}`, o.name ? `${o.name} (${o.id})` : o.id]);
  for (const body of app.session?.bodies ?? []) {
    const rig = body.object_id === null ? undefined : objects.get(body.object_id);
    if (rig !== undefined) for (const joint of body.joints) list.push([`joint:${rig.id}/${joint}`, `${rig.name || rig.id} / ${joint}`]);
  }
  for (const o of trackedObjects(app)) list.push([`tracked:${o.id}`, `${o.name || o.id} (tracked)`]);
  const [start, end] = span(event);
  const near = events.list.filter((e) => e.id !== event.id && span(e)[0] < end + 300 && span(e)[1] > start - 300).slice(0, 40);
  for (const e of near) list.push([`event:${e.id}`, `event ${eventName(e)}`]);
  const value = current && current.target !== "" ? `${current.kind}:${current.target}` : "";
  if (value !== "" && !list.some(([v]) => v === value)) list.unshift([value, current?.target ?? ""]);
  return [["", "–"], ...list];
}

async function setRole(app: App, event: EcatEvent, role: string, value: string): Promise<void> {
  const cut = value.indexOf(":");
  const [kind, name] = [value.slice(0, cut), value.slice(cut + 1)];
  const target = kind === "tracked" ? await ownObject(app, MACHINE, name) : name;
  if (value === "") await attempt(app, { op: "set_role", id: event.id, role, target: null });
  else if (target !== null) await attempt(app, { op: "set_role", id: event.id, role, target, kind: kind === "tracked" ? "object" : kind });
}

function roleRow(app: App, layer: LayerState, event: EcatEvent, role: Role & { required?: boolean }, own: boolean): HTMLElement {
  const value = role.target === "" ? "" : `${role.kind}:${role.target}`;
  const name = role.required && value === "" ? `${role.name} *` : role.name;
  return h("div.fields", null, ...field(name, choice(`Role ${role.name}`, value, targets(app, layer, event, role), (v) => void setRole(app, event, role.name, v), { disabled: !own, testId: `role-${role.name}` })));
}

function newRole(app: App, layer: LayerState, event: EcatEvent): HTMLElement {
  const name = h("input.input", { type: "text", placeholder: "role", maxlength: 64, "aria-label": "Name of a new role", "data-focus": "new role", "data-testid": "new-role" });
  const target = choice("Who takes the new role", "", targets(app, layer, event, null), (value) => {
    if (name.value.trim() !== "") void setRole(app, event, name.value.trim(), value);
    else name.focus();
  }, { testId: "new-role-target" });
  return h("div.row", null, name, target);
}

function subEventSection(app: App, layer: LayerState, event: EcatEvent, own: boolean): HTMLElement {
  const children = layer.document.children(event.id);
  return section("Sub-events", [own ? iconButton("plus", "New sub-event (N)", () => void newSubEvent(app), { "data-testid": "add-sub-event" }) : null],
    ...children.map((child) => h("div.row", null,
      h("button.link-button", { type: "button", onclick: () => goTo(app, { kind: "event", id: child.id, layer: layer.name }) }, child.type || child.id),
      h("span.spacer"), h("span.muted", null, span(child).join("–")))),
    children.length === 0 && h("p.empty", null, "None."));
}

function linkSection(app: App, layer: LayerState, event: EcatEvent, own: boolean): HTMLElement {
  const kinds = app.scheme.predicates.filter((p) => p.target === "event").map((p) => p.name);
  const rows = event.links.map((link) => {
    const target = layer.document.event(link.target);
    return h("div.row", null, h("span.chip", null, link.type || "link"),
      h("button.link-button", { type: "button", onclick: () => goTo(app, { kind: "event", id: link.target, layer: layer.name }) }, target === undefined ? link.target : eventName(target)),
      h("span.spacer"),
      own ? iconButton("close", `Remove the link ${link.type} to ${link.target}`, () => void attempt(app, { op: "unlink_events", id: event.id, type: link.type, target: link.target })) : null);
  });
  const details = h("details.section", null, h("summary", null, `Links (${event.links.length})`), ...rows, own && newLink(app, layer, event, kinds));
  details.open = event.links.length > 0;
  return details;
}

function newLink(app: App, layer: LayerState, event: EcatEvent, kinds: string[]): HTMLElement {
  const type = textInput("Type of a new link", kinds.at(-1) ?? "CAUSE", () => undefined, { suggestions: kinds, testId: "link-type" });
  const target = h("input.input", { type: "text", placeholder: "event id", list: "link-targets", "aria-label": "Event to link to", "data-focus": "link target", "data-testid": "link-target" });
  const add = (): void => {
    const input = type.querySelector("input") ?? (type as HTMLInputElement);
    const id = target.value.trim().split(" ").at(-1) ?? "";
    if (id !== "") void attempt(app, { op: "link_events", id: event.id, type: input.value.trim(), target: id });
  };
  target.addEventListener("keydown", (e) => {
    if (e.key === "Enter") add();
  });
  const others = layer.document.events.list.filter((e) => e.id !== event.id).slice(0, 100);
  return h("div.row", null, type, target, h("datalist", { id: "link-targets" }, others.map((e) => h("option", { value: e.id }, eventName(e)))),
    iconButton("plus", "Add the link", add, { "data-testid": "link-add" }));
}

/** The event as a sentence of five slots; Subject, Object and Locative are roles, Verb is the type. */
function slotSection(app: App, event: EcatEvent, own: boolean): HTMLElement {
  const role = (name: string): string => event.roles.find((r) => r.name === name)?.target ?? "";
  const adjunct = event.properties.find((p) => p.name === "adjunct")?.value ?? "";
  const objects: [string, string][] = [["", "–"], ...app.document.objects.list.map((o): [string, string] => [o.id, o.name || o.id])];
  const set = (slot: string) => (value: string): void => void attempt(app, { op: "set_slots", id: event.id, [slot]: value });
  const pick = (label: string, slot: string) => field(label, choice(label, role(label), objects, set(slot), { disabled: !own, testId: `slot-${slot}` }));
  return h("details.section", null, h("summary", null, "Slots"),
    h("div.fields", null, pick("Subject", "subject"),
      textField("Verb", event.type, set("verb"), { disabled: !own, testId: "slot-verb" }),
      pick("Object", "object"), pick("Locative", "locative"),
      textField("Adjunct", adjunct, set("adjunct"), { disabled: !own, testId: "slot-adjunct" })));
}

function actions(app: App): HTMLElement {
  const button = (label: string, title: string, run: () => void, testId: string): HTMLElement => h("button.button", { type: "button", title, onclick: run, "data-testid": testId }, label);
  return h("div.actions", null,
    button("Split", "Split at the cursor (S)", () => void split(app), "split"), button("Merge", "Merge with the next (M)", () => void merge(app), "merge"),
    button("Repeat", "Repeat while playing (P)", () => toggleLoop(app), "loop"),
    h("span.spacer"), h("button.button.danger", { type: "button", title: "Remove the event (Delete)", onclick: () => void removeSelected(app), "data-testid": "remove-event" }, "Remove"));
}
