// The coding scheme: what may be said, with which keys; and the choice of another one.

import { attempt } from "./actions";
import { openDialog } from "./dialogs";
import { h } from "./dom";
import { labelOf } from "./keyboard";
import type { App } from "./state";
import type { EventType, Scheme } from "./types";

export function openScheme(app: App): void {
  const session = app.session;
  if (session === null) return;
  const names = [...new Set([app.scheme.name, ...session.schemes])].filter((n) => n !== "");
  const choose = h("select.input", { "aria-label": "Coding scheme", "data-testid": "scheme-choice" }, names.map((n) => h("option", { value: n, selected: n === app.scheme.name }, n)));
  choose.addEventListener("change", () => void change(app, choose.value).then(() => {
    element.close();
    openScheme(app);
  }));
  const { element } = openDialog({
    title: "Coding scheme", testId: "scheme", size: "wide-dialog",
    body: [h("div.row", null, choose, h("span.muted", null, `version ${app.scheme.version}${app.scheme.closed ? ", closed: nothing else may be used" : ", open: other names are allowed"}`)),
      ...view(app, app.scheme)],
  });
}

async function change(app: App, name: string): Promise<void> {
  if ((await attempt(app, { op: "set_scheme", name })) !== null) await app.refreshSession().catch((e: unknown) => app.fail(e));
}

function view(app: App, scheme: Scheme): HTMLElement[] {
  const head = (...names: string[]): HTMLElement => h("thead", null, h("tr", null, names.map((n) => h("th", null, n))));
  const key = (type: EventType): HTMLElement | string => {
    if (type.key === "") return "";
    return labelOf(app, type.key.toLowerCase()) === type ? h("kbd", null, type.key) : h("span.chip.warn", { title: "This key already does something else" }, `${type.key} is taken`);
  };
  return [
    h("h3", null, "Tiers"),
    h("table", null, head("Tier", "Below", "Constraint"), h("tbody", null, scheme.tiers.map((t) =>
      h("tr", null, h("td", null, t.name), h("td", null, t.parent ?? "–"), h("td", null, t.constraint.replaceAll("_", " ")))))),
    h("h3", null, "Event types"),
    scheme.event_types.length === 0 ? h("p.muted", null, "None: any type may be used.") :
    h("table", null, head("Key", "Type", "Tier", "Roles", "VoxML"), h("tbody", null, scheme.event_types.map((t) =>
      h("tr", null, h("td", null, key(t)), h("td", null, swatch(t.color), " ", t.name), h("td", null, t.tier || "any"),
        h("td", null, t.roles.map((r) => `${r.name}${r.required ? "*" : ""}`).join(", ") || "–"), h("td", null, t.voxml || "–"))))),
    h("h3", null, "Predicates"),
    h("p", null, scheme.predicates.map((p) => `${p.name}(${["X", "Y", "Z", "W"].slice(0, p.arity).join(",")})${p.target === "event" ? " of events" : ""}`).join(" · ") || "none"),
    ...(scheme.constraints.length > 0 ? [h("p.muted", null, scheme.constraints.map((c) => c.kind === "UNIQUE"
      ? `${c.predicates}: one value at a time in argument ${c.unique_argument}` : `only one of ${c.predicates.replaceAll(",", ", ")}`).join(" · "))] : []),
  ];
}

export function swatch(color: string): HTMLElement {
  const mark = h("span.swatch", { "aria-hidden": "true" });
  mark.style.display = "inline-block";
  mark.style.backgroundColor = /^#[0-9a-f]{6}/i.test(color) ? color.slice(0, 7) : "transparent";
  return mark;
}
