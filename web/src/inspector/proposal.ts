// A proposal of the machine: look, adjust, accept or reject.

import { acceptSelected, rejectSelected } from "../actions";
import { span } from "../document";
import { clock, h } from "../dom";
import { goTo } from "../navigate";
import { openWhole, origin } from "../proposals";
import type { App, LayerState } from "../state";
import type { EcatEvent, Relation } from "../types";
import { field, numberInput, textInput } from "./fields";
import { relationText } from "./relation";

export function proposalPanel(app: App, layer: LayerState, proposal: EcatEvent | Relation): HTMLElement[] {
  const isEvent = "segments" in proposal;
  const [start, end] = isEvent ? span(proposal) : [proposal.start_frame, proposal.end_frame];
  const verdict = app.decided(proposal.id);
  const whole = verdict === null ? openWhole(app, proposal.id) : null;
  const disabled = verdict !== null || whole !== null;
  const from = numberInput("Start", start, () => undefined, { max: app.nFrames, testId: "proposal-start", disabled });
  const to = numberInput("End", end, () => undefined, { max: app.nFrames, testId: "proposal-end", disabled, placeholder: "open" });
  const types = isEvent ? app.scheme.event_types : app.scheme.predicates;
  const type = textInput("Type", isEvent ? proposal.type : proposal.predicate, () => undefined, { suggestions: types.map((t) => t.name), testId: "proposal-type", disabled: disabled || !isEvent });
  const typed = type instanceof HTMLInputElement ? type : (type.querySelector("input") as HTMLInputElement);
  const adjusted = (): Parameters<typeof acceptSelected>[1] => ({
    ...(from.valueAsNumber !== start && Number.isFinite(from.valueAsNumber) ? { start_frame: from.valueAsNumber } : {}),
    ...(to.valueAsNumber !== end && Number.isFinite(to.valueAsNumber) ? { end_frame: to.valueAsNumber } : {}),
    ...(isEvent && typed.value !== proposal.type ? { type: typed.value } : {}),
  });
  const children = isEvent ? layer.document.children(proposal.id) : [];
  const roles = isEvent ? proposal.roles.map((r) => `${r.name}: ${layer.document.object(r.target)?.name || r.target}`) : [];
  return [
    h("div.headline", null, h("strong", null, isEvent ? proposal.type || "event" : relationText(proposal, layer)), h("span.mono.muted", null, proposal.id), h("span.spacer"),
      h(`span.chip.${verdict === null ? "warn" : verdict === "accepted" ? "good" : "bad"}`, { "data-testid": "proposal-state" }, verdict ?? "proposed")),
    isEvent && proposal.text !== "" ? h("p", { "data-testid": "proposal-text" }, proposal.text) : null,
    h("p.muted", { "data-testid": "proposal-origin" }, origin(proposal)),
    h("div.fields", null, field("Type", type), field("Start", from), field("End", to)),
    h("p.muted", null, `${clock(app.secondsOf(start))} – ${end === null ? "open" : clock(app.secondsOf(end))}`),
    roles.length > 0 ? h("p", null, roles.join(" · ")) : null,
    children.length > 0 ? h("div.section", null, h("h3", null, "Sub-events that come with it"), children.map((c) => h("div.row", null, h("span", null, c.type), h("span.spacer"), h("span.muted", null, span(c).join("–"))))) : null,
    whole === null ? null : h("p", { "data-testid": "proposal-whole" }, "A part of ",
      h("button.link-button", { type: "button", onclick: () => goTo(app, { kind: "event", id: whole.id, layer: layer.name }), "data-testid": "select-whole" }, `${whole.type || "the event"} (${whole.id})`),
      ", and comes with it when that is accepted, unless you reject it."),
    verdict !== null ? null : h("div.actions", null,
      whole !== null ? null : h("button.button.primary", { type: "button", onclick: () => void acceptSelected(app, adjusted()), title: "Accept (Enter)", "data-testid": "accept" }, "Accept"),
      h("button.button", { type: "button", onclick: () => void rejectSelected(app), title: "Reject (X)", "data-testid": "reject" }, "Reject")),
    !disabled ? h("p.hint", null, `Accepted, it is copied into the layer ${app.activeLayer}, with its sub-events, its roles and the objects that they need.`) : null,
  ].filter((e) => e !== null);
}
