// What the machine proposes, as it is listed: who proposed it, how sure it was, and in which order one goes through it.

import { span } from "./document";
import type { App, Selected } from "./state";
import type { EcatEvent, Relation } from "./types";

export type Proposal = EcatEvent | Relation;

/** How proposals can be ordered, and what each order is called. */
export const ORDERS = { time: "In order of time", surest: "Surest first", doubtful: "Least sure first" } as const;
export type Order = keyof typeof ORDERS;

/** How sure the machine was, 0 to 1; null where it did not say. */
export function confidence(proposal: Proposal): number | null {
  const said = "properties" in proposal ? proposal.properties.find((p) => p.name === "confidence")?.value : undefined;
  const value = Number(said || Number.NaN);
  return Number.isFinite(value) ? value : null;
}

/** Where a proposal comes from, in words. */
export function origin(proposal: Proposal): string {
  const sure = confidence(proposal);
  return [sure === null ? "" : `confidence ${sure.toFixed(2)}`, proposal.author].filter(Boolean).join(" · ");
}

/** The proposed event that this one is a part of, and comes with once that is accepted; null where it is accepted on its own. */
export function openWhole(app: Pick<App, "machine" | "decided">, id: string): EcatEvent | null {
  const parent = app.machine?.event(id)?.parent ?? null;
  return parent === null || app.decided(parent) === "accepted" ? null : (app.machine?.event(parent) ?? null);
}

/** What one goes to from a decision about `from`: what that is a part of, or else the next in order, or the last before. */
export function neighbour(app: Pick<App, "machine" | "decided" | "openProposals" | "settings">, from: Selected): Selected | null {
  const whole = openWhole(app, from.id);
  if (whole !== null) return { kind: "event", id: whole.id, layer: from.layer };
  const open = app.openProposals();
  const listed: readonly Proposal[] = from.kind === "event" ? open.events : open.relations;
  const own = listed.some((e) => e.id === from.id) ? undefined : app.machine?.event(from.id);
  const ordered = inOrder(own === undefined ? listed : [...listed, own], app.settings.order);
  const at = ordered.findIndex((e) => e.id === from.id);
  const next = ordered[at + 1] ?? ordered[at - 1];
  return next === undefined ? null : { kind: from.kind, id: next.id, layer: from.layer };
}

/** In the order that the person chose; equally sure ones in time, those without a confidence last. */
export function inOrder<T extends Proposal>(proposals: readonly T[], order: Order): T[] {
  const start = (p: T): number => ("segments" in p ? span(p)[0] : p.start_frame);
  const sign = { time: 0, surest: -1, doubtful: 1 }[order];
  const rank = (p: T): number => (sign === 0 ? 0 : (sign * (confidence(p) ?? Number.NaN)));
  const last = (value: number): number => (Number.isNaN(value) ? 2 : value);
  return [...proposals].sort((a, b) => last(rank(a)) - last(rank(b)) || start(a) - start(b));
}

/** "2 events and 1 relation": what there is to decide about. */
export function tally({ events, relations }: ReturnType<App["openProposals"]>): string {
  const some = (n: number, what: string): string => (n === 0 ? "" : `${n} ${what}${n === 1 ? "" : "s"}`);
  return [some(events.length, "event"), some(relations.length, "relation")].filter(Boolean).join(" and ");
}
