/** Time for drawing a frame; script only, without waiting for the graphics card. */
export interface FrameCosts {
  readonly frames: number;
  /** Of the newest frames [ms]. */
  readonly medianMs: number;
}

const kRemembered = 120;

/** Calls `draw` once for any number of requests until the next frame; nothing runs while there is no request. */
export class FrameLoop {
  private pending_ = 0;
  private frames_ = 0;
  private readonly costs_: number[] = [];

  constructor(private readonly draw_: () => void) {}

  request(): void {
    if (this.pending_ === 0) this.pending_ = requestAnimationFrame(() => this.now());
  }

  /** Draws at once, in place of a pending request. */
  now(): void {
    cancelAnimationFrame(this.pending_);
    this.pending_ = 0;
    const begin = performance.now();
    this.draw_();
    this.costs_[this.frames_++ % kRemembered] = performance.now() - begin;
  }

  get costs(): FrameCosts {
    const sorted = [...this.costs_].sort((a, b) => a - b);
    return { frames: this.frames_, medianMs: sorted[Math.floor(sorted.length / 2)] ?? 0 };
  }

  dispose(): void {
    cancelAnimationFrame(this.pending_);
  }
}
