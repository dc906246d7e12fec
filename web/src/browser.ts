// The project: its sessions, what is in them, and the way into each.

import { clock, fill, h, iconButton } from "./dom";
import type { App } from "./state";
import type { Project, SessionSummary } from "./types";

type Column = { key: keyof SessionSummary; title: string; number?: boolean; text: (s: SessionSummary) => string };

const COLUMNS: Column[] = [
  { key: "name", title: "Session", text: (s) => s.name },
  { key: "n_frames", title: "Frames", number: true, text: (s) => s.n_frames.toLocaleString("en") },
  { key: "duration_s", title: "Duration", number: true, text: (s) => clock(s.duration_s) },
  { key: "streams", title: "Streams", text: (s) => s.streams.join(", ") || "–" },
  { key: "layers", title: "Layers", text: (s) => s.layers.join(", ") || "–" },
  { key: "n_objects", title: "Objects", number: true, text: (s) => String(s.n_objects) },
  { key: "n_events", title: "Events", number: true, text: (s) => String(s.n_events) },
  { key: "created", title: "Created", text: (s) => (s.created ?? "").slice(0, 10) || "–" },
];

/** Whether the project's only session has been opened without asking: once, so that the way back to the list works. */
let opened = false;

export function createBrowser(host: HTMLElement, app: App): { destroy(): void } {
  let project: Project | null = null;
  let sort: Column = COLUMNS[0] as Column;
  let descending = false;
  const filter = h("input.input", { type: "search", placeholder: "Find a session", "aria-label": "Find a session", "data-testid": "find-session" });
  const title = h("h1", null, "ecat");
  const root = h("span.muted.mono");
  const table = h("div", { "data-testid": "sessions" }, h("p.loading", { role: "status" }, "Looking for sessions…"));
  const theme = iconButton("theme", "Theme", () => app.set({ theme: app.settings.theme === "dark" ? "light" : "dark" }));
  fill(host, h("div.browser", null, h("header", null, title, root, h("span.spacer"), h("a", { href: "#/surveys" }, "Surveys"), filter, theme), h("main", null, table)));

  const show = (): void => {
    if (project === null) return;
    const wanted = filter.value.trim().toLowerCase();
    const found = project.sessions.filter((s) => `${s.name} ${s.layers.join(" ")}`.toLowerCase().includes(wanted));
    found.sort((a, b) => compare(a[sort.key], b[sort.key]) * (descending ? -1 : 1));
    fill(table, found.length === 0 ? h("p.empty", null, project.sessions.length === 0 ? "There is no session here. `ecat import` makes one of a recording." : "No session has that name.") : listing(found));
  };
  const listing = (sessions: SessionSummary[]): HTMLElement => h("table", null,
    h("thead", null, h("tr", null, COLUMNS.map((c) => h(c.number ? "th.number" : "th", { "aria-sort": c === sort ? (descending ? "descending" : "ascending") : "none" },
      h("button.link-button", { type: "button", "data-focus": `sort-${c.key}`, onclick: () => {
        descending = c === sort && !descending;
        sort = c;
        show();
      } }, `${c.title}${c === sort ? (descending ? " ↓" : " ↑") : ""}`))))),
    h("tbody", null, sessions.map((s) => h("tr", { "data-testid": `session-${s.id}` }, COLUMNS.map((c) =>
      h(c.number ? "td.number" : "td", null, c.key !== "name" ? c.text(s) : s.error ? h("span", { title: s.error }, s.name, " ", h("span.chip.bad", null, "cannot be read")) : h("a", { href: `#/session/${encodeURIComponent(s.id)}` }, s.name)))))));

  filter.addEventListener("input", show);
  app.api.project().then((answer) => {
    project = answer;
    title.textContent = answer.name;
    root.textContent = answer.root;
    if (app.settings.author === "" && answer.author) app.set({ author: answer.author });
    const only = answer.sessions[0];
    if (answer.sessions.length === 1 && only !== undefined && !only.error && !opened) {
      opened = true;
      location.replace(`#/session/${encodeURIComponent(only.id)}`);
      return;
    }
    show();
  }).catch((error: unknown) => {
    app.fail(error);
    fill(table, h("p.empty", { role: "alert" }, error instanceof Error ? error.message : "The project cannot be read."));
  });
  return { destroy: () => undefined };
}

function compare(a: unknown, b: unknown): number {
  if (typeof a === "number" && typeof b === "number") return a - b;
  return String(a ?? "").localeCompare(String(b ?? ""), "en", { numeric: true });
}
