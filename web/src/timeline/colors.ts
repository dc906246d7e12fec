// Colours of what has none of its own: amber and grey are missing, they mean `lifted` and `not observed` elsewhere.

import type { App } from "../state";

const PALETTE = ["#4dabf7", "#f778ba", "#69db7c", "#b197fc", "#ff6b6b", "#38d9c8", "#c0d94a", "#8caaff", "#e599f7", "#63c5da"];

/** The same name has the same colour in every session. */
export function colorOf(name: string): string {
  let hash = 2166136261;
  for (let i = 0; i < name.length; i++) hash = Math.imul(hash ^ name.charCodeAt(i), 16777619) >>> 0;
  return PALETTE[hash % PALETTE.length]!;
}

export function nth(index: number): string {
  return PALETTE[index % PALETTE.length]!;
}

/** `#rrggbbaa` with another opacity. */
export function withAlpha(color: string, alpha: number): string {
  const hex = Math.round(Math.min(1, Math.max(0, alpha)) * 255).toString(16).padStart(2, "0");
  return /^#[0-9a-f]{6}/i.test(color) ? color.slice(0, 7) + hex : color;
}

/** Black or white, whichever is easier to read on the colour. */
export function inkOn(color: string): string {
  const [r, g, b] = [1, 3, 5].map((i) => Number.parseInt(color.slice(i, i + 2), 16) / 255) as [number, number, number];
  return 0.299 * r + 0.587 * g + 0.114 * b > 0.55 ? "#10151c" : "#ffffff";
}

/** The colour of an object that a table speaks of: the one given to it in a layer, else one of its own. */
export function objectColor(app: App, id: string): string {
  for (const { document } of app.shownLayers) {
    const color = document.object(id)?.color.slice(0, 7);
    // the defaults of the model and of the program of 2018 say nothing
    if (color && color !== "#ff0000" && color !== "#000000") return color;
  }
  return colorOf(id);
}
