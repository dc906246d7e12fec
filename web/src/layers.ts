// Whose layers are shown side by side, and which one is edited.

import { askText, closing, openDialog } from "./dialogs";
import { fill, h } from "./dom";
import { type App, MACHINE } from "./state";

const NAME = /^[A-Za-z0-9_.-]{1,64}$/;

export function openLayers(app: App): void {
  const body = h("tbody");
  const table = h("table", null, h("thead", null, h("tr", null,
    h("th", null, "Edited"), h("th", null, "Shown"), h("th", null, "Layer"),
    h("th.number", null, "Objects"), h("th.number", null, "Events"), h("th.number", null, "Relations"))), body);
  const refresh = (): void => fill(body, names(app).map((name) => row(app, name, refresh)));
  refresh();
  const add = h("button.button", {
    type: "button", "data-testid": "new-layer",
    onclick: async () => {
      const name = await askText("New layer", "One layer for each annotator: a short name of letters, digits, dots, dashes.", app.settings.author, "Make the layer");
      if (name === null) return;
      if (!NAME.test(name) || name === MACHINE) return app.notify("That name cannot be used: letters, digits, dots, dashes, underscores; not “machine”.");
      await app.setActiveLayer(name).catch((e: unknown) => app.fail(e));
      refresh();
    },
  }, "New layer…");
  const { closed } = openDialog({
    title: "Layers", testId: "layers", size: "wide-dialog",
    body: [h("p.muted", null, "Every annotator has a layer of their own. The machine's proposals are never edited: they are accepted into the edited layer, or rejected."), table, h("div", null, add)],
    foot: [closing("Done", "", "primary")],
  });
  const off = [app.on("layers", refresh), app.on("layer", refresh)];
  void closed.then(() => off.forEach((f) => f()));
}

function names(app: App): string[] {
  const known = (app.session?.layers ?? []).map((l) => l.name);
  return [...new Set([...known.filter((n) => n !== MACHINE), ...[...app.layers.keys()].filter((n) => n !== MACHINE), ...known])];
}

function row(app: App, name: string, refresh: () => void): HTMLElement {
  const machine = name === MACHINE;
  const loaded = app.layers.get(name)?.document;
  const listed = app.session?.layers.find((l) => l.name === name);
  const shown = machine ? app.settings.proposals : app.shown.includes(name);
  const setShown = async (): Promise<void> => {
    if (machine) app.set({ proposals: !app.settings.proposals });
    else await app.setShown(shown ? app.shown.filter((n) => n !== name) : [...app.shown, name]).catch((e: unknown) => app.fail(e));
    refresh();
  };
  return h("tr", { "data-testid": `layer-${name}` },
    h("td", null, machine ? null : h("input", {
      type: "radio", name: "edited", checked: name === app.activeLayer, "aria-label": `Edit the layer ${name}`,
      onchange: () => void app.setActiveLayer(name).catch((e: unknown) => app.fail(e)),
    })),
    h("td", null, h("input", {
      type: "checkbox", checked: shown, disabled: name === app.activeLayer, "aria-label": `Show the layer ${name}`, onchange: () => void setShown(),
    })),
    h("td", null, name, machine && h("span.muted", null, " – proposals")),
    ...(["objects", "events", "relations"] as const).map((kind) =>
      h("td.number", null, String(loaded?.[kind].list.length ?? listed?.[`n_${kind}`] ?? 0))));
}
