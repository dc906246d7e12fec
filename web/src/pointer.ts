// A pointer that is held down: followed wherever it goes, until it is let go.

export function follow(element: HTMLElement, event: PointerEvent, move: (event: PointerEvent) => void, done?: () => void): void {
  element.setPointerCapture(event.pointerId);
  element.addEventListener("pointermove", move);
  element.addEventListener("lostpointercapture", () => {
    element.removeEventListener("pointermove", move);
    done?.();
  }, { once: true });
}

/** As `follow`, but given up with Escape. */
export function followOrCancel(element: HTMLElement, event: PointerEvent, move: (event: PointerEvent) => void, done: (cancelled: boolean) => void): void {
  let cancelled = false;
  const key = (pressed: KeyboardEvent) => {
    if (pressed.key !== "Escape") return;
    pressed.stopPropagation();
    cancelled = true;
    element.releasePointerCapture(event.pointerId);
  };
  window.addEventListener("keydown", key, true);
  follow(element, event, move, () => {
    window.removeEventListener("keydown", key, true);
    done(cancelled);
  });
}
