// Server-Sent Events over fetch: EventSource cannot send a key.

export interface ServerEvent {
  event: string;
  data: string;
}

/** A line longer than this is no event of ours. */
const MAX_LINE = 4 << 20;

/** Puts events together from text that comes in any pieces. */
export class EventReader {
  private rest = '';
  private event = '';
  private data: string[] = [];

  push(text: string): ServerEvent[] {
    const lines = (this.rest + text).split(/\r\n|\n|\r/);
    this.rest = lines.pop() ?? '';
    if (this.rest.length > MAX_LINE) throw new Error('an event is too long');
    return lines.flatMap((line) => this.line(line));
  }

  private line(line: string): ServerEvent[] {
    if (line === '') {
      const whole = { event: this.event || 'message', data: this.data.join('\n') };
      const isEvent = this.data.length > 0;
      this.event = '';
      this.data = [];
      return isEvent ? [whole] : [];
    }
    const colon = line.indexOf(':');
    const name = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? '' : line.slice(colon + 1).replace(/^ /, '');
    if (name === 'event') this.event = value;
    if (name === 'data') this.data.push(value);
    return [];
  }
}

/** The events of an answer, as they come. */
export async function* eventsOf(body: ReadableStream<Uint8Array>): AsyncGenerator<ServerEvent> {
  const reader = body.getReader();
  const decoder = new TextDecoder();
  const events = new EventReader();
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      yield* events.push(decoder.decode(value, { stream: true }));
    }
  } finally {
    await reader.cancel().catch(() => undefined);
  }
}
