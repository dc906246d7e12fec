// What the open session is made of, what can be brought into it, what is shown of it, and what was said while it is open.

import { ask, closing, openDialog } from "./dialogs";
import { fill, h } from "./dom";
import { findings, follow, megabytes, sendFiles } from "./jobs";
import type { App } from "./state";
import type { StreamInfo } from "./types";

const SHOWN_MESSAGES = 50;
/** What nothing was counted or computed by. */
const REMOVABLE: ReadonlySet<string> = new Set(["other", "skeleton"]);

export function openSession(app: App): void {
  if (app.session === null) return;
  const body = h("div.session-parts");
  const show = (): void => fill(body, streams(app), tables(app), views(app), messages(app));
  show();
  const { closed } = openDialog({ title: app.session.name, testId: "session-dialog", size: "wide-dialog", body: [body], foot: [closing("Done", "", "primary")] });
  const offs = [app.on("session", show), app.on("tables", show), app.on("notice", show), app.on("settings", show)];
  void closed.then(() => offs.forEach((off) => off()));
}

function streams(app: App): HTMLElement {
  const { session } = app;
  const size = (s: StreamInfo): string => (s.width_px === null || s.height_px === null ? "" : `${s.width_px} × ${s.height_px}`);
  return h("section", { "aria-label": "Recorded files" },
    h("h3", null, "Recorded files"),
    h("table", null, h("thead", null, h("tr", null, ["Stream", "Kind", "Images", "Size", ""].map((t) => h("th", null, t)))),
      h("tbody", null, (session?.streams ?? []).map((s) => h("tr", { "data-testid": `file-${s.name}` }, h("td", null, s.name), h("td", null, s.kind), h("td", null, s.n_frames > 0 ? s.n_frames.toLocaleString("en") : "–"), h("td", null, size(s)),
        h("td", null, h("span.row", null, s.present ? h("a", { href: app.api.fileUrl(session?.id ?? "", s.name), download: true }, "Save a copy") : h("span.chip.warn", null, "not there"),
          REMOVABLE.has(s.kind) ? h("button.link-button", { type: "button", "data-testid": `remove-file-${s.name}`, "aria-label": `Remove ${s.name}`, onclick: () => void removeFile(app, s.name) }, "Remove") : null)))))),
    h("div.actions", null, h("button.button", { type: "button", "data-testid": "add-skeleton", onclick: () => chooseSkeleton(app) }, "Add skeletons of a file…"),
      h("button.button", { type: "button", "data-testid": "add-file", onclick: () => chooseFiles(app) }, "Add other files…")),
    ...(session?.problems ?? []).map((p) => h("p.hint", { role: "alert" }, p)));
}

/** A rig file, and its body scheme where it has one. */
function chooseSkeleton(app: App): void {
  choose(app, "Add skeletons", `A recorder's rig file (rig_….xml), with its body scheme (bodyScheme.xml) if it has one, or an NTU RGB+D skeleton. Each body becomes a rig of the layer ${app.activeLayer}; the file is copied into the session.`,
    "skeleton", ".xml,.skeleton", (files) => addSkeletons(app, files));
}

/** Whatever belongs to the recording, and is kept with it as it is. */
function chooseFiles(app: App): void {
  choose(app, "Add files", "They are copied into the session and kept with it as they are; what cannot be told apart by name gets a number.", "file", null, (files) => addFiles(app, files));
}

function choose(app: App, title: string, text: string, name: string, accept: string | null, add: (files: File[]) => Promise<void>): void {
  const input = h("input", { type: "file", accept, multiple: true, "aria-label": title, "data-testid": `${name}-files` });
  const chosen = h("p.muted", { role: "status" }, "Nothing chosen yet.");
  const yes = closing("Add", "yes", "primary", `${name}-yes`);
  yes.disabled = true;
  input.addEventListener("change", () => {
    const files = [...(input.files ?? [])];
    yes.disabled = files.length === 0;
    chosen.textContent = files.map((f) => `${f.name}, ${megabytes(f.size)}`).join("; ");
  });
  const { closed } = openDialog({ title, testId: `${name}-dialog`, body: [h("p.muted", null, text), input, chosen], foot: [closing("Cancel", ""), yes] });
  closed.then((value) => (value === "yes" ? add([...(input.files ?? [])]) : undefined)).catch((error: unknown) => app.fail(error));
}

async function addFiles(app: App, files: File[]): Promise<void> {
  const sid = app.session?.id;
  if (sid === undefined) return;
  const job = await follow(app, "Adding files", async (tell) => app.api.addFiles(sid, await sendFiles(app, files, tell)));
  if (job !== null && app.session?.id === sid) await app.refreshSession();
}

async function removeFile(app: App, name: string): Promise<void> {
  const sid = app.session?.id;
  if (sid === undefined || !(await ask("Remove the file?", `${name} is deleted from the session for good. What was read from it stays.`, "Remove it", "danger"))) return;
  try {
    await app.api.removeFile(sid, name);
    await app.refreshSession();
  } catch (error) {
    app.fail(error);
  }
}

async function addSkeletons(app: App, files: File[]): Promise<void> {
  const sid = app.session?.id;
  const author = await app.author().catch((error: unknown) => app.fail(error));
  if (sid === undefined || author === undefined) return;
  const job = await follow(app, "Adding skeletons", async (tell) =>
    app.api.addSkeletons(sid, { layer: app.activeLayer, author, upload: await sendFiles(app, files, tell) }));
  if (job === null || app.session?.id !== sid) return;
  await app.refreshSession();
  app.emitTables();
  const objects = (job.result?.objects ?? []) as string[];
  app.select(objects.map((id) => ({ kind: "object", id, layer: app.activeLayer })));
  findings(app, job, `${objects.length} ${objects.length === 1 ? "body" : "bodies"} added.`);
}

function tables(app: App): HTMLElement {
  const { session } = app;
  return h("section", { "aria-label": "Tables" }, h("h3", null, "Tables"), h("p", { "data-testid": "session-tables" }, (session?.tables ?? []).join(" · ") || "none"),
    h("div.actions", null, h("button.button", { type: "button", "data-testid": "process", title: "Finds markers, the table, poses, relations and proposals, as far as they are out of date", onclick: () => void process(app) }, "Process what is out of date")));
}

async function process(app: App): Promise<void> {
  const sid = app.session?.id;
  if (sid === undefined) return;
  const job = await follow(app, "Processing", () => app.api.process(sid, null));
  if (job === null || app.session?.id !== sid) return;
  await app.refreshSession();
  app.emitTables();
  const ran = (job.result?.ran ?? []) as string[];
  findings(app, job, ran.length > 0 ? `Done: ${ran.join(", ")}.` : "Everything was up to date.");
}

function views(app: App): HTMLElement {
  const check = (label: string, on: boolean, testId: string, set: (on: boolean) => void): HTMLElement =>
    h("label.check", null, h("input", { type: "checkbox", checked: on, "data-testid": testId, "data-focus": testId, onchange: (event: Event) => set((event.target as HTMLInputElement).checked) }), label);
  const { body, marks, proposals } = app.settings;
  return h("section", { "aria-label": "What is shown" }, h("h3", null, "What is shown"), h("div.actions", null,
    check("Skeletons without legs", body === "upper", "upper-body", (on) => app.set({ body: on ? "upper" : "whole" })),
    check("Faces of markers", marks, "show-marks", (on) => app.set({ marks: on })),
    check("The machine's proposals", proposals, "show-proposals", (on) => app.set({ proposals: on }))));
}

function messages(app: App): HTMLElement {
  const list = app.messages.slice(-SHOWN_MESSAGES).reverse();
  return h("section", { "aria-label": "Messages" }, h("h3", null, "Messages"), list.length === 0 ? h("p.empty", null, "Nothing was said yet.")
    : h("ol.messages", { "data-testid": "messages" }, list.map((m) => h(m.kind === "error" ? "li.error" : "li", null, h("span.at", null, m.at.toLocaleTimeString("en-GB")), " ", m.text, m.detail ? h("span.muted", null, ` ${m.detail}`) : null))));
}
