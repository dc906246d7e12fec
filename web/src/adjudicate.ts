// Comparing two annotators and building a third layer of what holds: the gold layer.
// Taking over is the same operation that accepts a proposal of the machine, so the gold layer itself keeps the decisions.

import { attempt } from "./actions";
import { fill, h } from "./dom";
import { choice, field } from "./inspector/fields";
import { swatch } from "./scheme";
import { type App, MACHINE, type Selected } from "./state";
import type { Agreement, AgreementFigures, Disagreement, Operation } from "./types";

type Verdict = "first" | "second" | "both" | "neither";

const LABELS: [Verdict, string, string][] = [["first", "Take A", "1"], ["second", "Take B", "2"], ["both", "Both", "3"], ["neither", "Neither", "4"]];

export function createAdjudicate(host: HTMLElement, app: App): { destroy(): void } {
  const names = (app.session?.layers ?? []).map((l) => l.name).filter((n) => n !== MACHINE);
  const given = new URLSearchParams(location.hash.split("?")[1] ?? "");
  const people = names.filter((n) => n !== "gold");
  const chosen = { first: given.get("first") ?? people[0] ?? "", second: given.get("second") ?? people[1] ?? "", gold: given.get("gold") ?? "gold" };
  const panel = h("div.panel", { "data-testid": "adjudicate" });
  let agreement: Agreement | null = null;
  let at = 0;
  // What has been looked at here; the verdicts themselves are in the gold layer.
  const seenKey = (): string => `ecat.adjudicated.${app.session?.id ?? ""}.${chosen.first}.${chosen.second}.${chosen.gold}`;
  let seen = new Set<string>();

  let comparisons = 0;
  const compare = async (): Promise<void> => {
    const sid = app.session?.id;
    const turn = ++comparisons;
    // What differs between two other layers must not be decided about as if it were of these.
    agreement = null;
    show();
    if (sid === undefined || chosen.first === chosen.second) return;
    try {
      // Layers are compared as they were last saved.
      await Promise.all([chosen.first, chosen.second].map((name) => app.api.save(sid, name)));
      const found = await app.api.agreement(sid, [chosen.first, chosen.second]);
      await app.setActiveLayer(chosen.gold, false);
      await app.setShown([chosen.gold, chosen.first, chosen.second]);
      if (turn !== comparisons) return;
      agreement = found;
      seen = new Set(JSON.parse(localStorage.getItem(seenKey()) ?? "[]") as string[]);
      at = Math.max(0, agreement.disagreements.findIndex(isOpen));
      jump();
    } catch (error) {
      app.fail(error);
    }
    if (turn === comparisons) show();
  };

  const isOpen = (d: Disagreement): boolean => !seen.has(keyOf(d));
  const decided = (d: Disagreement): boolean => state(app, d, chosen, false) !== "open";

  const jump = (): void => {
    const one = agreement?.disagreements[at];
    if (one === undefined) return;
    app.seek(one.start_frame);
    const selected: Selected[] = [];
    for (const id of idsOf(one, one.first)) selected.push({ kind: one.kind, id, layer: chosen.first });
    for (const id of idsOf(one, one.second)) selected.push({ kind: one.kind, id, layer: chosen.second });
    app.select(selected);
  };

  const take = async (verdict: Verdict): Promise<void> => {
    const one = agreement?.disagreements[at];
    if (one === undefined || agreement === null) return;
    const wanted: [boolean, boolean] = [verdict === "first" || verdict === "both", verdict === "second" || verdict === "both"];
    const operations = one.kind === "object" ? decideObject(app, one, chosen, wanted) : [
      ...decide(app, one, chosen.first, one.first, wanted[0]),
      ...decide(app, one, chosen.second, one.second, wanted[1]),
    ];
    const before = agreement.disagreements.filter(decided);
    if (operations.length > 0 && (await attempt(app, operations)) === null) return;
    // What was decided about an event holds for its parts.
    for (const d of [one, ...agreement.disagreements.filter((d) => decided(d) && !before.includes(d))]) seen.add(keyOf(d));
    localStorage.setItem(seenKey(), JSON.stringify([...seen]));
    const next = agreement.disagreements.findIndex((d, i) => i > at && isOpen(d));
    at = next >= 0 ? next : at;
    jump();
    show();
  };

  const takeAgreed = async (): Promise<void> => {
    const layer = app.layers.get(chosen.first);
    if (layer === undefined || agreement === null) return;
    const operations = agreed(app, chosen, agreement);
    if (operations.length === 0) return app.notify("Nothing is left to take over: sub-events come with their events.");
    if ((await attempt(app, operations)) !== null) app.notify(`${operations.length} ${operations.length === 1 ? "thing that both agree on was" : "things that both agree on were"} taken over.`);
    show();
  };

  const show = (): void => {
    const row = (label: string, key: "first" | "second"): HTMLElement[] => field(label, choice(label, chosen[key], people, (value) => {
      chosen[key] = value;
      void compare();
    }, { testId: `adjudicate-${key}` }));
    fill(panel,
      h("div.headline", null, h("strong", null, "Compare two layers"), h("span.spacer"), h("a.button.adjudicate-link", { href: `#/session/${encodeURIComponent(app.session?.id ?? "")}` }, "Done")),
      people.length < 2 ? h("p.hint", null, "Comparing needs the layers of two annotators; this session has fewer.") : null,
      h("div.fields", null, row("Layer A", "first"), row("Layer B", "second"), h("span.label", null, "Builds"), h("span.mono", null, chosen.gold)),
      agreement === null ? null : figures(agreement.figures),
      agreement === null ? null : h("div.actions", null, h("button.button", { type: "button", onclick: () => void takeAgreed(), "data-testid": "take-agreed" }, "Take what both agree on")),
      agreement === null ? null : list(agreement, at));
  };

  const list = (found: Agreement, current: number): HTMLElement => {
    const open = found.disagreements.filter(isOpen).length;
    const one = found.disagreements[current];
    return h("div.section", null,
      h("h3", null, `${found.disagreements.length} disagreements, ${open} open`),
      one === undefined ? h("p.empty", null, "They agree in everything.") : h("div.hint", null, h("div", null, h("strong", null, `${one.label || one.kind} `), differences(one, chosen)), looks(app, one, chosen),
        h("div.actions", null, LABELS.map(([verdict, label, key]) => h("button.button", {
          type: "button", title: `${label} (${key})`, "data-testid": `take-${verdict}`,
          disabled: (verdict === "first" && one.first === null) || (verdict === "second" && one.second === null) || (verdict === "both" && (one.first === null || one.second === null)),
          onclick: () => void take(verdict),
        }, label)))),
      h("div", { role: found.disagreements.length > 0 ? "listbox" : null, "aria-label": found.disagreements.length > 0 ? "Disagreements" : null }, found.disagreements.slice(0, 500).map((d, i) => h("div.list-row.history-row", {
        role: "option", "aria-selected": String(i === current), "data-testid": `disagreement-${i}`,
        onclick: () => {
          at = i;
          jump();
          show();
        },
      }, h("span.grow", null, `${d.label || d.kind} ${differences(d, chosen)}`), h("span.at", null, `${d.start_frame}–${d.end_frame}`),
      h("span.chip", { class: isOpen(d) ? "chip" : "chip good" }, state(app, d, chosen, seen.has(keyOf(d))))))));
  };

  const onKey = (event: KeyboardEvent): void => {
    const key = LABELS.find(([, , k]) => k === event.key);
    if (key === undefined || event.ctrlKey || event.altKey || event.metaKey || document.querySelector("dialog[open]") !== null) return;
    if (event.target instanceof Element && event.target.closest("input, textarea, select") !== null) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    panel.querySelector<HTMLButtonElement>(`[data-testid="take-${key[0]}"]`)?.click();
  };
  // Before the keys of the coding scheme, which has digits too.
  window.addEventListener("keydown", onKey, true);
  fill(host, panel);
  void compare();
  return { destroy: () => window.removeEventListener("keydown", onKey, true) };
}

/** A fact may be stated by several relations. */
function idsOf(d: Pick<Disagreement, "kind">, id: string | null): string[] {
  return id === null ? [] : d.kind === "relation" ? id.split(" ") : [id];
}

function keyOf(d: Disagreement): string {
  return `${d.kind} ${d.first ?? ""} ${d.second ?? ""}`;
}

function differences(d: Disagreement, chosen: { first: string; second: string }): string {
  if (d.first === null) return `only in ${chosen.second}`;
  if (d.second === null) return `only in ${chosen.first}`;
  return `differs in ${d.differs.join(", ")}`;
}

function state(app: App, d: Disagreement, chosen: { first: string; second: string }, seen: boolean): string {
  const verdicts = (layer: string, id: string | null): (string | undefined)[] => idsOf(d, id).map((one) => app.document.decisions.get(`${layer}/${one}`)?.verdict);
  const [first, second] = [verdicts(chosen.first, d.first), verdicts(chosen.second, d.second)];
  const taken = [first.includes("accepted") ? "A" : "", second.includes("accepted") ? "B" : ""].filter(Boolean).join(" + ");
  return taken || (seen || [...first, ...second].includes("rejected") ? "neither" : "open");
}

/** How each of the two has an object. */
function looks(app: App, d: Disagreement, chosen: { first: string; second: string }): HTMLElement | null {
  if (d.kind !== "object") return null;
  const look = (letter: string, layer: string, id: string | null): HTMLElement | null => {
    const thing = id === null ? undefined : app.layers.get(layer)?.document.object(id);
    if (thing === undefined) return null;
    const keys = thing.key_frames.length;
    return h("div.row", null, h("span.muted", null, `${letter} ${layer}`), swatch(thing.color), h("span", null, thing.name || thing.id),
      h("span.muted", null, [thing.kind.replaceAll("_", " "), thing.semantic_type, keys > 0 ? `${keys} key ${keys === 1 ? "frame" : "frames"}` : ""].filter(Boolean).join(", ")));
  };
  return h("div", null, look("A", chosen.first, d.first), look("B", chosen.second, d.second));
}

/**
 * One object for both views of it, which looks as the one that is taken and is named by whatever is taken over of either
 * layer; or two objects; or none.
 */
function decideObject(app: App, d: Disagreement, chosen: { first: string; second: string }, wanted: [boolean, boolean]): Operation[] {
  const views = [d.first === null ? null : `${chosen.first}/${d.first}`, d.second === null ? null : `${chosen.second}/${d.second}`] as const;
  const operations: Operation[] = [];
  for (const side of [0, 1] as const) {
    const [proposal, other] = [views[side], views[side === 0 ? 1 : 0]];
    if (proposal === null) continue;
    const now = app.document.decisions.get(proposal);
    const takesOther = wanted[side === 0 ? 1 : 0] && other !== null;
    if (wanted[side]) {
      if (now?.verdict === "accepted") continue;
      operations.push({ op: "accept_proposal", proposal, ...(takesOther || other === null ? {} : { same_as: other }) });
    } else if (now?.verdict === "accepted" && !(takesOther && app.document.decisions.get(other)?.verdict !== "accepted")) {
      // its view is not wanted any more, and no other one takes its place
      if (app.document.object(now.result) !== undefined) operations.unshift({ op: "remove_object", id: now.result });
      operations.push({ op: "reject_proposal", proposal });
    } else if (!takesOther && now?.verdict !== "accepted") operations.push({ op: "reject_proposal", proposal });
  }
  return operations;
}

/** What makes the gold layer contain, or not contain, an element of another layer. */
function decide(app: App, d: Disagreement, layer: string, ids: string | null, wanted: boolean): Operation[] {
  return idsOf(d, ids).flatMap((id) => decideOne(app, d, layer, id, wanted));
}

function decideOne(app: App, d: Disagreement, layer: string, id: string, wanted: boolean): Operation[] {
  const proposal = `${layer}/${id}`;
  const now = app.document.decisions.get(proposal);
  if (wanted) return now?.verdict === "accepted" ? [] : [{ op: "accept_proposal", proposal }];
  if (now?.verdict === "rejected") return [];
  const there = now?.verdict === "accepted" && app.document[d.kind === "event" ? "events" : "relations"].get(now.result) !== undefined;
  return [...(there ? [{ op: `remove_${d.kind}`, id: now.result }] : []), { op: "reject_proposal", proposal }];
}

/** Takes over whatever of the first layer nobody disputes; sub-events come with their events, also when those are disputed. */
function agreed(app: App, chosen: { first: string; second: string }, { disagreements, objects }: Agreement): Operation[] {
  const layer = chosen.first;
  const source = app.layers.get(layer)?.document;
  if (source === undefined) return [];
  const disputed = new Set(disagreements.flatMap((d) => idsOf(d, d.first).map((id) => `${d.kind} ${id}`)));
  const open = (kind: string, id: string): boolean => !disputed.has(`${kind} ${id}`) && app.document.decisions.get(`${layer}/${id}`) === undefined;
  const events = source.events.list.filter((e) => open("event", e.id) && e.parent === null);
  const relations = source.relations.list.filter((r) => open("relation", r.id));
  // first of all the objects, so that what either layer says of them is said of one
  const things = objects.filter(([a, b]) => open("object", a) && app.document.decisions.get(`${chosen.second}/${b}`) === undefined);
  return [
    ...things.map(([a, b]) => ({ op: "accept_proposal", proposal: `${layer}/${a}`, same_as: `${chosen.second}/${b}` })),
    ...[...events, ...relations].map((e) => ({ op: "accept_proposal", proposal: `${layer}/${e.id}` })),
  ];
}

function figures(agreement: AgreementFigures): HTMLElement {
  const number = (value: number | null | undefined): string => (value === null || value === undefined ? "–" : value.toFixed(2));
  const f1 = agreement.events.filter((e) => Math.abs(e.least_iou - 0.5) < 1e-6 && e.of !== "type");
  return h("table", null,
    h("thead", null, h("tr", null, h("th", null, "Tier"), h("th.number", { title: "Cohen's kappa of the labels by frame" }, "κ"), h("th.number", { title: "Krippendorff's alpha of the labels by frame" }, "α"), h("th.number", { title: "F1 of events that overlap by half" }, "F1"))),
    h("tbody", null, Object.entries(agreement.tiers).map(([tier, of]) => h("tr", null, h("td", null, tier || "(none)"), h("td.number", null, number(of.cohen_kappa)),
      h("td.number", null, number(of.krippendorff_alpha)), h("td.number", null, number(f1.find((e) => e.name === tier)?.f1))))));
}
