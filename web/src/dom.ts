// Small helpers for building the page: elements without markup in strings, so that no text of a person becomes HTML.

type Child = Node | string | null | undefined | false;
type Attributes = Record<string, string | number | boolean | null | undefined | ((event: never) => void)>;

/** `h("button.primary", { onclick, "aria-label": "Save" }, "Save")`; attributes that are false or null are left out. */
export function h<K extends keyof HTMLElementTagNameMap>(
  spec: K | `${K}.${string}`, attributes?: Attributes | null, ...children: (Child | Child[])[]
): HTMLElementTagNameMap[K] {
  const [tag, ...classes] = spec.split(".");
  const element = document.createElement(tag as K);
  if (classes.length > 0) element.className = classes.join(" ");
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value as EventListener);
    // Through the object model: the Content-Security-Policy forbids style attributes.
    else if (name === "style") element.style.cssText = String(value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
  append(element, children);
  return element;
}

function append(element: Element, children: (Child | Child[])[]): void {
  for (const child of children.flat()) if (child !== null && child !== undefined && child !== false) element.append(child);
}

/** Replaces the children, keeping the keyboard focus on the control with the same `data-focus`. */
export function fill(host: Element, ...children: (Child | Child[])[]): void {
  const focused = document.activeElement;
  const key = focused instanceof HTMLElement && host.contains(focused) ? focused.dataset.focus : undefined;
  const range = focused instanceof HTMLInputElement && focused.type === "text" ? [focused.selectionStart, focused.selectionEnd] : null;
  const scroll = host.scrollTop;
  host.replaceChildren();
  append(host, children);
  host.scrollTop = scroll;
  if (key === undefined) return;
  const again = host.querySelector<HTMLElement>(`[data-focus="${CSS.escape(key)}"]`);
  again?.focus({ preventScroll: true });
  if (again instanceof HTMLInputElement && again.type === "text" && range !== null) again.setSelectionRange(range[0] ?? 0, range[1] ?? 0);
}

const SVG = "http://www.w3.org/2000/svg";

const ICONS = {
  undo: "M4 6h6a3.5 3.5 0 0 1 0 7H6M4 6l3-3M4 6l3 3",
  redo: "M12 6H6a3.5 3.5 0 0 0 0 7h4M12 6 9 3M12 6 9 9",
  close: "M4 4l8 8M12 4l-8 8",
  plus: "M8 3v10M3 8h10",
  help: "M6 6a2 2 0 1 1 3 1.8c-.7.4-1 .8-1 1.7M8 12v.4",
  history: "M3 8a5 5 0 1 1 1.6 3.6M3 12V8.6h3.4M8 5.5V8l2 1.5",
  layers: "M8 2.5 14 6 8 9.5 2 6zM2.5 9 8 12.2 13.5 9",
  theme: "M8 2.5a5.5 5.5 0 1 0 0 11zM8 2.5v11a5.5 5.5 0 0 0 0-11",
  refresh: "M12.5 8a4.5 4.5 0 1 1-1.4-3.2M12.6 2.4v2.8H9.8",
  back: "M10 3 5 8l5 5",
  trash: "M3 4.5h10M6 4.5V3h4v1.5M4.5 4.5l.6 8.5h5.8l.6-8.5",
  check: "M3 8.5 6.5 12 13 4.5",
  jump: "M3 8h9M9 4.5 12.5 8 9 11.5",
  more: "M3.5 8h.1M8 8h.1M12.5 8h.1",
} as const;

export type Icon = keyof typeof ICONS;

export function icon(name: Icon): SVGSVGElement {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

/** A square button with an icon; its name is its label and its tooltip. */
export function iconButton(name: Icon, label: string, onclick: () => void, attributes: Attributes = {}): HTMLButtonElement {
  return h("button.icon-button", { type: "button", "aria-label": label, title: label, onclick, ...attributes }, icon(name));
}

/** Whether keys typed now belong to a control that takes text. */
export function isTyping(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement) return true;
  return target instanceof HTMLInputElement && !["checkbox", "radio", "button", "range", "color", "submit"].includes(target.type);
}

export function clock(seconds: number | null): string {
  if (seconds === null || !Number.isFinite(seconds)) return "–";
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${(seconds - 60 * minutes).toFixed(2).padStart(5, "0")}`;
}
