// Depth in colours, and the millimetres under the pointer.

import "./stage.css";
import { h } from "./dom";
import { imageSize } from "./player";
import { Pane } from "./player/pane";
import { playbackOf } from "./player/playback";
import { DepthProbe } from "./player/probe";
import type { App } from "./state";

/** Millimetres below a metre, else metres. */
export function distance(metres: number): string {
  return metres < 0.9995 ? `${Math.round(1000 * metres)} mm` : `${metres.toFixed(2)} m`;
}

export function createDepth(host: HTMLElement, app: App): { destroy(): void } {
  const stream = app.session?.streams.find((s) => s.kind === "depth" && s.present);
  if (stream === undefined) return { destroy: () => undefined };
  const pane = new Pane(app, stream, imageSize(stream));
  const [near, middle, far] = [h("span", null, "near"), h("span"), h("span", null, "far")];
  const legend = h("div.depth-legend", { "data-testid": "depth-legend", role: "group", "aria-label": "Distances of the colours" }, near,
    h("span.depth-scale", null, h("span.depth-ramp", { "aria-hidden": "true" }), middle), far, h("span.depth-none", { "aria-hidden": "true" }), h("span", null, "none"));
  app.api.depthRange(app.session?.id ?? "", stream.name).then(({ near_m, far_m }) => {
    [near.textContent, middle.textContent, far.textContent] = [near_m, (near_m + far_m) / 2, far_m].map(distance) as [string, string, string];
    legend.title = `${Math.round(1000 * near_m)} mm to ${Math.round(1000 * far_m)} mm; what is nearer or farther has the colour of the end`;
  }).catch(() => undefined);
  const usual = "Point at a pixel to read its depth.";
  const readout = h("p.depth-readout", { "data-testid": "depth-readout", "aria-live": "polite" }, usual);
  const probe = new DepthProbe(app, pane, (text) => (readout.textContent = text || usual));
  pane.element.addEventListener("pointerdown", (event) => event.button === 0 && pane.dragView(event));
  pane.element.addEventListener("dblclick", () => pane.fit());
  host.append(h("div.depth", null, h("div.depth-head", null, h("h2.stage-title", null, "Depth"), legend), pane.element, readout));
  const playback = playbackOf(app);
  playback.add(pane);
  return {
    destroy() {
      probe.destroy();
      playback.remove(pane);
      pane.destroy();
      host.replaceChildren();
    },
  };
}
