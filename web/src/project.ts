// What can be done to a project: new ones, recordings brought in, sessions put away, all of them edited.

import { ask, askText, closing, openDialog } from "./dialogs";
import { clock, fill, h } from "./dom";
import { findings, follow, megabytes, sendFiles } from "./jobs";
import type { App } from "./state";
import { findEverywhere } from "./together";
import type { Archived, Project, SessionSummary } from "./types";
import { openWindows } from "./windows";

type Changed = () => void;

const NAME = /^[^\W_][\w .@+-]*$/u;

/** The buttons above the list. */
export function projectTools(app: App, project: Project, changed: Changed): HTMLElement {
  const button = (label: string, testId: string, run: () => void, disabled = false): HTMLElement =>
    h("button.button", { type: "button", "data-testid": testId, "data-focus": testId, disabled, onclick: run }, label);
  const none = project.sessions.length === 0;
  return h("div.project-tools", null,
    button("New project…", "new-project", () => void newProject(app, project, changed)),
    button("Import a recording…", "import-recording", () => void importRecording(app, project, changed)),
    button("Windows in all sessions…", "windows-everywhere", () => void openWindows(app, project.sessions.length), none),
    button("Find objects in all texts…", "find-everywhere", () => void askFinding(app, project), none),
    h("span.spacer"), h("span.muted", { "data-testid": "statistics" }, statistics(project.sessions)));
}

function statistics(sessions: SessionSummary[]): string {
  const sum = (key: "n_frames" | "n_objects" | "n_events" | "n_relations"): string => sessions.reduce((total, s) => total + s[key], 0).toLocaleString("en");
  const seconds = sessions.reduce((total, s) => total + (s.duration_s ?? 0), 0);
  return `${sessions.length} ${sessions.length === 1 ? "session" : "sessions"} · ${sum("n_frames")} frames · ${clock(seconds)} · ${sum("n_objects")} objects · ${sum("n_events")} events · ${sum("n_relations")} relations`;
}

function place(project: Project): HTMLSelectElement {
  return h("select.input", { id: "inside", "data-testid": "inside" },
    [{ path: "", name: project.name }, ...project.projects.filter((p) => p.path !== "")].map((p) => h("option", { value: p.path }, p.path === "" ? p.name : `${p.name} (${p.path})`)));
}

function nameInput(): HTMLInputElement {
  return h("input.input", { type: "text", id: "new-name", maxlength: 100, autocomplete: "off", "data-testid": "new-name" });
}

async function newProject(app: App, project: Project, changed: Changed): Promise<void> {
  const [name, inside, yes] = [nameInput(), place(project), closing("Make it", "yes", "primary", "new-project-yes")];
  yes.disabled = true;
  name.addEventListener("input", () => (yes.disabled = !NAME.test(name.value)));
  const { closed } = openDialog({
    title: "New project", testId: "new-project-dialog",
    body: [h("p.muted", null, "A folder for sessions: letters, digits, blanks, dots, dashes."), h("div.fields", null, h("label", { for: name.id }, "Name"), name, h("label", { for: inside.id }, "In"), inside)],
    foot: [closing("Cancel", ""), yes],
  });
  if ((await closed) !== "yes") return;
  await attempt(app, () => app.api.makeProject(name.value.trim(), inside.value), changed);
}

async function importRecording(app: App, project: Project, changed: Changed): Promise<void> {
  const [name, inside, yes] = [nameInput(), place(project), closing("Import", "yes", "primary", "import-yes")];
  const folder = h("input", { type: "file", webkitdirectory: true, "data-testid": "import-folder", id: "import-folder" });
  const file = h("input", { type: "file", multiple: true, "data-testid": "import-file", id: "import-file" });
  const chosen = h("p.muted", { role: "status" }, "Nothing chosen yet.");
  let files: File[] = [];
  const refresh = (): void => {
    yes.disabled = files.length === 0 || !NAME.test(name.value);
    if (files.length > 0) chosen.textContent = `${files.length} ${files.length === 1 ? "file" : "files"}, ${megabytes(files.reduce((sum, f) => sum + f.size, 0))}`;
  };
  for (const input of [folder, file]) {
    input.addEventListener("change", () => {
      // what programs hide in folders is no recording
      files = [...(input.files ?? [])].filter((f) => !f.name.startsWith("."));
      const first = files[0];
      if (first !== undefined && name.value === "") name.value = (first.webkitRelativePath.split("/")[0] || first.name.replace(/\.[^.]*$/, "")).replace(/[^\w .@+-]+/gu, "_").replace(/^[\W_]+/u, "");
      refresh();
    });
  }
  name.addEventListener("input", refresh);
  refresh();
  const { closed } = openDialog({
    title: "Import a recording", testId: "import-dialog",
    body: [
      h("p.muted", null, "A folder or a file of any format that `ecat formats` lists: it becomes a session, or a project where there are several recordings in it. What you choose is left as it is."),
      h("div.fields", null, h("label", { for: folder.id }, "A folder"), folder, h("label", { for: file.id }, "or files"), file, h("label", { for: name.id }, "Name"), name, h("label", { for: inside.id }, "In"), inside), chosen,
    ],
    foot: [closing("Cancel", ""), yes],
  });
  if ((await closed) !== "yes") return;
  const wanted = { name: name.value.trim(), inside: inside.value };
  const job = await follow(app, `Importing ${wanted.name}`, async (tell) => app.api.importUpload({ ...wanted, upload: await sendFiles(app, files, tell) }));
  if (job === null) return;
  findings(app, job, `${wanted.name} is there, from ${String(job.result?.format)}.`);
  changed();
}

async function askFinding(app: App, project: Project): Promise<void> {
  const layer = await askText("Find objects in all texts", `Marks the names of objects, as whole words, in the texts of the events of this layer, in ${project.sessions.length} sessions. What is marked stays.`, project.layer || "main", "Find them");
  if (layer !== null && layer !== "") await findEverywhere(app, layer);
}

/** The buttons of one session. */
export function sessionTools(app: App, session: SessionSummary, changed: Changed): HTMLElement {
  const button = (label: string, testId: string, run: () => void): HTMLElement =>
    h("button.link-button", { type: "button", "data-testid": `${testId}-${session.id}`, "aria-label": `${label} ${session.name}`, onclick: run }, label);
  return h("span.row", null, button("Archive", "archive", () => void archive(app, session, changed)), button("Delete", "delete", () => void remove(app, session, changed)));
}

async function archive(app: App, session: SessionSummary, changed: Changed): Promise<void> {
  if (!(await ask("Put the session away?", `${session.name} goes to the archive, from where it can be brought back as it is.`, "Archive it"))) return;
  await attempt(app, () => app.api.remove(session.id, session.name, true), changed);
}

async function remove(app: App, session: SessionSummary, changed: Changed): Promise<void> {
  if (await confirmed(session.name, `${session.name} with its recordings and everything that was said of it is deleted for good.`)) {
    await attempt(app, () => app.api.remove(session.id, session.name, false), changed);
  }
}

/** Whether somebody typed the name of what they are about to lose. */
async function confirmed(name: string, text: string): Promise<boolean> {
  const input = h("input.input", { type: "text", autocomplete: "off", "aria-label": "Name of the session, to confirm", "data-testid": "confirm-name" });
  const yes = closing("Delete for good", "yes", "danger", "confirm-yes");
  yes.disabled = true;
  input.addEventListener("input", () => (yes.disabled = input.value !== name));
  const { closed } = openDialog({
    title: "Delete the session?", testId: "confirm-delete", body: [h("p", null, text), h("p.muted", null, `Type its name, ${name}, to confirm.`), input], foot: [closing("Cancel", ""), yes],
  });
  return (await closed) === "yes";
}

/** The sessions that were put away. */
export async function archiveList(app: App, host: HTMLElement, changed: Changed): Promise<void> {
  const found = await app.api.archive().catch((error: unknown) => {
    app.fail(error);
    return [] as Archived[];
  });
  fill(host, found.length === 0 ? null : h("details.archive", { "data-testid": "archive" }, h("summary", null, `Archive (${found.length})`),
    h("table", null, h("thead", null, h("tr", null, ["Session", "Was in", "Put away", ""].map((t) => h("th", null, t)))), h("tbody", null, found.map((a) => h("tr", null,
      h("td", null, a.name), h("td.mono", null, a.place), h("td", null, new Date(a.when).toLocaleString("en-GB")),
      h("td", null, h("span.row", null,
        h("button.link-button", { type: "button", "data-testid": `restore-${a.name}`, onclick: () => void attempt(app, () => app.api.restoreArchived(a.id), changed) }, "Bring back"),
        h("button.link-button", { type: "button", "data-testid": `drop-${a.name}`, onclick: () => void drop(app, a, changed) }, "Delete")))))))));
}

async function drop(app: App, a: Archived, changed: Changed): Promise<void> {
  if (await confirmed(a.name, `${a.name} is deleted from the archive for good.`)) await attempt(app, () => app.api.dropArchived(a.id, a.name), changed);
}

async function attempt(app: App, work: () => Promise<unknown>, changed: Changed): Promise<void> {
  try {
    await work();
    changed();
  } catch (error) {
    app.fail(error);
  }
}
