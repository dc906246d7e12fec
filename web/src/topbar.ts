// The bar on top: what is open, whose layer is edited, whether it is saved, who else is here.

import { redo, undo } from "./actions";
import { askText } from "./dialogs";
import { clock, fill, h, iconButton } from "./dom";
import { openHelp } from "./help";
import { openHistory } from "./history";
import { openLayers } from "./layers";
import { openScheme } from "./scheme";
import { openSession } from "./session";
import type { App } from "./state";
import { openWindows } from "./windows";

const SAVE_TEXT = { saved: "saved", saving: "saving…", offline: "not connected" } as const;
const THEMES = ["system", "light", "dark"] as const;

export function createTopbar(host: HTMLElement, app: App): { destroy(): void } {
  const title = h("h1", null, app.session?.name ?? "");
  const facts = h("span.facts");
  const layer = h("button.button", { type: "button", title: "Which layers are shown, which one is edited", "data-testid": "layer-button", onclick: () => openLayers(app) });
  const author = h("button.button", { type: "button", title: "Your name, kept with every edit", "data-testid": "author-button", onclick: () => void rename(app) });
  const save = h("span.save-state", { role: "status", "data-testid": "save-state" });
  const people = h("span.people", { "data-testid": "people" });
  const undoButton = iconButton("undo", "Undo (Ctrl+Z)", () => undo(app), { "data-testid": "undo" });
  const redoButton = iconButton("redo", "Redo (Ctrl+Shift+Z)", () => redo(app), { "data-testid": "redo" });
  const theme = iconButton("theme", "Theme", () => {
    app.set({ theme: THEMES[(THEMES.indexOf(app.settings.theme) + 1) % THEMES.length] ?? "system" });
  }, { "data-testid": "theme" });

  fill(host,
    h("a.icon-button", { href: "#/", "aria-label": "All sessions", title: "All sessions" }, iconButton("back", "", () => undefined).firstElementChild as SVGSVGElement),
    title, facts, h("span.spacer"),
    h("div.group", null, people, save),
    h("div.group", null, undoButton, redoButton, iconButton("history", "History", () => openHistory(app), { "data-testid": "history-button" })),
    h("div.group", null, layer, author),
    h("div.group", null,
      h("button.button", { type: "button", "data-testid": "session-button", title: "Files, tables, what is shown, messages", onclick: () => openSession(app) }, "Session"),
      h("button.button", { type: "button", "data-testid": "scheme-button", onclick: () => openScheme(app) }, "Scheme"),
      h("button.button", { type: "button", "data-testid": "windows-button", onclick: () => void openWindows(app, app.project?.sessions.length ?? 1) }, "Windows"),
      h("a.button.adjudicate-link", { href: `#/adjudicate/${encodeURIComponent(app.session?.id ?? "")}`, title: "Compare two layers and build the gold layer" }, "Compare")),
    h("div.group", null, theme, iconButton("help", "All shortcuts (?)", () => openHelp(app), { "data-testid": "help-button" })),
  );

  const refresh = (): void => {
    const session = app.session;
    if (session === null) return;
    facts.textContent = `${session.n_frames.toLocaleString("en")} ${session.n_frames === 1 ? "frame" : "frames"} · ${clock(session.duration_s)}`;
    layer.textContent = `Layer: ${app.activeLayer}`;
    author.textContent = app.settings.author === "" ? "Your name…" : app.settings.author;
    undoButton.disabled = !app.active.canUndo;
    redoButton.disabled = !app.active.canRedo;
    theme.title = `Theme: ${app.settings.theme}`;
    theme.setAttribute("aria-label", `Theme: ${app.settings.theme}`);
  };
  const showSave = (): void => {
    save.dataset.state = app.save;
    save.textContent = SAVE_TEXT[app.save];
    refresh();
  };
  const showPeople = (): void => {
    fill(people, app.people.map((p) => {
      const where = [p.layer === null ? "" : `layer ${p.layer}`, p.frame === null ? "" : `frame ${p.frame}`, [p.selection ?? []].flat().join(", ")].filter(Boolean).join(", ");
      const label = `${p.name || "somebody"}${where === "" ? "" : ` – ${where}`}`;
      return h("span.person", { title: label, role: "img", "aria-label": label }, (p.name || "?").slice(0, 2));
    }));
  };
  showSave();
  showPeople();
  const off = [
    app.on("save", showSave), app.on("layer", refresh), app.on("layers", refresh), app.on("settings", refresh),
    app.on("people", showPeople), app.on("session", refresh),
  ];
  return { destroy: () => off.forEach((f) => f()) };
}

async function rename(app: App): Promise<void> {
  const name = await askText("Who is annotating?", "Every edit from now on keeps this name.", app.settings.author, "Use this name");
  if (name !== null && name !== "") app.set({ author: name });
}
