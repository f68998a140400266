import type { Answer } from './answer.js';

/** What a run asks of the server: one session, its scans, its end. */
export interface SessionRoutes {
  open(): Promise<string>;
  send(session: string, scan: number): Promise<Answer>;
  close(session: string): Promise<void>;
}

export type RunState = 'ready' | 'running' | 'paused' | 'done' | 'failed';

/** One scan after the other through a session of its own, as a vehicle would send them. */
export class DriveRun {
  readonly answers: Answer[] = [];
  state: RunState = 'ready';
  error: unknown;
  private session: string | undefined;
  private stepping = false;

  /** @param changed called after every answer and every change of `state`. */
  constructor(
    readonly scans: number,
    private readonly routes: SessionRoutes,
    private readonly changed: () => void,
  ) {}

  /** Goes on to the end, or until `pause`. */
  async play(): Promise<void> {
    if (this.state === 'done' || this.state === 'running') return;
    this.become('running');
    while (this.isRunning()) await this.step();
  }

  pause(): void {
    if (this.state === 'running') this.become('paused');
  }

  /** Sends the next scan, if there is one and none is under way. A failure is kept in `error`; playing tries it again. */
  async step(): Promise<void> {
    if (this.stepping || this.state === 'done') return;
    this.stepping = true;
    try {
      this.session ??= await this.routes.open();
      this.answers.push(await this.routes.send(this.session, this.answers.length));
      this.error = undefined;
      if (this.answers.length === this.scans) await this.end('done');
      else if (this.state !== 'running') this.become('paused');
    } catch (error) {
      this.error = error;
      // A session that was idle for too long is gone: the next scan opens another one.
      if ((error as { status?: number }).status === 404) this.session = undefined;
      this.become('failed');
    } finally {
      this.stepping = false;
    }
    this.changed();
  }

  /** Gives the session back; what was answered stays. */
  async end(state: RunState = 'paused'): Promise<void> {
    const session = this.session;
    this.session = undefined;
    this.become(state);
    // A session that could not be closed ends by itself once it is idle.
    if (session !== undefined) await this.routes.close(session).catch(() => undefined);
  }

  private isRunning(): boolean {
    return this.state === 'running';
  }

  private become(state: RunState): void {
    this.state = state;
    this.changed();
  }
}
