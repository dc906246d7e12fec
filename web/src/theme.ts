// Colours for what is painted rather than styled: the style sheet's, so that both change together.

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

/** Called when the page turns light or dark, whoever turned it. */
export function onTheme(listener: () => void): () => void {
  if (listeners.size === 0) {
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
    new MutationObserver(changed).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  }
  listeners.add(listener);
  return () => listeners.delete(listener);
}
