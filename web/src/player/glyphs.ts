// Signs on the stage's buttons.

const SVG = "http://www.w3.org/2000/svg";

const PATHS = {
  play: "M4.5 2.8v10.4L13 8z",
  pause: "M4.5 3h2.6v10H4.5zM8.9 3h2.6v10H8.9z",
  first: "M3.5 3v10M12.5 3.5 6 8l6.5 4.5z",
  back: "M11 3.5 4.5 8 11 12.5z",
  forward: "M5 3.5 11.5 8 5 12.5z",
  loop: "M4 10V8a3 3 0 0 1 3-3h5M9.8 2.8 12 5 9.8 7.2M12 8v0a3 3 0 0 1-3 3H4M6.2 13.2 4 11l2.2-2.2",
  fit: "M3 6V3h3M10 3h3v3M13 10v3h-3M6 13H3v-3",
  select: "M4 2.5l8.2 5.6-3.6.7 2 4-1.6.8-2-4L4.4 12z",
  rectangle: "M2.5 4h11v8h-11z",
  polygon: "M8 2.5 13.5 7l-2.2 6H4.7L2.5 7z",
  point: "M8 2v4M8 10v4M2 8h4M10 8h4",
  split: "M2.5 3h5v10h-5zM9 3h4.5v10H9z",
  check: "M3 8.5 6.5 12 13 4.5",
  cross: "M4 4l8 8M12 4l-8 8",
} as const;

export type Glyph = keyof typeof PATHS;

const FILLED: ReadonlySet<Glyph> = new Set(["play", "pause", "first", "back", "forward"]);

export function glyph(name: Glyph): SVGSVGElement {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("class", FILLED.has(name) ? "glyph filled" : "glyph");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  return svg;
}
