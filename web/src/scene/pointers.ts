import type { MapCloud, PickedPoint } from './map_cloud.js';
import type { Vec3 } from './types.js';

/** A place under the pointer; map coordinates [m]. */
export interface Pick {
  readonly position: Vec3;
  /** The point there; undefined if only the ground plane is there. */
  readonly point?: PickedPoint;
  readonly cloud?: MapCloud;
}

/** The pointer over the canvas. */
export interface PointerPlace {
  readonly clientX: number;
  readonly clientY: number;
  readonly shiftKey: boolean;
  /** The place under it; searched only once, when called. */
  readonly pick: () => Pick | undefined;
}

/** What the pointer does instead of moving the camera. */
export interface Tool {
  /** CSS cursor. */
  readonly cursor?: string;
  /** @return true to take the drag that starts here, so that the camera does not move. */
  readonly down?: (place: PointerPlace) => boolean;
  /** While it moves: with the drag, or over the canvas with nothing pressed. */
  readonly move?: (place: PointerPlace) => void;
  /** The end of a drag that was taken. */
  readonly up?: (place: PointerPlace) => void;
  /** Pressed and released at one place. */
  readonly click?: (place: PointerPlace) => void;
  /** A double click. */
  readonly doubleClick?: (place: PointerPlace) => void;
  /** Another tool took over, or Escape was pressed. */
  readonly cancel?: () => void;
}

/** Most movement of a click [px]. */
const kClickPx = 4;

/** Distinguishes clicks from drags, and passes them to the present tool. */
export class Pointers {
  private tool_: Tool | null = null;
  private down_: { x: number; y: number; taken: boolean } | undefined;
  private hover_: PointerEvent | undefined;
  private hoverPending_ = false;
  private readonly listeners_ = new Set<(pick: Pick | undefined) => void>();
  private readonly stop_ = new AbortController();

  constructor(
    private readonly scene_: { canvas: HTMLElement; pick: (clientX: number, clientY: number) => Pick | undefined },
    private readonly steer_: (on: boolean) => void,
  ) {
    const { canvas } = scene_;
    const options = { signal: this.stop_.signal };
    // Before the camera's own listener, which is turned off when a tool takes the drag.
    canvas.addEventListener('pointerdown', (event) => this.down(event), { ...options, capture: true });
    canvas.addEventListener('pointermove', (event) => this.move(event), options);
    canvas.addEventListener('pointerup', (event) => this.up(event), options);
    canvas.addEventListener('pointercancel', () => this.end(), options);
    canvas.addEventListener('pointerleave', (event) => this.leave(event), options);
    canvas.addEventListener('dblclick', (event) => this.tool_?.doubleClick?.(this.place(event)), options);
    canvas.addEventListener('keydown', (event) => {
      if (event.key === 'Escape') this.tool_?.cancel?.();
    }, options);
  }

  setTool(tool: Tool | null): void {
    if (tool === this.tool_) return;
    const before = this.tool_;
    this.tool_ = tool;
    this.end();
    this.scene_.canvas.style.cursor = tool?.cursor ?? '';
    before?.cancel?.();
  }

  onHover(listener: (pick: Pick | undefined) => void): () => void {
    this.listeners_.add(listener);
    return () => this.listeners_.delete(listener);
  }

  dispose(): void {
    this.stop_.abort();
    this.listeners_.clear();
  }

  private down(event: PointerEvent): void {
    // A second finger makes it a gesture of the camera, unless a tool has it.
    if (!event.isPrimary && this.down_?.taken === false) this.down_ = undefined;
    if (event.button !== 0 || !event.isPrimary) return;
    const taken = this.tool_?.down?.(this.place(event)) ?? false;
    this.down_ = { x: event.clientX, y: event.clientY, taken };
    if (!taken) return;
    this.steer_(false);
    this.scene_.canvas.setPointerCapture(event.pointerId);
  }

  private move(event: PointerEvent): void {
    if (!event.isPrimary) return;
    if (this.down_?.taken) return this.tool_?.move?.(this.place(event));
    if (event.buttons !== 0) return;
    this.hover_ = event;
    if (this.hoverPending_) return;
    this.hoverPending_ = true;
    requestAnimationFrame(() => this.hover());
  }

  private up(event: PointerEvent): void {
    const down = this.down_;
    if (down === undefined || !event.isPrimary) return;
    this.end();
    const place = this.place(event);
    if (down.taken) this.tool_?.up?.(place);
    if (Math.hypot(event.clientX - down.x, event.clientY - down.y) > kClickPx) return;
    this.tool_?.click?.(place);
    // A finger cannot hover: the tapped place counts as hovered.
    if (event.pointerType === 'touch') this.tellHover(place.pick());
  }

  private hover(): void {
    this.hoverPending_ = false;
    if (this.hover_ === undefined) return;
    const place = this.place(this.hover_);
    this.tool_?.move?.(place);
    if (this.listeners_.size > 0) this.tellHover(place.pick());
  }

  private leave(event: PointerEvent): void {
    this.hover_ = undefined;
    if (event.pointerType !== 'touch') this.tellHover(undefined);
  }

  private tellHover(pick: Pick | undefined): void {
    for (const listener of this.listeners_) listener(pick);
  }

  private end(): void {
    this.down_ = undefined;
    this.steer_(true);
  }

  private place({ clientX, clientY, shiftKey }: MouseEvent): PointerPlace {
    let found: { pick: Pick | undefined } | undefined;
    return {
      clientX, clientY, shiftKey,
      pick: () => (found ??= { pick: this.scene_.pick(clientX, clientY) }).pick,
    };
  }
}
