// What the machine proposes, as it is listed: who proposed it, how sure it was, and in which order one goes through it.

import { span } from "./document";
import type { App } from "./state";
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
