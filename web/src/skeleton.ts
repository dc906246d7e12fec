// The bones of the session's skeletons, as far as they are to be drawn.

import type { App } from "./state";

/** What ECAT called the upper body: torso and arms, without the legs. */
const LEGS = /^(Hip|Knee|Ankle|Foot)(Left|Right)$/;

export function bonesOf(app: App): readonly (readonly [string, string])[] {
  const found = new Map<string, [string, string]>();
  for (const body of app.session?.bodies ?? []) {
    for (const bone of body.bones) {
      if (app.settings.body === "whole" || !bone.some((joint) => LEGS.test(joint))) found.set(bone.join(" "), bone);
    }
  }
  return [...found.values()];
}
