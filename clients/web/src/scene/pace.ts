// Draws less while the view moves, where a machine is slow, and says what. At rest everything is drawn.

import type { Level } from './shape';

export interface Quality {
  /** Drawn for each pixel of the page, a side. Two are smooth on any screen: edges have no other smoothing. */
  pixels: number;
  /** How many of the triangles. */
  level: Level;
}

export const ALL: Quality = { pixels: 2, level: 0 };

/** From all to the least. */
const STEPS: Quality[] = [
  ALL,
  { pixels: 1.4, level: 0 },
  { pixels: 1, level: 0 },
  { pixels: 1, level: 1 },
  { pixels: 0.7, level: 1 },
  { pixels: 0.7, level: 2 },
  { pixels: 0.5, level: 2 },
];

/** Thirty frames a second, and what a clock is off by. */
const SLOW_MS = 35;
const QUICK_MS = 18;
/** Frames that are looked at before a step. */
const FRAMES = 5;
/** Where a machine begins that has no graphics card. */
const SOFTWARE_STEP = 3;

/** Watches the times of frames that follow each other. */
export class Pace {
  private step: number;
  private times: number[] = [];
  /** After a step up that was one too many, the next one waits longer. */
  private patience = 1;
  private proven = false;

  constructor(isSoftware = false) {
    this.step = isSoftware ? SOFTWARE_STEP : 0;
  }

  get quality(): Quality {
    return STEPS[this.step] ?? ALL;
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

  /** The next frame begins a movement: how long ago the last one was tells nothing. */
  begin(): void {
    this.times = [];
  }

  /** One frame took so long from the last one. */
  frame(ms: number): void {
    // A tab that was away, or a machine that slept.
    if (ms > 2_000) return;
    this.times.push(ms);
    const wanted = this.isSlow() ? FRAMES : FRAMES * 5 * this.patience;
    if (this.times.length < wanted) return;
    const median = [...this.times].sort((a, b) => a - b)[Math.floor(this.times.length / 2)] ?? 0;
    this.times = [];
    this.proven = median < QUICK_MS;
    if (median > SLOW_MS && !this.isLeast) {
      // A step halves what a frame costs, about.
      const steps = Math.max(1, Math.round(Math.log2(median / SLOW_MS)));
      this.step = Math.min(this.step + steps, STEPS.length - 1);
      this.patience = Math.min(this.patience * 2, 32);
    } else if (median < QUICK_MS && this.step > 0) {
      this.step -= 1;
    }
  }

  private isSlow(): boolean {
    const last = this.times.slice(-FRAMES);
    return last.length === FRAMES && last.every((ms) => ms > SLOW_MS);
  }
}
