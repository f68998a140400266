/** A rectangle of the picture in CSS pixels, origin at its top left. */
export interface Pane {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** One of the two pictures: where it lands, and what of a camera's whole view it shows. */
export interface PanePlan {
  /** Where it is drawn. */
  scissor: Pane;
  /** The rectangle that the camera's view fills; the scissor cuts from it. */
  viewport: Pane;
}

/**
 * Where both versions are drawn. Swiped, both fill the whole picture and the slider cuts between
 * them, so that a post of one continues in the other; side by side, each camera has its own half.
 */
export function planPanes(layout: 'swipe' | 'side', split: number, width: number, height: number): [PanePlan, PanePlan] {
  const cut = layout === 'side' ? Math.round(width / 2) : Math.round(Math.min(1, Math.max(0, split)) * width);
  const left: Pane = { x: 0, y: 0, width: cut, height };
  const right: Pane = { x: cut, y: 0, width: width - cut, height };
  if (layout === 'side') return [{ scissor: left, viewport: left }, { scissor: right, viewport: right }];
  const whole: Pane = { x: 0, y: 0, width, height };
  return [{ scissor: left, viewport: whole }, { scissor: right, viewport: whole }];
}
