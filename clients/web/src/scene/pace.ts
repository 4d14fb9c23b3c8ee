// Draws less where a machine is slow, and says what.

export interface Quality {
  /** Of the screen's own pixels, a side. */
  pixels: number;
  /** Share of the pieces that are drawn while the eye moves, the nearest first. */
  pieces: number;
}

/** From all to the least. */
const STEPS: Quality[] = [
  { pixels: 1, pieces: 1 },
  { pixels: 0.75, pieces: 1 },
  { pixels: 0.5, pieces: 1 },
  { pixels: 0.5, pieces: 0.6 },
  { pixels: 0.4, pieces: 0.35 },
];

const SLOW_MS = 33;
const QUICK_MS = 18;
/** Frames that are looked at before a step. */
const FRAMES = 8;

/** Watches the times of frames that follow each other. */
export class Pace {
  private step = 0;
  private times: number[] = [];
  /** After a step up that was one too many, the next one waits longer. */
  private patience = 1;
  private proven = false;

  get quality(): Quality {
    return STEPS[this.step] ?? { pixels: 1, pieces: 1 };
  }

  get isLess(): boolean {
    return this.step > 0;
  }

  /** Whether frames came quickly, with everything drawn. */
  get isQuick(): boolean {
    return this.proven && this.step === 0;
  }

  get isLeast(): boolean {
    return this.step === STEPS.length - 1;
  }

  /** One frame took so long from the last one; whether the quality is another now. */
  frame(ms: number): boolean {
    // A tab that was away, or a machine that slept.
    if (ms > 2_000) return false;
    this.times.push(ms);
    const wanted = this.isSlow() ? FRAMES : FRAMES * 4 * this.patience;
    if (this.times.length < wanted) return false;
    const median = [...this.times].sort((a, b) => a - b)[Math.floor(this.times.length / 2)] ?? 0;
    this.times = [];
    this.proven = median < QUICK_MS;
    if (median > SLOW_MS && this.step < STEPS.length - 1) {
      this.step += 1;
      this.patience = Math.min(this.patience * 2, 32);
      return true;
    }
    if (median < QUICK_MS && this.step > 0) {
      this.step -= 1;
      return true;
    }
    return false;
  }

  private isSlow(): boolean {
    const last = this.times.slice(-FRAMES);
    return last.length === FRAMES && last.every((ms) => ms > SLOW_MS);
  }

  /** What is drawn less of, or nothing. */
  get says(): string {
    const { pixels, pieces } = this.quality;
    const parts = [];
    if (pixels < 1) parts.push(`${Math.round(pixels * 100)} % of the pixels a side`);
    if (pieces < 1) parts.push(`${Math.round(pieces * 100)} % of the map while moving`);
    return parts.length > 0 ? `This device is slow: drawing ${parts.join(', ')}` : '';
  }
}
