// Light or dark, as somebody chose or as the system is; and the style sheet's colours for what is painted rather than styled.

import type { View } from "./view";

const NAMES = {
  surface: "--surface", raised: "--raised", line: "--line", strong: "--control-line", text: "--text", muted: "--muted",
  accent: "--accent", soft: "--accent-soft", good: "--good", warn: "--warn", bad: "--bad",
} as const;

export type Palette = Readonly<Record<keyof typeof NAMES | "font", string>>;

let known: Palette | null = null;
const listeners = new Set<() => void>();

export function palette(): Palette {
  if (known === null) {
    const style = getComputedStyle(document.documentElement);
    const read = Object.entries(NAMES).map(([name, token]) => [name, style.getPropertyValue(token).trim() || "#888888"]);
    known = { ...Object.fromEntries(read), font: style.getPropertyValue("--font").trim() || "sans-serif" } as Palette;
  }
  return known;
}

function changed(): void {
  known = null;
  for (const listener of listeners) listener();
}

const dark = typeof matchMedia === "undefined" ? null : matchMedia("(prefers-color-scheme: dark)");

/** Lets the page have the theme of the settings, now and whenever they or the system's change. */
export function keepTheme(app: View): void {
  const apply = (): void => {
    const { theme } = app.settings;
    const next = theme !== "system" ? theme : dark?.matches ? "dark" : "light";
    if (document.documentElement.dataset.theme === next) return;
    document.documentElement.dataset.theme = next;
    changed();
  };
  apply();
  app.on("settings", apply);
  dark?.addEventListener("change", apply);
}

/** Called when the page turns light or dark, whoever turned it. */
export function onTheme(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}
