/** One server-sent event. */
export interface ServerEvent {
  /** Of the latest event that had an id, this one included; empty before. */
  id: string;
  event: string;
  data: string;
}

/**
 * Takes an event stream's text in pieces and returns the events that are complete.
 *
 * @see https://html.spec.whatwg.org/multipage/server-sent-events.html#event-stream-interpretation
 */
export class SseParser {
  private rest_ = '';
  private id_ = '';
  private event_ = '';
  private data_: string[] = [];

  push(text: string): ServerEvent[] {
    const events: ServerEvent[] = [];
    // A carriage return at the end may be half of a line's end.
    const lines = (this.rest_ + text).split(/\r\n|\n|\r(?!$)/);
    this.rest_ = lines.pop() ?? '';
    for (const line of lines) {
      const event = this.line(line);
      if (event !== undefined) events.push(event);
    }
    return events;
  }

  private line(line: string): ServerEvent | undefined {
    if (line === '') return this.dispatch();
    const colon = line.indexOf(':');
    if (colon === 0) return undefined;
    const field = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? '' : line.slice(colon + 1).replace(/^ /, '');
    if (field === 'id' && !value.includes('\0')) this.id_ = value;
    if (field === 'event') this.event_ = value;
    if (field === 'data') this.data_.push(value);
    return undefined;
  }

  private dispatch(): ServerEvent | undefined {
    const event = { id: this.id_, event: this.event_ === '' ? 'message' : this.event_, data: this.data_.join('\n') };
    const empty = this.data_.length === 0;
    this.event_ = '';
    this.data_ = [];
    return empty ? undefined : event;
  }
}
