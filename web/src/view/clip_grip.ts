import type { Box } from '../scene/clip_box.js';
import { canPull, handlesOf, pulled, type Handle } from '../scene/clip_handles.js';
import type { PointerPlace } from '../scene/pointers.js';
import type { Ray } from '../scene/pick.js';
import type { Scene } from '../scene/scene.js';
import { add } from '../scene/types.js';

/** Distance within which a press takes a handle [CSS px]. */
const kReachPx = 14;

/** Drags the clip box by its handles. */
export class ClipGrip {
  private held_: { readonly box: Box; readonly handle: Handle } | undefined;

  /** @param set called with the box while it is dragged. */
  constructor(private readonly scene_: Scene, private readonly set_: (box: Box) => void) {}

  /** @return true if there is a handle of the box, which is then dragged. */
  take(box: Box | undefined, place: PointerPlace): boolean {
    const handle = box && this.at(box, place);
    this.held_ = box !== undefined && handle !== undefined ? { box, handle } : undefined;
    return this.held_ !== undefined;
  }

  /** Drags the held handle, or shows by the cursor whether there is one. */
  move(box: Box | undefined, place: PointerPlace): void {
    if (this.held_ !== undefined) this.set_(pulled(this.held_.box, this.held_.handle, this.ray(place)));
    else this.scene_.canvas.style.cursor = box !== undefined && this.at(box, place) !== undefined ? 'move' : '';
  }

  release(): void {
    this.held_ = undefined;
  }

  /** Cancels the drag and restores the box. */
  cancel(): void {
    if (this.held_ !== undefined) this.set_(this.held_.box);
    this.held_ = undefined;
  }

  private at(box: Box, place: PointerPlace): Handle | undefined {
    const { left, top } = this.scene_.canvas.getBoundingClientRect();
    const { direction } = this.ray(place);
    const near = handlesOf(box).filter((handle) => canPull(handle, direction)).map((handle) => {
      const seen = this.scene_.project(handle.place);
      const px = seen === null ? Infinity : Math.hypot(seen.x + left - place.clientX, seen.y + top - place.clientY);
      return { handle, px };
    }).sort((a, b) => a.px - b.px)[0];
    return near !== undefined && near.px <= kReachPx ? near.handle : undefined;
  }

  /** In map coordinates, as the box. */
  private ray({ clientX, clientY }: PointerPlace): Ray {
    const { origin, direction } = this.scene_.ray(clientX, clientY);
    return { origin: add(origin, this.scene_.origin), direction };
  }
}
