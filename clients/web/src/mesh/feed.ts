// Follows the surface of one map: asks for what changed whenever there is an epoch that has it.

import type { Api } from '../api/http';
import { mapPath } from '../api/http';
import type { Pieces } from './read';
import { readPieces } from './read';

export type Detail = 'coarse' | 'medium' | 'fine';

/** Between two questions that nobody waits for, ms. */
const INTERVAL_MS = 350;
/** What changed a little is told by the server some seconds later. */
const SETTLE_MS = 5_000;

export class MeshFeed {
  private since = 0;
  private epoch = -1;
  private wanted = -1;
  private asking = false;
  private settle: ReturnType<typeof setTimeout> | undefined;
  private readonly stopped = new AbortController();

  constructor(
    private readonly api: Api,
    private readonly mapId: string,
    private readonly detail: Detail,
    /** Gets every answer; `fresh` ones go to an empty scene. */
    private readonly onPieces: (pieces: Pieces) => void,
    /** Of pieces that are there, and are to be replaced one by one. */
    private generation = 0,
  ) {}

  get currentGeneration(): number {
    return this.generation;
  }

  stop(): void {
    this.stopped.abort();
    clearTimeout(this.settle);
  }

  /** There is this epoch. */
  follow(epoch: number): void {
    this.wanted = epoch;
    if (!this.asking && this.wanted !== this.epoch) void this.catchUp();
  }

  private async catchUp(): Promise<void> {
    this.asking = true;
    try {
      while (!this.stopped.signal.aborted) {
        const more = await this.askOnce();
        if (this.stopped.signal.aborted) return;
        if (!more && this.epoch >= this.wanted) break;
        if (!more) await pause(INTERVAL_MS);
      }
      clearTimeout(this.settle);
      this.settle = setTimeout(() => void (this.asking || this.catchUp()), SETTLE_MS);
    } catch {
      // Whether the server is there is said by the events; the next epoch tries again.
      this.epoch = -1;
    } finally {
      this.asking = false;
    }
  }

  private async askOnce(): Promise<boolean> {
    const query = new URLSearchParams({
      generation: String(this.generation),
      since: String(this.since),
      detail: this.detail,
    });
    const path = mapPath(this.mapId, `/mesh/pieces?${query.toString()}`);
    const pieces = readPieces(await this.api.bytes(path, { signal: this.stopped.signal }));
    if (this.stopped.signal.aborted) return false;
    this.generation = pieces.generation;
    this.since = pieces.next;
    // Looks are a fifth of a second apart: an epoch that came since is asked for again.
    this.epoch = pieces.more ? -1 : pieces.epoch;
    this.onPieces(pieces);
    return pieces.more;
  }
}

function pause(ms: number): Promise<void> {
  return new Promise((done) => setTimeout(done, ms));
}
