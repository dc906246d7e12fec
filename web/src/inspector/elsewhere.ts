// Objects of other sessions, as arguments of a relation.

import { fill, h } from "../dom";
import type { App } from "../state";

/** Offers the objects of another session; `choose` gets `<session>/<object>`, as annotations write it. */
export function elsewhere(app: App, choose: (target: string, label: string) => void): HTMLElement {
  const session = h("select.input", { "aria-label": "Another session", "data-testid": "elsewhere-session", "data-focus": "elsewhere session" });
  const object = h("select.input", { "aria-label": "An object of the other session", "data-testid": "elsewhere-object", "data-focus": "elsewhere object" });
  const details = h("details.section", { "data-testid": "elsewhere" }, h("summary", null, "With an object of another session"), h("div.row", null, session, object));
  const sid = app.session?.id ?? "";
  const loadObjects = (): void => {
    object.disabled = true;
    const { value } = session;
    app.api.otherObjects(sid, value, app.activeLayer).then(({ objects }) => {
      // another one was chosen meanwhile: ids mean other things there
      if (session.value !== value) return;
      fill(object, h("option", { value: "" }, objects.length === 0 ? "it has none" : "choose…"), objects.map((o) => h("option", { value: o.id }, o.name || o.id)));
      object.disabled = objects.length === 0;
    }).catch((error: unknown) => app.fail(error));
  };
  let asked = false;
  details.addEventListener("toggle", () => {
    if (!details.open || asked) return;
    asked = true;
    app.api.others(sid).then((known) => {
      fill(session, known.length === 0 ? h("option", null, "there is none") : known.map((n) => h("option", { value: n.name }, n.name)));
      session.disabled = object.disabled = known.length === 0;
      if (known.length > 0) loadObjects();
    }).catch((error: unknown) => app.fail(error));
  });
  session.addEventListener("change", loadObjects);
  object.addEventListener("change", () => {
    if (object.value !== "") choose(`${session.value}/${object.value}`, `${object.selectedOptions[0]?.textContent ?? object.value} of ${session.value}`);
  });
  return details;
}
