// The selected relation, and the form for a new one.

import { addedId, attempt, ownObject, removeSelected, trackedObjects } from "../actions";
import { clock, h } from "../dom";
import { type App, type LayerState, MACHINE } from "../state";
import type { PredicateType, Relation } from "../types";
import { elsewhere } from "./elsewhere";
import { check, choice, field, numberInput, offerAll, textField } from "./fields";

export function relationText(relation: Relation, layer: LayerState): string {
  const names = relation.arguments.map((a) => layer.document.object(a.target)?.name || a.target);
  return `${relation.polarity ? "" : "not "}${relation.predicate}(${names.join(", ")})`;
}

function objectOptions(layer: LayerState): [string, string][] {
  return layer.document.objects.list.map((o): [string, string] => [o.id, o.name ? `${o.name} (${o.id})` : o.id]);
}

function predicates(app: App): PredicateType[] {
  return app.scheme.predicates.filter((p) => p.target === "object");
}

export function relationPanel(app: App, layer: LayerState, relation: Relation): HTMLElement[] {
  const own = layer.name === app.activeLayer;
  const edit = (change: Record<string, unknown>) => void attempt(app, { op: "edit_relation", id: relation.id, ...change });
  const args = relation.arguments.map((a) => a.target);
  const options = objectOptions(layer);
  return [
    h("div.headline", null, h("strong", null, relationText(relation, layer)), h("span.mono.muted", null, relation.id), h("span.spacer"), h("span.chip", null, relation.source)),
    own ? null : h("p.hint", null, `In the layer ${layer.name}, which is not the one you edit.`),
    h("div.fields", null,
      textField("Predicate", relation.predicate, (predicate) => edit({ predicate }), { disabled: !own, suggestions: predicates(app).map((p) => p.name), testId: "relation-predicate" }),
      args.flatMap((target, i) => field(["X", "Y", "Z", "W"][i] ?? `argument ${i + 1}`, choice(`Argument ${i + 1}`, target, options,
        (value) => edit({ arguments: args.map((a, j) => (i === j ? value : a)) }), { disabled: !own, testId: `relation-argument-${i + 1}` }))),
      field("From", numberInput("From", relation.start_frame, (start_frame) => start_frame !== null && edit({ start_frame }), { disabled: !own, max: app.nFrames, testId: "relation-start" })),
      field("To", numberInput("To", relation.end_frame, (end_frame) => edit(end_frame === null ? { until_contradicted: true } : { end_frame }), { disabled: !own, max: app.nFrames, placeholder: "until…", testId: "relation-end" })),
      h("span.label", null, "Holds"), check("It is so (not denied)", relation.polarity, (polarity) => edit({ polarity }), { disabled: !own, testId: "relation-polarity" }),
    ),
    h("p.muted", null, `${clock(app.secondsOf(relation.start_frame))} – ${relation.end_frame === null ? "until contradicted" : clock(app.secondsOf(relation.end_frame))}${relation.author ? ` · ${relation.author}` : ""}`),
    own && args.length > 1 ? elsewhere(app, (target) => edit({ arguments: [...args.slice(0, -1), target] })) : null,
    own ? h("div.actions", null, h("span.spacer"), h("button.button.danger", { type: "button", onclick: () => void removeSelected(app), "data-testid": "remove-relation" }, "Remove")) : null,
  ].filter((e) => e !== null);
}

/** Adds a relation that begins at the cursor, or over the marks. */
export function relationForm(app: App): HTMLElement {
  const tracked = trackedObjects(app);
  const options: [string, string][] = [...objectOptions(app.active), ...tracked.map((o): [string, string] => [`${MACHINE}:${o.id}`, `${o.name || o.id} (tracked)`])];
  if (options.length < 1) return h("p.empty", null, "A relation needs objects; draw one first (R).");
  const known = predicates(app);
  const list = h("datalist", { id: "predicates" }, known.map((p) => h("option", { value: p.name })));
  const predicate = h("input.input", { type: "text", list: "predicates", placeholder: "PREDICATE", "aria-label": "Predicate of a new relation", "data-focus": "new predicate", "data-testid": "new-predicate", value: known[0]?.name ?? "" });
  offerAll(predicate);
  const arity = (): number => known.find((p) => p.name === predicate.value)?.arity ?? 2;
  const chosen = app.selection.findLast((s) => s.kind === "object");
  const wished = chosen === undefined ? undefined : chosen.layer === app.activeLayer ? chosen.id : `${chosen.layer}:${chosen.id}`;
  const first = options.find(([id]) => id === wished)?.[0] ?? options[0]?.[0] ?? "";
  const second = options.find(([id]) => id !== first)?.[0] ?? "";
  const args = [first, second].map((value, i) => choice(`Argument ${i + 1} of a new relation`, value, i === 0 ? options : [["", "–"], ...options], () => undefined, { testId: `new-argument-${i + 1}` }));
  const other = elsewhere(app, (target, label) => {
    const at = args[Math.max(0, arity() - 1)];
    if (at === undefined) return;
    if (![...at.options].some((o) => o.value === target)) at.append(h("option", { value: target }, label));
    at.value = target;
  });
  const negative = h("input", { type: "checkbox", "data-focus": "denied" });
  const add = async (): Promise<void> => {
    const { start, end } = app.marks;
    const chosen: string[] = [];
    for (const value of args.slice(0, arity()).map((a) => a.value).filter(Boolean)) {
      const own = value.startsWith(`${MACHINE}:`) ? await ownObject(app, MACHINE, value.slice(MACHINE.length + 1)) : value;
      if (own !== null) chosen.push(own);
    }
    const record = await attempt(app, {
      op: "add_relation", predicate: predicate.value.trim(), arguments: chosen, start_frame: start ?? app.cursor.frame,
      end_frame: start !== null && end !== null && end > start ? end : null, polarity: !negative.checked,
    });
    const id = record && addedId(record, "relation");
    if (id) app.select([{ kind: "relation", id, layer: app.activeLayer }]);
  };
  const showArity = (): void => {
    const second = args[1];
    if (second) second.hidden = arity() < 2;
  };
  predicate.addEventListener("input", showArity);
  showArity();
  return h("div.section", null, h("div.row", null, predicate, list, h("label.check", null, negative, "denied")), h("div.row", null, args), other,
    h("div.row", null, h("span.muted", null, app.marks.start === null ? "from the cursor on" : "over the marks"), h("span.spacer"),
      h("button.button.primary", { type: "button", onclick: () => void add(), "data-testid": "add-relation" }, "Add relation")));
}
