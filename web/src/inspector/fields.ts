// The fields of the inspector.  A value is handed on when it is final: Enter, a choice, or leaving the field.

import { h, iconButton } from "../dom";
import type { Property } from "../types";

let serial = 0;

const MANY_OPTIONS = 60;

export interface FieldOptions {
  disabled?: boolean;
  testId?: string;
  placeholder?: string;
  /** Suggestions; anything else may be typed too. */
  suggestions?: string[];
  multiline?: boolean;
}

/** A label and its control, for a `.fields` grid. */
export function field(label: string, control: HTMLElement): HTMLElement[] {
  const id = control.id || `field-${serial++}`;
  control.id = id;
  control.dataset.focus ??= label;
  return [h("label", { for: id }, label), control];
}

export function textInput(label: string, value: string, commit: (value: string) => void, options: FieldOptions = {}): HTMLElement {
  const attributes = {
    value, placeholder: options.placeholder ?? null, disabled: options.disabled ?? false, "data-testid": options.testId ?? null,
    "data-focus": label, "aria-label": label, autocomplete: "off", spellcheck: "false", maxlength: 10000,
  };
  if (options.multiline) {
    const area = h("textarea.input", { ...attributes, rows: 3 }, value);
    area.addEventListener("change", () => area.value !== value && commit(area.value));
    area.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) area.blur();
      else cancelOnEscape(event, area, value);
    });
    return area;
  }
  const input = h("input.input", { type: "text", ...attributes });
  commitOnEnter(input, value, commit);
  if (!options.suggestions || options.suggestions.length === 0) return input;
  const list = h("datalist", { id: `list-${serial++}` }, options.suggestions.map((s) => h("option", { value: s })));
  input.setAttribute("list", list.id);
  if (!options.disabled) offerAll(input);
  return h("div.row", { "data-focus": `${label} row` }, input, list);
}

/** A combo box as field: its label belongs to the input inside. */
export function textField(label: string, value: string, commit: (value: string) => void, options: FieldOptions = {}): HTMLElement[] {
  const control = textInput(label, value, commit, options);
  const input = control instanceof HTMLDivElement ? (control.firstElementChild as HTMLElement) : control;
  input.id = `field-${serial++}`;
  input.removeAttribute("aria-label");
  return [h("label", { for: input.id }, label), control];
}

function commitOnEnter(input: HTMLInputElement, value: string, commit: (value: string) => void): void {
  input.addEventListener("change", () => input.value !== value && commit(input.value));
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") input.blur();
    else cancelOnEscape(event, input, value);
  });
}

/** Browsers list only the suggestions that match what the field holds, so it shows nothing while it has the focus; Backspace means nothing. */
export function offerAll(input: HTMLInputElement): void {
  let [held, meant] = ["", false];
  const restore = (): void => {
    if (input.value === "" && !meant) input.value = held;
  };
  input.addEventListener("focus", () => {
    [held, meant] = [input.value, false];
    [input.placeholder, input.value] = [held || input.placeholder, ""];
  });
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") restore();
    if (event.key !== "Backspace" && event.key !== "Delete") return;
    meant = true;
    input.placeholder = "";
  }, { capture: true });
  input.addEventListener("blur", () => {
    restore();
    if (meant && input.value === "" && held !== "") input.dispatchEvent(new Event("change"));
  });
}

function cancelOnEscape(event: KeyboardEvent, input: HTMLInputElement | HTMLTextAreaElement, value: string): void {
  if (event.key !== "Escape") return;
  input.value = value;
  input.blur();
}

export function numberInput(label: string, value: number | null, commit: (value: number | null) => void, options: FieldOptions & { min?: number; max?: number } = {}): HTMLInputElement {
  const text = value === null ? "" : String(value);
  const input = h("input.input.frame", {
    type: "number", step: 1, value: text, min: options.min ?? 0, max: options.max ?? null, disabled: options.disabled ?? false,
    placeholder: options.placeholder ?? null, "data-testid": options.testId ?? null, "data-focus": label, "aria-label": label,
  });
  commitOnEnter(input, text, (given) => {
    if (given === "") commit(null);
    else if (Number.isFinite(input.valueAsNumber)) commit(Math.round(input.valueAsNumber));
  });
  return input;
}

export function choice(label: string, value: string, options: (string | [string, string])[], commit: (value: string) => void, more: FieldOptions = {}): HTMLSelectElement {
  const pairs = options.map((o) => (typeof o === "string" ? ([o, o] as const) : o));
  if (!pairs.some(([v]) => v === value)) pairs.unshift([value, value]);
  // Hundreds of options in every field would make each selection slow: they come when somebody is about to choose.
  const late = pairs.length > MANY_OPTIONS;
  const option = ([v, text]: readonly [string, string]): HTMLElement => h("option", { value: v, selected: v === value }, text);
  const select = h("select.input", { disabled: more.disabled ?? false, "data-testid": more.testId ?? null, "data-focus": label, "aria-label": label },
    (late ? pairs.filter(([v]) => v === value) : pairs).map(option));
  if (late) {
    const complete = (): void => {
      if (select.children.length < pairs.length) select.replaceChildren(...pairs.map(option));
    };
    for (const name of ["pointerdown", "focus"]) select.addEventListener(name, complete, { once: true });
  }
  select.addEventListener("change", () => commit(select.value));
  return select;
}

export function check(label: string, value: boolean, commit: (value: boolean) => void, options: FieldOptions = {}): HTMLElement {
  const input = h("input", { type: "checkbox", checked: value, disabled: options.disabled ?? false, "data-testid": options.testId ?? null, "data-focus": label });
  input.addEventListener("change", () => commit(input.checked));
  return h("label.check", null, input, label);
}

export function section(title: string, tools: (HTMLElement | null)[], ...rows: (HTMLElement | HTMLElement[] | null | false)[]): HTMLElement {
  return h("section.section", { "aria-label": title }, h("h3", null, title, h("span.spacer"), ...tools), ...rows);
}

/** Free keys and values. */
export function propertyRows(properties: Property[], set: (name: string, value: string | null) => void, disabled: boolean): HTMLElement[] {
  const rows = properties.map((p) => h("div.row", null,
    h("span.label", { title: p.name }, p.name),
    textInput(`Property ${p.name}`, p.value, (value) => set(p.name, value), { disabled }),
    iconButton("close", `Remove the property ${p.name}`, () => set(p.name, null), { disabled })));
  if (disabled) return rows;
  const name = h("input.input", { type: "text", placeholder: "name", "aria-label": "Name of a new property", "data-focus": "new property", maxlength: 64, "data-testid": "property-name" });
  const value = h("input.input", { type: "text", placeholder: "value", "aria-label": "Value of the new property", "data-focus": "new value", maxlength: 10000, "data-testid": "property-value" });
  const add = (): void => {
    if (name.value.trim() === "") return;
    set(name.value.trim(), value.value);
    name.value = "";
    value.value = "";
  };
  for (const input of [name, value]) {
    input.addEventListener("keydown", (event) => {
      if (event.key === "Enter") add();
    });
  }
  return [...rows, h("div.row", null, name, value, iconButton("plus", "Add the property", add, { "data-testid": "property-add" }))];
}
