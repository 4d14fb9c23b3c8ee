// The link to the server: its events for one map, and coming back when they end.

import { Signal } from '../signal';
import { Backoff } from './backoff';
import { eventsOf } from './events';
import type { Api } from './http';
import { Refused, said } from './http';
import type { MapStats } from './types';

export type Link =
  | { kind: 'connecting' }
  | { kind: 'live' }
  /** The server is there, but not ready. */
  | { kind: 'starting'; message: string; retryAt: number }
  | { kind: 'lost'; message: string; retryAt: number }
  /** It wants a key, or another one. */
  | { kind: 'key'; message: string }
  | { kind: 'denied'; message: string }
  /** There is no such map. */
  | { kind: 'no-map'; message: string };

/** A server that says nothing for this long is gone: it sends something every second. */
const SILENCE_MS = 6_000;

export class Connection {
  readonly link = new Signal<Link>({ kind: 'connecting' });
  readonly stats = new Signal<MapStats | null>(null);
  private readonly backoff = new Backoff();
  private attempt = new AbortController();
  private wake: () => void = () => undefined;
  private mapId: string | null = null;

  constructor(private readonly api: Api) {
    void this.run();
    window.addEventListener('online', () => this.retry());
    document.addEventListener('visibilitychange', () => {
      if (document.visibilityState === 'visible' && this.link.value.kind !== 'live') this.retry();
    });
  }

  /** Listens to another map from now on. */
  listen(mapId: string): void {
    if (mapId === this.mapId) return;
    this.mapId = mapId;
    this.stats.set(null);
    this.link.set({ kind: 'connecting' });
    this.retry();
  }

  /** Tries again now. */
  retry(): void {
    this.backoff.reset();
    this.attempt.abort();
    this.wake();
  }

  private async run(): Promise<void> {
    for (;;) {
      if (this.mapId === null) {
        await this.sleep(0);
        continue;
      }
      this.attempt = new AbortController();
      const { signal } = this.attempt;
      let failure: unknown = null;
      try {
        await this.follow(this.mapId, signal);
      } catch (error) {
        failure = error;
      }
      if (signal.aborted && !(failure instanceof Silence)) continue;
      await this.sleep(this.say(failure));
    }
  }

  /** Reads events until they end. */
  private async follow(mapId: string, signal: AbortSignal): Promise<void> {
    const path = `/v1/events?map=${encodeURIComponent(mapId)}`;
    const silent = new AbortController();
    const leave = () => silent.abort();
    signal.addEventListener('abort', leave);
    let timer = setTimeout(leave, SILENCE_MS);
    try {
      const ask = { accept: 'text/event-stream', signal: silent.signal, patienceMs: 0 };
      const response = await this.api.ask(path, ask);
      if (!response.body) throw new Error('this browser cannot read events');
      for await (const { event, data } of eventsOf(response.body)) {
        clearTimeout(timer);
        timer = setTimeout(leave, SILENCE_MS);
        if (event === 'end') throw new Error((JSON.parse(data) as { reason: string }).reason);
        if (event !== 'status' || mapId !== this.mapId) continue;
        this.backoff.reset();
        this.link.set({ kind: 'live' });
        this.stats.set(JSON.parse(data) as MapStats);
      }
      throw new Error('the server ended the connection');
    } catch (error) {
      throw silent.signal.aborted && !signal.aborted ? new Silence() : error;
    } finally {
      clearTimeout(timer);
      signal.removeEventListener('abort', leave);
    }
  }

  /** Says what is wrong; how long to wait, 0 until somebody does something. */
  private say(error: unknown): number {
    const message = said(error);
    if (error instanceof Refused && error.status === 401) {
      this.link.set({ kind: 'key', message });
      return 0;
    }
    if (error instanceof Refused && error.status === 403) {
      this.link.set({ kind: 'denied', message });
      return 0;
    }
    if (error instanceof Refused && error.status === 404) {
      this.link.set({ kind: 'no-map', message });
      return 0;
    }
    const wait = this.backoff.next();
    const kind = error instanceof Refused && error.status === 503 ? 'starting' : 'lost';
    this.link.set({ kind, message, retryAt: Date.now() + wait });
    return wait;
  }

  private sleep(ms: number): Promise<void> {
    return new Promise((done) => {
      const timer = ms > 0 ? setTimeout(done, ms) : undefined;
      this.wake = () => {
        clearTimeout(timer);
        done();
      };
    });
  }
}

class Silence extends Error {
  constructor() {
    super('the server is silent');
  }
}
