// The project: its sessions, what is in them, and the way into each.

import { clock, fill, h, iconButton } from "./dom";
import { archiveList, projectTools, sessionTools } from "./project";
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
  let gone = false;
  const filter = h("input.input", { type: "search", placeholder: "Find a session", "aria-label": "Find a session", "data-testid": "find-session" });
  const title = h("h1", null, "ecat");
  const root = h("span.muted.mono");
  const tools = h("div");
  const table = h("div", { "data-testid": "sessions" }, h("p.loading", { role: "status" }, "Looking for sessions…"));
  const archive = h("div");
  const refresh = iconButton("refresh", "Look again", () => void load(), { "data-testid": "refresh" });
  const theme = iconButton("theme", "Theme", () => app.set({ theme: document.documentElement.dataset.theme === "dark" ? "light" : "dark" }));
  fill(host, h("div.browser", null, h("header", null, title, root, h("span.spacer"), h("a", { href: "#/surveys" }, "Surveys"), filter, refresh, theme), h("main", null, tools, table, archive)));

  const show = (): void => {
    if (project === null) return;
    const { sessions } = project;
    const wanted = filter.value.trim().toLowerCase();
    const found = sessions.filter((s) => `${s.name} ${s.path} ${s.layers.join(" ")}`.toLowerCase().includes(wanted));
    found.sort((a, b) => compare(a[sort.key], b[sort.key]) * (descending ? -1 : 1));
    fill(table, found.length === 0 ? h("p.empty", null, sessions.length === 0 ? "There is no session here yet. Import a recording, above or with `ecat import`." : "No session has that name.") : listing(found));
  };
  const head = (c: Column): HTMLElement => h(c.number ? "th.number" : "th", { "aria-sort": c === sort ? (descending ? "descending" : "ascending") : "none" },
    h("button.link-button", { type: "button", "data-focus": `sort-${c.key}`, onclick: () => {
      descending = c === sort && !descending;
      sort = c;
      show();
    } }, `${c.title}${c === sort ? (descending ? " ↓" : " ↑") : ""}`));
  /** A copy goes by the name that was given to the first: its folder tells them apart. */
  const name = (s: SessionSummary): (HTMLElement | null)[] => [link(s), s.path === "" || s.path.split("/").at(-1) === s.name ? null : h("div.muted.mono", null, s.path)];
  const link = (s: SessionSummary): HTMLElement => s.error ? h("span", { title: s.error }, s.name, " ", h("span.chip.bad", null, "cannot be read")) : h("a", { href: `#/session/${encodeURIComponent(s.id)}` }, s.name);
  const row = (s: SessionSummary): HTMLElement => h("tr", { "data-testid": `session-${s.id}` },
    COLUMNS.map((c) => h(c.number ? "td.number" : `td.${c.key}`, null, c.key === "name" ? name(s) : c.text(s))),
    project?.whole ? h("td.tools", null, sessionTools(app, s, () => void load())) : null);
  /** Where a project is, unless its name says it. */
  const folder = (path: string): string => (path === "" || path === project?.projects.find((p) => p.path === path)?.name ? "" : ` ${path}`);
  /** Sessions below the project that they are in, where there are several. */
  const listing = (sessions: SessionSummary[]): HTMLElement => {
    const places = [...new Set([...(project?.projects ?? []).map((p) => p.path), ...sessions.map((s) => s.project)])].sort(compare);
    const groups = places.map((path) => ({ path, of: sessions.filter((s) => s.project === path) }));
    const several = groups.length > 1;
    return h("table", null, h("thead", null, h("tr", null, COLUMNS.map(head), project?.whole ? h("th", null, h("span.visually-hidden", null, "Actions")) : null)),
      groups.map(({ path, of }) => several && path === "" && of.length === 0 ? null : h("tbody", null,
        several ? h("tr.project-row", null, h("th", { colspan: COLUMNS.length + 1, scope: "rowgroup", "data-testid": `project-${path}` },
          project?.projects.find((p) => p.path === path)?.name ?? project?.name ?? path, h("span.muted", null, `${folder(path)} · ${of.length}`))) : null,
        of.map(row))));
  };

  filter.addEventListener("input", show);
  const load = async (): Promise<void> => {
    try {
      const answer = await app.api.project();
      if (gone) return;
      project = app.project = answer;
      title.textContent = answer.name;
      root.textContent = answer.root;
      if (app.settings.author === "" && answer.author) app.set({ author: answer.author });
      const only = answer.sessions[0];
      if (answer.sessions.length === 1 && only !== undefined && !only.error && !opened) {
        opened = true;
        location.replace(`#/session/${encodeURIComponent(only.id)}`);
        return;
      }
      opened = true;
      fill(tools, answer.whole ? projectTools(app, answer, () => void load()) : null);
      show();
      if (answer.whole) await archiveList(app, archive, () => void load());
    } catch (error) {
      app.fail(error);
      fill(table, h("p.empty", { role: "alert" }, error instanceof Error ? error.message : "The project cannot be read."));
    }
  };
  void load();
  return { destroy: () => (gone = true) };
}

function compare(a: unknown, b: unknown): number {
  if (typeof a === "number" && typeof b === "number") return a - b;
  return String(a ?? "").localeCompare(String(b ?? ""), "en", { numeric: true });
}
