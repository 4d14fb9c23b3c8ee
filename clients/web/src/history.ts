// What counters did lately: rates and times between two of them.

import type { MapStats } from './api/types';

export interface Sample {
  at: number;
  framesPerSecond: number;
  /** Of the frames in between; null where none came. */
  latencyMs: number | null;
  waiting: number;
  refused: number;
  mapBytes: number;
  processBytes: number;
  losses: Record<string, number>;
}

/** Samples that are kept: two minutes. */
const MOST = 240;
/** Rates are taken over this time, so that they stand still. */
const WINDOW_MS = 2_000;

export class History {
  samples: Sample[] = [];
  private past: { at: number; stats: MapStats }[] = [];

  clear(): void {
    this.samples = [];
    this.past = [];
  }

  add(stats: MapStats, at: number): Sample {
    const newest = this.past.at(-1)?.stats;
    // Counters that fell are those of a server that was started anew.
    if (newest && newest.counts.received > stats.counts.received) this.clear();
    this.past.push({ at, stats });
    while ((this.past[1]?.at ?? Infinity) <= at - WINDOW_MS) this.past.shift();
    const first = this.past[0] ?? { at, stats };
    const seconds = (at - first.at) / 1000;
    const frames = stats.counts.integrated - first.stats.counts.integrated;
    const seen = stats.visible_after.frames - first.stats.visible_after.frames;
    const spent = stats.visible_after.sum_s - first.stats.visible_after.sum_s;
    const sample: Sample = {
      at,
      framesPerSecond: seconds > 0.2 ? frames / seconds : 0,
      latencyMs: seen > 0 ? (spent / seen) * 1000 : null,
      waiting: stats.counts.waiting,
      refused: refusedFrames(stats),
      mapBytes: stats.map_bytes,
      processBytes: stats.resident_bytes,
      losses: stats.losses,
    };
    this.samples = [...this.samples.slice(1 - MOST), sample];
    return sample;
  }
}

/** Frames that did not get into the map, for any reason. */
export function refusedFrames({ counts }: MapStats): number {
  const sum = (by: Record<string, number>) => Object.values(by).reduce((a, b) => a + b, 0);
  return sum(counts.dropped) + sum(counts.rejected) + counts.lost;
}
