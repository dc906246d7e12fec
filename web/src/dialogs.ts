// Dialogs and messages: modal questions with the browser's own <dialog>, and notes in the corner that go away.

import { changedId, type Conflict } from "./conflict";
import { describe } from "./actions";
import { h, iconButton } from "./dom";
import type { App, Notice } from "./state";
import type { Change } from "./types";

export interface DialogParts {
  title: string;
  body: (Node | string)[];
  foot?: HTMLElement[];
  size?: "narrow" | "wide-dialog" | "full-dialog";
  testId: string;
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
  const closed = new Promise<string>((resolve) => {
    element.addEventListener("close", () => {
      element.remove();
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

function brief(element: Record<string, unknown> | null): Record<string, unknown> {
  const { id: _id, t_ns: _t, ...rest } = element ?? {};
  return rest;
}

/** What a change did, field by field. */
export function changeView(change: Change): HTMLElement {
  const before = brief(change.before);
  const after = brief(change.after);
  const lines: HTMLElement[] = [];
  const text = (value: unknown): string => (typeof value === "string" ? value : JSON.stringify(value)?.slice(0, 200)) ?? "";
  for (const key of new Set([...Object.keys(before), ...Object.keys(after)])) {
    if (JSON.stringify(before[key]) === JSON.stringify(after[key])) continue;
    lines.push(h("div.change", null, `${key}: `, key in before && h("del", null, text(before[key])), " ", key in after && h("ins", null, text(after[key]))));
  }
  const verb = change.before === null ? "added" : change.after === null ? "removed" : "changed";
  return h("div", null, h("strong", null, `${change.kind.replaceAll("_", " ")} ${change.id} ${verb}`), change.after === null ? [] : lines);
}

async function askConflict({ operations, touched }: Conflict): Promise<boolean> {
  const authors = [...new Set(touched.map((t) => t.record.author))].join(" and ");
  const things = [...new Set(touched.map((t) => changedId(t.change)))].join(", ");
  const { closed } = openDialog({
    title: "Somebody else changed this", testId: "conflict", size: "narrow",
    body: [
      h("p", null, `${authors} changed ${things} before your edit (${describe(operations)}) arrived:`),
      ...touched.map((t) => changeView(t.change)),
      h("p.muted", null, "Nothing is lost either way: both are in the history."),
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
  while (host.children.length >= 4) host.firstElementChild?.remove();
  host.append(toast);
  setTimeout(() => toast.remove(), notice.kind === "error" ? 10000 : 3500);
}
