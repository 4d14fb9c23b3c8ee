// How long to wait before the server is asked again.

const FIRST_MS = 500;
const MOST_MS = 15_000;

/** Doubles up to a bound, with some chance in it: many pages must not come back at one moment. */
export class Backoff {
  private tries = 0;

  constructor(private readonly chance: () => number = Math.random) {}

  /** The next wait, ms. */
  next(): number {
    const most = Math.min(MOST_MS, FIRST_MS * 2 ** this.tries);
    this.tries += 1;
    return most * (0.75 + 0.25 * this.chance());
  }

  reset(): void {
    this.tries = 0;
  }
}
