// The inspector: everything about the selected element, and the lists of what there is.

import { newEvent } from "./actions";
import { openCopying } from "./copying";
import { fill, h } from "./dom";
import { hullsOf } from "./hulls";
import { eventPanel } from "./inspector/event";
import { createList, createRelationList, eventRows, NOTED_ROW, objectRows, proposalOrder, proposalRows } from "./inspector/lists";
import { objectPanel } from "./inspector/object";
import { proposalPanel } from "./inspector/proposal";
import { relationPanel } from "./inspector/relation";
import { tally } from "./proposals";
import { type App, MACHINE } from "./state";

const TABS = ["Selected", "Objects", "Events", "Relations", "Machine"] as const;
type Tab = (typeof TABS)[number];
/** A tab has room for two digits. */
const MOST_COUNTED = 99;

export function createInspector(host: HTMLElement, app: App): { destroy(): void } {
  const selected = h("div.panel", { "data-testid": "selected-panel" });
  const relations = createRelationList(app);
  const lists = {
    Objects: createList(app, "Objects", () => objectRows(app), () => [h("div.list-tools", null, h("button.button", {
      type: "button", "data-testid": "copy-objects", "data-focus": "copy objects", onclick: () => void openCopying(app),
    }, "Copy from another session…"))]),
    Events: createList(app, "Events", () => eventRows(app), () => []),
    Relations: relations,
    Machine: createList(app, "Proposals", () => proposalRows(app), () => [proposalOrder(app)], NOTED_ROW),
  };
  let tab: Tab = "Selected";
  const buttons = TABS.map((name) => h("button.tab", {
    type: "button", role: "tab", id: `tab-${name}`, "aria-controls": "inspector-panel", "data-testid": `tab-${name.toLowerCase()}`, onclick: () => show(name),
  }, h("span.name", null, name), name === "Machine" ? h("span.count", { "data-testid": "n-proposals" }) : null));
  const bar = h("div.tabs", { role: "tablist", "aria-label": "Inspector" }, buttons);
  const body = h("div.panel-host", { role: "tabpanel", id: "inspector-panel" });
  fill(host, bar, body);
  bar.addEventListener("keydown", (event) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (by === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    show(TABS[(TABS.indexOf(tab) + by + TABS.length) % TABS.length] as Tab);
    buttons[TABS.indexOf(tab)]?.focus();
  });

  const refresh = (): void => {
    if (tab === "Selected") fill(selected, selectedPanel(app));
    else lists[tab].refresh();
    const open = app.openProposals();
    const n = open.events.length + open.relations.length;
    const machine = buttons[TABS.indexOf("Machine")] as HTMLElement;
    machine.title = n > 0 ? `${tally(open)} to decide about` : "";
    (machine.lastElementChild as HTMLElement).textContent = n > MOST_COUNTED ? `${MOST_COUNTED}+` : n > 0 ? String(n) : "";
  };
  const show = (name: Tab): void => {
    tab = name;
    body.setAttribute("aria-labelledby", `tab-${name}`);
    buttons.forEach((b, i) => {
      const on = TABS[i] === name;
      b.setAttribute("aria-selected", String(on));
      b.tabIndex = on ? 0 : -1;
    });
    body.replaceChildren(name === "Selected" ? selected : lists[name].element);
    refresh();
  };

  let waiting = 0;
  const later = (): void => {
    waiting ||= requestAnimationFrame(() => {
      waiting = 0;
      refresh();
    });
  };
  // Something that was just drawn wants a name.
  let added: string | null = null;
  const nameIt = (): void => {
    const object = app.selectedObject;
    if (object === null || object.id !== added || object.name !== "") return;
    added = null;
    if (tab !== "Selected") show("Selected");
    else refresh();
    selected.querySelector<HTMLInputElement>('[data-testid="object-name"]')?.focus();
  };
  const onSelection = (): void => {
    // A click in a list keeps the list; anything else shows what was selected.
    if (tab !== "Selected" && app.selection.length === 1 && !body.contains(document.activeElement)) show("Selected");
    else later();
    nameIt();
  };
  const off = [
    app.on("layer", ({ layer, changes }) => {
      if (layer === app.activeLayer) added = changes?.find((c) => c.kind === "object" && c.before === null)?.id ?? added;
      later();
    }), app.on("layers", later), app.on("session", later), app.on("settings", later), app.on("marks", later), app.on("guessed", later), app.on("tables", later),
    app.on("selection", onSelection), hullsOf(app).onLoaded(later),
    app.on("cursor", () => {
      if (tab === "Relations") relations.atCursor();
      else if (tab === "Selected" && app.primary?.kind === "object" && !app.cursor.playing) later();
    }),
  ];
  show("Selected");
  return {
    destroy: () => {
      off.forEach((f) => f());
      cancelAnimationFrame(waiting);
    },
  };
}

function selectedPanel(app: App): HTMLElement[] {
  const last = app.primary;
  const layer = last === null ? undefined : app.layers.get(last.layer);
  if (last === null || layer === undefined) return emptyPanel(app);
  const several = app.selection.length > 1 ? [h("p.hint", null, `${app.selection.length} selected; the last one is shown. M merges events, Delete removes all.`)] : [];
  if (last.kind === "object") {
    const object = layer.document.object(last.id);
    return object === undefined ? emptyPanel(app) : [...several, ...objectPanel(app, layer, object)];
  }
  const element = last.kind === "event" ? layer.document.event(last.id) : layer.document.relation(last.id);
  if (element === undefined) return emptyPanel(app);
  if (layer.name === MACHINE) return [...several, ...proposalPanel(app, layer, element)];
  return [...several, ..."segments" in element ? eventPanel(app, layer, element) : relationPanel(app, layer, element)];
}

function emptyPanel(app: App): HTMLElement[] {
  const line = (keys: string[], text: string): HTMLElement => h("div", null, keys.map((k) => h("kbd", null, k)), ` ${text}`);
  const open = tally(app.openProposals());
  const typed = app.scheme.event_types.filter((t) => t.key !== "");
  return [
    h("div.hint", null, line(["Space"], "play"), line(["I"], "mark the start"), line(["O"], "mark the end"), line(["E"], "new event"), line(["N"], "new sub-event"),
      line(["R"], "draw a rectangle"), line(["?"], "all shortcuts")),
    typed.length > 0 ? h("div.section", null, h("h3", null, "Labels while playing"), h("div.label-keys", null, typed.map((t) => h("div", null, h("kbd", null, t.key), ` ${t.name}`)))) : null,
    open !== "" ? h("p.muted", { "data-testid": "proposed" }, `The machine proposes ${open}, drawn hollow.`) : null,
    h("div.actions", null, h("button.button", { type: "button", onclick: () => void newEvent(app), "data-testid": "new-event" }, "New event at the cursor")),
  ].filter((e) => e !== null);
}
