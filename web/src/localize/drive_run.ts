import type { Answer } from './answer.js';

/** The requests of a run: open a session, send scans, close it. */
export interface SessionRoutes {
  open(): Promise<string>;
  send(session: string, scan: number): Promise<Answer>;
  close(session: string): Promise<void>;
}

export type RunState = 'ready' | 'running' | 'paused' | 'done' | 'failed';

/** Sends one scan after the other to a session of its own, as a vehicle does. */
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

  /** Runs to the end, or until `pause`. */
  async play(): Promise<void> {
    if (this.state === 'done' || this.state === 'running') return;
    this.become('running');
    while (this.isRunning()) await this.step();
  }

  pause(): void {
    if (this.state === 'running') this.become('paused');
  }

  /** Sends the next scan, unless one is being sent. A failure is kept in `error`; `play` tries again. */
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

  /** Closes the session; the answers stay. */
  async end(state: RunState = 'paused'): Promise<void> {
    const session = this.session;
    this.session = undefined;
    this.become(state);
    // A session that could not be closed ends when it has been idle for some time.
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
