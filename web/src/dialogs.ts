// Dialogs and messages: modal questions with the browser's own <dialog>, and notes in the corner that go away.

import { changedId, type Conflict } from "./conflict";
import { describe, titleOf } from "./describe";
import { h, iconButton } from "./dom";
import type { App, Notice } from "./state";
import type { Change, Operation } from "./types";

export interface DialogParts {
  title: string;
  body: (Node | string | null)[];
  foot?: HTMLElement[];
  size?: "narrow" | "wide-dialog" | "full-dialog";
  testId: string;
}

let lastInput: "pointer" | "keyboard" = "keyboard";
for (const [name, kind] of [["pointerdown", "pointer"], ["keydown", "keyboard"]] as const) {
  globalThis.addEventListener?.(name, () => (lastInput = kind), { capture: true });
}

/** Shows a modal dialog; resolves when it is closed, with the value of the button that closed it. */
export function openDialog({ title, body, foot = [], size = "narrow", testId }: DialogParts): { element: HTMLDialogElement; closed: Promise<string> } {
  const element = h(`dialog.${size}`, { "aria-label": title, "data-testid": testId });
  const form = h("div.dialog-body", null, body);
  element.append(
    h("div.dialog-head", null, h("h2", null, title), iconButton("close", "Close", () => element.close(""))),
    form,
    ...(foot.length > 0 ? [h("div.dialog-foot", null, foot)] : []),
  );
  document.body.append(element);
  const byPointer = lastInput === "pointer";
  const closed = new Promise<string>((resolve) => {
    element.addEventListener("close", () => {
      element.remove();
      // the button that opened it gets the focus back, but whoever used the mouse does not want it: Space is to play
      if (byPointer && document.activeElement instanceof HTMLElement) document.activeElement.blur();
      resolve(element.returnValue);
    });
  });
  element.addEventListener("click", (event) => {
    if (event.target === element) element.close("");
  });
  element.showModal();
  return { element, closed };
}

/** A button that closes its dialog with a value. */
export function closing(label: string, value: string, style = "", testId = ""): HTMLButtonElement {
  const button = h("button.button", { type: "button", "data-testid": testId || null }, label);
  if (style !== "") button.classList.add(style);
  button.addEventListener("click", () => button.closest("dialog")?.close(value));
  return button;
}

export async function ask(title: string, text: string, yes: string, style = "primary"): Promise<boolean> {
  const { closed } = openDialog({
    title, testId: "question", body: [h("p", null, text)], foot: [closing("Cancel", ""), closing(yes, "yes", style, "question-yes")],
  });
  return (await closed) === "yes";
}

/** Asks for one line of text; null when cancelled. */
export async function askText(title: string, label: string, value: string, yes: string): Promise<string | null> {
  const input = h("input.input", { type: "text", value, maxlength: 64, "data-testid": "prompt-input", "aria-label": label, autofocus: true });
  const { element, closed } = openDialog({
    title, testId: "prompt", body: [h("p.muted", null, label), input],
    foot: [closing("Cancel", ""), closing(yes, "yes", "primary", "prompt-yes")],
  });
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") element.close("yes");
  });
  input.select();
  return (await closed) === "yes" ? input.value.trim() : null;
}

type Json = Record<string, unknown>;

/** A field's value as a person would say it. */
function said(key: string, value: unknown): string {
  const list = Array.isArray(value) ? (value as Json[]) : [];
  if (key === "segments") return list.map((s) => (Array.isArray(s) ? s.join("–") : `${String(s.start_frame)}–${String(s.end_frame)}`)).join(", ");
  if (key === "roles" && Array.isArray(value)) return list.map((r) => `${String(r.name)}: ${String(r.target)}`).join(", ");
  if (key === "arguments") return list.map((a) => String(a.target ?? a)).join(", ");
  if (key === "links") return list.map((l) => `${String(l.type)} ${String(l.target)}`).join(", ");
  if (key === "references") return list.map((r) => `${String(r.start)}–${String(r.end)} ${String(r.target)}`).join(", ");
  if (key === "properties") return list.map((p) => `${String(p.name)} = ${String(p.value)}`).join(", ");
  if (key === "key_frames" || key === "key_frames_3d") return `at ${list.map((k) => String(k.frame)).join(", ")}`;
  return (typeof value === "string" ? value : (JSON.stringify(value) ?? "")).slice(0, 200);
}

const UNSAID = new Set(["id", "t_ns", "start_ns", "end_ns", "object_counter", "event_counter", "relation_counter", "foreign"]);

/** What a change did, field by field; null for what nobody wants to know, such as counters. */
export function changeView(change: Change): HTMLElement | null {
  const [before, after] = [change.before ?? {}, change.after ?? {}];
  const keys = [...new Set([...Object.keys(before), ...Object.keys(after)])].filter((key) => !UNSAID.has(key));
  const lines = keys.filter((key) => JSON.stringify(before[key]) !== JSON.stringify(after[key])).map((key) => h("div.change", null,
    `${key.replaceAll("_", " ")}: `, key in before && h("del", null, said(key, before[key])), key in before && key in after && " ", key in after && h("ins", null, said(key, after[key]))));
  if (change.kind === "layer" && lines.length === 0) return null;
  return h("div", null, h("strong", null, titleOf(change)), change.after === null ? [] : lines);
}

/** What an operation of one's own would set. */
function mine(operation: Operation): HTMLElement {
  const fields = Object.entries(operation).filter(([key, value]) => key !== "op" && key !== "id" && value !== null);
  return h("div.change", null, `${describe(operation)} `, fields.flatMap(([key, value]) => [h("ins", null, `${key.replaceAll("_", " ")}: ${said(key, value)}`), " "]));
}

async function askConflict({ operations, touched }: Conflict): Promise<boolean> {
  const authors = [...new Set(touched.map((t) => t.record.author))].join(" and ");
  const things = [...new Set(touched.map((t) => changedId(t.change)))].join(", ");
  const { closed } = openDialog({
    title: "Somebody else changed this", testId: "conflict", size: "narrow",
    body: [
      h("p", null, `${authors} changed ${things} before your edit (${describe(operations)}) arrived:`),
      ...touched.map((t) => changeView(t.change)),
      h("div", null, h("strong", null, "Yours"), operations.map(mine)),
      h("p.muted", null, "Theirs stays in the history if you apply yours on top."),
    ],
    foot: [closing("Keep theirs", "", "", "conflict-theirs"), closing("Apply mine on top", "mine", "primary", "conflict-mine")],
  });
  return (await closed) === "mine";
}

export function installDialogs(app: App): void {
  const toasts = h("div.toasts", { role: "status", "aria-live": "polite", "data-testid": "toasts" });
  document.body.append(toasts);
  app.on("notice", (notice) => showToast(toasts, notice));
  app.askConflict = askConflict;
  app.confirm = ask;
  app.askAuthor = () => askText("Who is annotating?", "Every edit keeps the name of its author. Letters, digits, dots, dashes.", "", "Start");
}

function showToast(host: HTMLElement, notice: Notice): void {
  const toast = h(`div.toast.${notice.kind}`, { "data-testid": "toast" },
    h("div.body", null, h("p", null, notice.text), notice.detail ? h("p.muted", null, notice.detail) : null),
    iconButton("close", "Dismiss", () => toast.remove()));
  for (const same of host.children) if (same.querySelector(".body")?.textContent === toast.querySelector(".body")?.textContent) same.remove();
  while (host.children.length >= 4) host.firstElementChild?.remove();
  host.append(toast);
  setTimeout(() => toast.remove(), notice.kind === "error" ? 10000 : 3500);
}
