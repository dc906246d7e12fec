// Which joints are joined: as the server says it of the bodies that were recorded.

import type { App } from "./state";

export function bonesOf(app: App): readonly (readonly [string, string])[] {
  const found = new Map<string, [string, string]>();
  for (const body of app.session?.bodies ?? []) for (const bone of body.bones) found.set(bone.join(" "), bone);
  return [...found.values()];
}
