// Depth in colours, and the millimetres under the pointer.

import "./stage.css";
import { h } from "./dom";
import { imageSize } from "./player";
import { Pane } from "./player/pane";
import { playbackOf } from "./player/playback";
import { DepthProbe } from "./player/probe";
import type { App } from "./state";

export function createDepth(host: HTMLElement, app: App): { destroy(): void } {
  const stream = app.session?.streams.find((s) => s.kind === "depth" && s.present);
  if (stream === undefined) return { destroy: () => undefined };
  const pane = new Pane(app, stream, imageSize(stream));
  const legend = h("div.depth-legend", { "aria-hidden": "true" }, h("span", null, "near"), h("span.depth-ramp"), h("span", null, "far"),
    h("span.depth-none"), h("span", null, "none"));
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
