// Bones of the Kinect v2's 25 joints; of a body with other joints, those are drawn whose two ends it has.

const CHAINS = [
  "SpineBase SpineMid SpineShoulder Neck Head",
  "SpineShoulder ShoulderLeft ElbowLeft WristLeft HandLeft HandTipLeft",
  "SpineShoulder ShoulderRight ElbowRight WristRight HandRight HandTipRight",
  "WristLeft ThumbLeft",
  "WristRight ThumbRight",
  "SpineBase HipLeft KneeLeft AnkleLeft FootLeft",
  "SpineBase HipRight KneeRight AnkleRight FootRight",
];

export const BONES: readonly (readonly [string, string])[] = CHAINS.flatMap((chain) => {
  const joints = chain.split(" ");
  return joints.slice(1).map((joint, i) => [joints[i]!, joint] as const);
});
